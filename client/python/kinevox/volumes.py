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
from kinevox.header import Header, only_subject
from kinevox.volume_codec import DamagedVolume, Decoded, decode

Floats = NDArray[np.float64]
_MAX_DENSE_VOXELS = 1 << 30


class Volume:
    """A coloured voxel volume.

    origin_m: (3,) corner with the smallest coordinates, world, m. voxel_m: edge, m. shape: voxels along x, y, z.
    colours: (m, 3) uint8 R G B, one per surface voxel in the order of surface_indices; None if they were omitted.

    """

    def __init__(self, data: bytes) -> None:
        """Decodes an encoded volume (docs/volume_format.md); InvalidArgument if it is damaged."""
        try:
            self._decoded: Decoded = decode(data)
        except DamagedVolume as error:
            raise InvalidArgument(f"volume: {error}; the bytes are damaged or not an encoded volume") from None
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
    def volume_litres(self) -> float:
        """Of the received voxels."""
        return self.voxel_count * self.voxel_m**3 * 1000

    def dense(self) -> NDArray[np.bool_]:
        """All voxels of the box, occupied or not: bool, `shape`, indexed [i, j, k]. InvalidArgument beyond 1 GB;
        use occupied_indices then."""
        nx, ny, nz = self.shape
        if nx * ny * nz > _MAX_DENSE_VOXELS:
            raise InvalidArgument(
                f"the volume's box has {nx} x {ny} x {nz} voxels, too many for one array; use " "occupied_indices"
            )
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
        return f"<Volume {self.volume_litres:.1f} litres in {self.voxel_count} voxels of {1000 * self.voxel_m:g} mm>"


@dataclass(frozen=True)
class SubjectVolume:
    """The volume of one subject.

    subject_id: 0 if no subject is tracked. volume: None without a subject. volume_litres: at the resolution of the
    capture, whatever was requested. encoded_bytes: on the wire. centre_m (3,), velocity_m_per_s (3,): world frame; None
    without a subject. used_cameras: names of the cameras with a consistent ray. name: of the subject; empty: none.
    """

    subject_id: int
    volume: Volume | None
    volume_litres: float
    encoded_bytes: int
    centre_m: Floats | None
    velocity_m_per_s: Floats | None
    used_cameras: tuple[str, ...] = ()
    name: str = ""

    @staticmethod
    def of(message: Any, sequence: int, server: str) -> "SubjectVolume":
        """From the daemon's message; DataLoss if it cannot be decoded."""
        volume = None
        if message.encoded_volume:
            try:
                volume = Volume(message.encoded_volume)
            except InvalidArgument as error:
                raise DataLoss(f"volume {sequence} from {server} cannot be decoded: {error}", server) from None
        subject = message.subject
        at, velocity = subject.centre_in_world, subject.velocity_in_world
        return SubjectVolume(
            subject.subject_id,
            volume,
            message.volume_litres,
            len(message.encoded_volume),
            np.array([at.x, at.y, at.z]),
            np.array([velocity.x, velocity.y, velocity.z]),
            tuple(subject.used_cameras),
            subject.name,
        )


_NO_SUBJECT = SubjectVolume(0, None, 0.0, 0, None, None)


@dataclass(frozen=True)
class VolumeFrame:
    """The volumes of one frame set: a message of Client.volumes().

    subjects: ordered by subject_id, empty while no subject is tracked. With at most one subject, volume, volume_litres
    and centre_m can be read from the frame itself; with several they raise FailedPrecondition.
    """

    header: Header
    subjects: tuple[SubjectVolume, ...]

    def subject(self, subject_id: int) -> SubjectVolume:
        """The volume of one subject; one without a volume if that subject is not tracked."""
        return next((subject for subject in self.subjects if subject.subject_id == subject_id), _NO_SUBJECT)

    @property
    def only(self) -> SubjectVolume:
        """The only subject's; one without a volume if there is no subject. FailedPrecondition if there are several."""
        return only_subject(self.subjects, [subject.subject_id for subject in self.subjects], _NO_SUBJECT)

    @property
    def volume(self) -> Volume | None:
        """Of the only subject; None while no subject is tracked."""
        return self.only.volume

    @property
    def volume_litres(self) -> float:
        """Of the only subject, at the resolution of the capture."""
        return self.only.volume_litres

    @property
    def centre_m(self) -> Floats | None:
        """Of the only subject, (3,), world frame; None while no subject is tracked."""
        return self.only.centre_m

    @staticmethod
    def of(message: Any, server: str) -> "VolumeFrame":
        """From the daemon's message; DataLoss if it cannot be decoded."""
        header = Header.of(message.header)
        subjects = tuple(SubjectVolume.of(subject, header.sequence, server) for subject in message.subjects)
        return VolumeFrame(header, subjects)
