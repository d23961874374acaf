"""The coloured volume as arrays.

World frame: metres, right-handed, z up, origin on the floor. Voxel (i, j, k) spans origin + voxel_m * [i, i+1) x [j,
j+1) x [k, k+1).
"""
from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinevox.errors import DataLoss, InvalidArgument
from kinevox.header import Header
from kinevox.volume_codec import DamagedVolume, Decoded, decode

Floats = NDArray[np.float64]
_MOST_DENSE = 1 << 30


class Volume:
    """A person in voxels.

    origin_m: (3,) corner with the smallest coordinates, world, m. voxel_m: edge, m. shape: voxels along x, y, z.
    colours: (m, 3) uint8 R G B, one a surface voxel in the order of surface_indices; None where none were sent.

    """

    def __init__(self, data: bytes) -> None:
        """From the bytes of one message; InvalidArgument where they are damaged."""
        try:
            self._decoded: Decoded = decode(data)
        except DamagedVolume as error:
            raise InvalidArgument(f"volume: {error}; the bytes are damaged or no volume") from None
        self.origin_m: Floats = self._decoded.origin_m
        self.voxel_m: float = self._decoded.voxel_m
        x, y, z = self._decoded.bricks_per_axis
        self.shape: tuple[int, int, int] = (8 * x, 8 * y, 8 * z)
        self.colours: NDArray[np.uint8] | None = self._decoded.colours

    @property
    def voxel_count(self) -> int:
        """Occupied voxels."""
        return int(np.count_nonzero(self._decoded.occupancy))

    @property
    def litres(self) -> float:
        """Of the voxels that were sent."""
        return self.voxel_count * self.voxel_m ** 3 * 1000

    def dense(self) -> NDArray[np.bool_]:
        """All voxels of the box, occupied or not: bool, `shape`, indexed [i, j, k]. InvalidArgument where it would take
        more than 1 GB; take occupied_indices then."""
        nx, ny, nz = self.shape
        if nx * ny * nz > _MOST_DENSE:
            raise InvalidArgument(f"the volume's box has {nx} x {ny} x {nz} voxels, too many for one array; take "
                                  "occupied_indices")
        grid = np.zeros((nx // 8, ny // 8, nz // 8, 8, 8, 8), dtype=bool)
        bx, by, bz = self._decoded.bricks.T
        grid[bx, by, bz] = self._decoded.occupancy.transpose(0, 3, 2, 1)
        return grid.transpose(0, 3, 1, 4, 2, 5).reshape(self.shape)

    def _indices(self, marked: NDArray[np.bool_]) -> NDArray[np.int64]:
        brick, z, y, x = np.nonzero(marked)
        indices: NDArray[np.int64] = 8 * self._decoded.bricks[brick] + np.stack([x, y, z], axis=1)
        return indices

    @cached_property
    def occupied_indices(self) -> NDArray[np.int64]:
        """(n, 3) i, j, k of the occupied voxels."""
        return self._indices(self._decoded.occupancy)

    @cached_property
    def surface_indices(self) -> NDArray[np.int64]:
        """(m, 3) i, j, k of the occupied voxels with an empty one among their six neighbours, as in colours."""
        return self._indices(self._decoded.surface)

    @cached_property
    def surface_points_m(self) -> Floats:
        """(m, 3) centres of the surface voxels, world, m."""
        points: Floats = self.origin_m + self.voxel_m * (self.surface_indices + 0.5)
        return points

    def __repr__(self) -> str:
        return f"<Volume {self.litres:.1f} litres in {self.voxel_count} voxels of {1000 * self.voxel_m:g} mm>"


@dataclass(frozen=True)
class VolumeFrame:
    """One message of the stream of volumes.

    volume: None while nobody is tracked. litres: at the capture's own resolution, whatever was asked for. bytes: on the
    wire. centre_m, velocity_m_s: (3,) of the subject, world; None while nobody is tracked.

    """

    header: Header
    volume: Volume | None
    litres: float
    bytes: int
    centre_m: Floats | None
    velocity_m_s: Floats | None

    @staticmethod
    def of(message: Any, server: str) -> "VolumeFrame":
        """From the daemon's message; DataLoss where it cannot be decoded."""
        volume = None
        if message.volume:
            try:
                volume = Volume(message.volume)
            except InvalidArgument as error:
                raise DataLoss(f"volume {message.header.sequence} from {server} cannot be decoded: {error}",
                               server) from None
        centre = velocity = None
        if message.HasField("subject"):
            at, speed = message.subject.centre_in_world, message.subject.velocity_in_world
            centre, velocity = np.array([at.x, at.y, at.z]), np.array([speed.x, speed.y, speed.z])
        return VolumeFrame(Header.of(message.header), volume, message.litres, len(message.volume), centre, velocity)
