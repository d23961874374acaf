#!/usr/bin/python3
"""The volume against the ground truth meshes of the rendered sequences.

    tests/accuracy/volume.py [--kinevox-process PATH] [--voxel-mm 10] [--sequences walk,gesture,signal,sprint]

Runs `kinevox process` on each sequence and prints per sequence
  - the hull from perfect masks (truth/masks, four cameras): IoU with the mesh;
  - the hull from the silhouettes: fraction of the mesh's interior that it covers, IoU, litres;
  - the coloured volume: coverage, IoU, litres;
  - the mesh: litres.
sequences.py holds the bounds. Exit status 77 without the test data.
"""
import argparse
import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from session_data import Session, carve, data_folder, process_program

MARGIN_M = 0.4  # around the mesh


class Grid:
    """Cubic voxels aligned to multiples of their edge; arrays are [z, y, x]."""

    def __init__(self, low_m, high_m, voxel_m):
        self.voxel_m = voxel_m
        self.first = np.floor(np.asarray(low_m) / voxel_m).astype(int)
        self.size = np.ceil(np.asarray(high_m) / voxel_m).astype(int) - self.first


def voxelise(vertices, triangles, grid):
    """True where a voxel's centre is inside the closed mesh: signed crossings along z, so that overlapping parts of
    the mesh count once."""
    nx, ny, nz = grid.size
    winding = np.zeros((nx * ny, nz + 1), np.int32)
    points = vertices / grid.voxel_m - grid.first - 0.5 + 1e-4  # off the edges of a regular mesh
    corners = points[triangles]
    low = np.ceil(corners[:, :, :2].min(1)).astype(int)
    span = np.floor(corners[:, :, :2].max(1)).astype(int) - low + 1
    hit = (span > 0).all(1)
    corners, low, span = corners[hit], low[hit], span[hit]
    for dx in range(span[:, 0].max(initial=0)):
        for dy in range(span[:, 1].max(initial=0)):
            use = (span[:, 0] > dx) & (span[:, 1] > dy)
            x, y = low[use, 0] + dx, low[use, 1] + dy
            a = corners[use]

            def side(i, j):
                return (a[:, j, 0] - a[:, i, 0]) * (y - a[:, i, 1]) - (a[:, j, 1] - a[:, i, 1]) * (x - a[:, i, 0])

            w = np.stack([side(1, 2), side(2, 0), side(0, 1)], 1)
            area = w.sum(1)
            inside = ((w >= 0).all(1) | (w <= 0).all(1)) & (area != 0)
            inside &= (x >= 0) & (y >= 0) & (x < nx) & (y < ny)
            z = (w[inside] * a[inside, :, 2]).sum(1) / area[inside]
            at = np.clip(np.ceil(z), 0, nz).astype(int)
            np.add.at(winding, ((y * nx + x)[inside], at), np.sign(area[inside]).astype(np.int32))
    inside = np.cumsum(winding, axis=1)[:, :-1] != 0
    return inside.reshape(ny, nx, nz).transpose(2, 0, 1)


def perfect_hull(cameras, masks, grid):
    """Voxels whose centre is in the true mask of every camera that sees it."""
    x, y, z = ((np.arange(n) + 0.5) * grid.voxel_m for n in grid.size)
    corner = grid.first * grid.voxel_m
    layer = np.stack([*(axis.ravel() for axis in np.meshgrid(x, y)), np.zeros(len(x) * len(y))], 1) + corner
    hull = np.zeros((len(z), len(y) * len(x)), bool)
    for k, height in enumerate(z):
        inside, _ = carve(cameras, masks, layer + [0, 0, height])
        hull[k, inside] = True
    return hull.reshape(grid.size[::-1])


def read_points(file):
    """The x, y, z columns (n, 3) of a binary PLY of points."""
    header, _, body = Path(file).read_bytes().partition(b"end_header\n")
    types = {"float": "<f4", "double": "<f8", "uchar": "u1", "uint8": "u1", "float32": "<f4"}
    fields, count = [], 0
    for line in header.decode().splitlines():
        words = line.split()
        if words[:2] == ["element", "vertex"]:
            count = int(words[2])
        elif words and words[0] == "property":
            fields.append((words[2], types[words[1]]))
    points = np.frombuffer(body, np.dtype(fields), count)
    return np.stack([points[axis] for axis in "xyz"], 1).astype(float)


def solid(points, grid):
    """The solid whose surface voxels have these centres: the complement of a flood fill from outside."""
    shell = np.zeros(grid.size[::-1], bool)
    indices = np.floor(points / grid.voxel_m).astype(int) - grid.first
    if (indices < 1).any() or (indices >= grid.size - 1).any():
        raise ValueError("the volume leaves the grid")
    shell[tuple(indices[:, ::-1].T)] = True
    outside = np.zeros_like(shell)
    outside[0], outside[-1] = True, True
    outside[:, 0], outside[:, -1] = True, True
    outside[:, :, 0], outside[:, :, -1] = True, True
    free, filled = ~shell, 0
    while filled != (filled := int(outside.sum())):
        for axis in range(3):  # a step in each direction, and far ones by sweeping whole slices
            grown = np.moveaxis(outside, axis, 0)
            open_ = np.moveaxis(free, axis, 0)
            for k in range(1, len(grown)):
                grown[k] |= grown[k - 1] & open_[k]
            for k in range(len(grown) - 2, -1, -1):
                grown[k] |= grown[k + 1] & open_[k]
    return ~outside


def run(program, session, folder, voxel_mm, frames):
    options = ["--save", "volumes,hulls", "--voxel-mm", str(voxel_mm), "--frames", str(frames), "--quiet"]
    subprocess.run([program, session, "--out", folder, *options], check=True)


def lattice_offset(points, voxel_m):
    """Offset of the volume's lattice from multiples of the voxel's edge, as a fraction of it, 0..1."""
    return np.mod(points[:1] / voxel_m - 0.5 + 1e-3, 1)[0] - 1e-3


def compare(file, vertices, triangles, voxel_m):
    """(IoU, coverage, litres, litres of the mesh) of one saved volume or hull."""
    points = read_points(file)
    if len(points) == 0:
        return 0.0, 0.0, 0.0, float("nan")
    shift = lattice_offset(points, voxel_m) * voxel_m  # so that voxel centres coincide
    low = np.minimum(points.min(0), vertices.min(0)) - 3 * voxel_m
    high = np.maximum(points.max(0), vertices.max(0)) + 3 * voxel_m
    grid = Grid(low - shift, high - shift, voxel_m)
    volume = solid(points - shift, grid)
    mesh = voxelise(vertices - shift, triangles, grid)
    both, litre = (volume & mesh).sum(), (10 * voxel_m) ** 3
    return both / (volume | mesh).sum(), both / mesh.sum(), volume.sum() * litre, mesh.sum() * litre


FIELDS = (
    "perfect_hull_iou",
    "hull_iou",
    "hull_coverage",
    "hull_litres",
    "coloured_iou",
    "coloured_coverage",
    "coloured_litres",
    "mesh_litres",
)


def rows_of(session, results, voxel_m):
    """[(frame, values in the order of FIELDS)] of the frames with a mesh."""
    masks = [list(session.true_masks(camera)) for camera in session.cameras]
    rows = []
    for frame, vertices, triangles in session.true_meshes():
        grid = Grid(vertices.min(0) - MARGIN_M, vertices.max(0) + MARGIN_M, voxel_m)
        truth = voxelise(vertices, triangles, grid)
        hull = perfect_hull(session.cameras, [m[frame] for m in masks], grid)
        perfect = (hull & truth).sum() / (hull | truth).sum()
        rows.append(
            (
                frame,
                [
                    perfect,
                    *compare(results / "hulls" / f"{frame:06d}.ply", vertices, triangles, voxel_m)[:3],
                    *compare(results / "volumes" / f"{frame:06d}.ply", vertices, triangles, voxel_m),
                ],
            )
        )
    return rows


def judge(session, results, voxel_m=0.01):
    """Means over the frames with a mesh, by FIELDS."""
    return dict(zip(FIELDS, np.array([values for _, values in rows_of(session, results, voxel_m)]).mean(0)))


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinevox-process", type=Path, help="Program (default: the latest one built)")
    parser.add_argument("--voxel-mm", type=float, default=10)
    parser.add_argument("--sequences", default="walk,gesture,signal,sprint")
    parser.add_argument("--csv", type=Path, help="Also write one line per frame here")
    arguments = parser.parse_args()
    studio = data_folder() / "studio"
    if not studio.is_dir():
        print(f"skipped: the test data {studio} is not here; set KINEVOX_TEST_DATA to the folder that holds it")
        return 77
    program = arguments.kinevox_process or process_program()
    voxel_m = arguments.voxel_mm / 1000

    print(f"voxel edge {arguments.voxel_mm:g} mm, means over the frames with a mesh (worst frame in brackets)")
    print(
        f"{'sequence':9} {'perfect hull':>12} | {'hull: covers':>14} {'IoU':>6} {'litres':>7} | "
        f"{'coloured: covers':>17} {'IoU':>14} {'litres':>7} | {'mesh l':>7}"
    )
    lines = []
    for name in arguments.sequences.split(","):
        session = Session(studio / name / "session.toml")
        with tempfile.TemporaryDirectory() as scratch:
            results = Path(scratch) / "results"
            last = max(frame for frame, _, _ in session.true_meshes()) + 1
            run(program, session.file, results, arguments.voxel_mm, last)
            rows = rows_of(session, results, voxel_m)
        lines += [[name, frame] + [f"{value:.4f}" for value in values] for frame, values in rows]
        table = [values for _, values in rows]
        table = np.array(table)
        perfect, hull_iou, covers, hull_l, iou, kept, litres, mesh_l = table.mean(0)
        worst = table.min(0)
        print(
            f"{name:9} {perfect:12.3f} | {covers:6.3f} ({worst[2]:.3f}) {hull_iou:6.3f} {hull_l:7.1f} | "
            f"{kept:9.3f} ({worst[5]:.3f}) {iou:6.3f} ({worst[4]:.3f}) {litres:7.1f} | {mesh_l:7.1f}",
            flush=True,
        )
    if arguments.csv:
        with open(arguments.csv, "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["sequence", "frame", *FIELDS])
            writer.writerows(lines)
    return 0


if __name__ == "__main__":
    sys.exit(main())
