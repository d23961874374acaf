"""Decodes an encoded volume (docs/volume_format.md) with operations on whole arrays."""
from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
import zstandard
from numpy.typing import NDArray

Bools = NDArray[np.bool_]
Bytes = NDArray[np.uint8]
Ints = NDArray[np.int64]

_HEADER = struct.Struct("<4sBBH3dd3HHII")
_MAX_BRICKS, _MAX_COLOURS = 1 << 20, 1 << 24
# dx, dy, dz of the neighbours in the same brick that predict a colour, in this order.
_BEFORE = (
    (-1, 0, 0),
    (0, -1, 0),
    (0, 0, -1),
    (1, -1, 0),
    (-1, -1, 0),
    (-1, 0, -1),
    (1, 0, -1),
    (0, -1, -1),
    (0, 1, -1),
)
_LEVEL = ((np.arange(64) * 255 + 31) // 63).astype(np.uint8)


class DamagedVolume(ValueError):
    """The bytes are damaged or not an encoded volume."""


@dataclass(frozen=True)
class Decoded:
    """origin_m (3,); bricks_per_axis x, y, z; bricks (n, 3) x, y, z from the origin, sorted by z, y, x; occupancy
    (n, 8, 8, 8) by z, y, x; surface likewise: occupied with an empty neighbour; colours (m, 3) R G B in the order of
    surface's nonzero voxels, or None."""

    origin_m: NDArray[np.float64]
    voxel_m: float
    bricks_per_axis: tuple[int, int, int]
    bricks: Ints
    occupancy: Bools
    surface: Bools
    colours: Bytes | None


def decode(data: bytes) -> Decoded:
    """Decodes one volume; DamagedVolume for any input that no daemon writes."""
    if len(data) < _HEADER.size:
        raise DamagedVolume(f"{len(data)} bytes are too few for a header")
    (magic, version, flags, zero, ox, oy, oz, voxel_m, bx, by, bz, zero_too, count, colours) = _HEADER.unpack_from(data)
    if magic != b"KVXV":
        raise DamagedVolume("does not begin with KVXV")
    if version != 1:
        raise DamagedVolume(f"version {version} is not known, expected 1; update this program")
    if flags > 1 or zero or zero_too or not (np.isfinite([ox, oy, oz]).all() and 0 < voxel_m < np.inf):
        raise DamagedVolume("the header makes no sense")
    if count > _MAX_BRICKS or colours > _MAX_COLOURS or (not flags and colours) or max(bx, by, bz) > 32767:
        raise DamagedVolume(f"{count} bricks and {colours} colours exceed the limits")
    sections = _sections(data, 7 if flags else 4, count, colours)
    indices = _brick_indices(sections[0], count, bx * by * bz)
    occupancy = _occupancy(sections[1], sections[2], sections[3], count)
    surface = _surface(indices, occupancy, (bx, by, bz))
    bricks = np.stack([indices % max(bx, 1), indices // max(bx, 1) % max(by, 1), indices // max(bx * by, 1)], axis=1)
    shown = _colours(surface, np.stack(sections[4:], axis=1)) if flags else None
    return Decoded(np.array([ox, oy, oz]), voxel_m, (bx, by, bz), bricks, occupancy, surface, shown)


def _sections(data: bytes, number: int, count: int, colours: int) -> list[Bytes]:
    """The unpacked sections; their sizes are checked before anything is unpacked."""
    start = _HEADER.size + 8 * number
    if len(data) < start:
        raise DamagedVolume("ends within the header")
    sizes = struct.unpack_from(f"<{2 * number}I", data, _HEADER.size)
    raw, stored = sizes[::2], sizes[1::2]
    if start + sum(stored) != len(data):
        raise DamagedVolume(f"holds {len(data) - start} bytes of sections, its header says {sum(stored)}")
    if not (
        count <= raw[0] <= 7 * count
        and raw[1] == 2 * count
        and raw[2] % 2 == 0
        and raw[2] <= 16 * count
        and raw[3] <= 4 * raw[2]
        and all(size == colours for size in raw[4:])
    ):
        raise DamagedVolume("the sections' sizes contradict the number of bricks or colours")
    unpacker = zstandard.ZstdDecompressor()
    out: list[Bytes] = []
    view = memoryview(data)
    for i in range(number):
        piece = view[start : start + stored[i]]
        start += stored[i]
        if stored[i] != raw[i]:
            try:
                if zstandard.frame_content_size(piece) != raw[i]:
                    raise DamagedVolume(f"section {i} does not hold what the header says")
                piece = memoryview(unpacker.decompress(piece))
            except zstandard.ZstdError:
                raise DamagedVolume(f"section {i} cannot be unpacked") from None
        if len(piece) != raw[i]:
            raise DamagedVolume(f"section {i} does not hold what the header says")
        out.append(np.frombuffer(piece, dtype=np.uint8))
    return out


def _brick_indices(deltas: Bytes, count: int, limit: int) -> Ints:
    """Index of each brick, ascending, from the deltas: seven bits per byte, least significant first."""
    last = deltas < 0x80
    if np.count_nonzero(last) != count or (count and not last[-1]):
        raise DamagedVolume("the number of brick index deltas differs from the number of bricks")
    if count == 0:
        return np.empty(0, dtype=np.int64)
    starts = np.concatenate([[0], np.flatnonzero(last)[:-1] + 1])
    lengths = np.diff(np.append(starts, deltas.size))
    if lengths.max() > 7:
        raise DamagedVolume("a brick lies outside the grid")
    shifts = 7 * (np.arange(deltas.size) - np.repeat(starts, lengths))
    values = np.add.reduceat((deltas & 0x7F).astype(np.int64) << shifts, starts)
    indices: Ints = np.cumsum(values + 1) - 1
    if values.max() >= limit or indices[-1] >= limit or (indices < 0).any():
        raise DamagedVolume("a brick lies outside the grid")
    return indices


def _bits(masks: Bytes) -> Bools:
    """(..., 8) of (...)."""
    return np.unpackbits(masks[..., None], axis=-1, bitorder="little").view(bool)


def _occupancy(brick_masks: Bytes, octant_masks: Bytes, cell_masks: Bytes, count: int) -> Bools:
    """(count, 8, 8, 8) by z, y, x from the three levels of the octree."""
    problem = "an octree mask contradicts itself"
    length = "the sections of the shape do not have the length that the shape needs"
    some, full = brick_masks.reshape(count, 2).T
    if (full & ~some).any() or (some == 0).any():
        raise DamagedVolume(problem)
    mixed = _bits(some & ~full)  # (count, octants)
    if 2 * np.count_nonzero(mixed) != octant_masks.size:
        raise DamagedVolume(length)
    some_cells, full_cells = octant_masks.reshape(-1, 2).T
    if (full_cells & ~some_cells).any() or (some_cells == 0).any() or (full_cells == 0xFF).any():
        raise DamagedVolume(problem)
    mixed_cells = _bits(some_cells & ~full_cells)  # (mixed octants, cells)
    if np.count_nonzero(mixed_cells) != cell_masks.size:
        raise DamagedVolume(length)
    if ((cell_masks == 0) | (cell_masks == 0xFF)).any():
        raise DamagedVolume(problem)
    voxels = np.where(_bits(full_cells), np.uint8(0xFF), np.uint8(0))
    voxels[mixed_cells] = cell_masks
    cells = np.zeros((count, 8, 8), dtype=np.uint8)  # one byte per cell of 2 x 2 x 2 voxels
    cells[_bits(full)] = 0xFF
    cells[mixed] = voxels
    # Bits by (brick, octant z y x, cell z y x, voxel z y x) to (brick, z, y, x).
    bits = _bits(cells).reshape(count, 2, 2, 2, 2, 2, 2, 2, 2, 2)
    return np.ascontiguousarray(bits.transpose(0, 1, 4, 7, 2, 5, 8, 3, 6, 9)).reshape(count, 8, 8, 8)


def _surface(indices: Ints, occupancy: Bools, size: tuple[int, int, int]) -> Bools:
    """Occupied voxels with an empty one among their six neighbours; outside the box is empty."""
    count = indices.size
    bx, by, bz = (max(n, 1) for n in size)
    at = (indices % bx, indices // bx % by, indices // (bx * by))
    padded = np.zeros((count, 10, 10, 10), dtype=bool)
    padded[:, 1:9, 1:9, 1:9] = occupancy
    for axis, (step, length) in enumerate(zip((1, bx, bx * by), (bx, by, bz))):
        for side in (-1, 1):
            inside = (at[axis] > 0) if side < 0 else (at[axis] < length - 1)
            wanted = indices + side * step
            found = np.minimum(np.searchsorted(indices, wanted), max(count - 1, 0))
            here = np.flatnonzero(inside & (indices[found] == wanted)) if count else np.empty(0, dtype=np.int64)
            face = [slice(1, 9)] * 3
            theirs: list[int | slice] = [slice(None)] * 3
            ours: list[int | slice] = list(face)
            ours[2 - axis], theirs[2 - axis] = (0, 7) if side < 0 else (9, 0)
            padded[(here, *ours)] = occupancy[(found[here], *theirs)]
    inner = slice(1, 9)
    hidden = padded[:, :8, inner, inner] & padded[:, 2:, inner, inner]
    hidden &= padded[:, inner, :8, inner] & padded[:, inner, 2:, inner]
    hidden &= padded[:, inner, inner, :8] & padded[:, inner, inner, 2:]
    surface: Bools = occupancy & ~hidden
    return surface


def _colours(surface: Bools, errors: Bytes) -> Bytes:
    """Colours (m, 3) from the errors of their predictions, (m, 3) of Y, Co, Cg.

    A constant added to all colours of a brick moves the predictions by the same constant: (a + c + b + c) >> 1 =
    ((a + b) >> 1) + c. So all bricks are decoded in parallel as if the last colour of the previous brick were 0, and
    that colour is added at the end.

    """
    brick, z, y, x = np.nonzero(surface)
    total = brick.size
    if total != len(errors):
        raise DamagedVolume("the number of colours differs from the number of surface voxels")
    if total == 0:
        return np.empty((0, 3), dtype=np.uint8)
    counts = np.bincount(brick, minlength=len(surface))
    starts = np.cumsum(counts) - counts
    rank = np.arange(total) - starts[brick]
    order = np.argsort(rank, kind="stable")  # by rank, then brick
    place = np.empty(total, dtype=np.int64)
    place[order] = np.arange(total)

    first, second = _parents(surface, brick, z, y, x, rank)
    slots = np.append(place, total)  # the last one: no voxel, colour 0
    first, second = slots[first[order]], slots[second[order]]
    steps = errors[order].view(np.int8).astype(np.int16)
    values = np.zeros((total + 1, 3), dtype=np.int16)
    ends = np.cumsum(np.bincount(rank))
    begin = 0
    for end in ends.tolist():
        predicted = values[first[begin:end]]
        predicted += values[second[begin:end]]
        predicted >>= 1
        predicted += steps[begin:end]
        values[begin:end] = predicted
        begin = end

    relative = values[place].astype(np.int32)
    filled = np.flatnonzero(counts)
    last = relative[starts[filled] + counts[filled] - 1]
    offsets = np.zeros((len(counts), 3), dtype=np.int32)
    offsets[filled] = np.cumsum(last, axis=0) - last
    luma, orange, green = (relative + offsets[brick]).T
    t = luma - (green >> 1)
    g = green + t
    b = t - (orange >> 1)
    rgb = np.stack([b + orange, g, b], axis=1)
    if rgb.min() < 0 or rgb.max() > 63:
        raise DamagedVolume("a colour is out of range")
    colours: Bytes = _LEVEL[rgb]
    return colours


def _parents(surface: Bools, brick: Ints, z: Ints, y: Ints, x: Ints, rank: Ints) -> tuple[Ints, Ints]:
    """Numbers of the two surface voxels that each colour is predicted from, twice the same where there is one; where
    there is none, the voxel coded just before in the same brick; at a brick's begin `total`.
    """
    total = brick.size
    number = np.full((len(surface), 10, 10, 10), -1, dtype=np.int32)
    number[brick, z + 1, y + 1, x + 1] = np.arange(total, dtype=np.int32)
    flat = number.reshape(-1)
    here = ((brick * 10 + z + 1) * 10 + y + 1) * 10 + x + 1
    first = np.full(total, -1, dtype=np.int64)
    second = first.copy()
    for dx, dy, dz in _BEFORE:
        candidate = flat[here + dz * 100 + dy * 10 + dx]
        known = candidate >= 0
        free = first < 0
        np.copyto(second, candidate, where=known & ~free & (second < 0))
        np.copyto(first, candidate, where=known & free)
    alone = np.where(rank > 0, np.arange(total) - 1, total)
    first = np.where(first < 0, alone, first)
    return first, np.where(second < 0, first, second)
