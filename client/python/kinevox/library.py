"""The poses of the pose database, from which the daemon starts the pose of a subject who is not tracked yet."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from kinevox.calls import Call, duration
from kinevox.capture import Service
from kinevox.transport import START_TIMEOUT_S
from kinevox.v1 import pose_service_pb2 as pb

IMPORT_TIMEOUT_S = 600.0


@dataclass(frozen=True)
class LibraryPose:
    """A pose of the database. user_defined: False for the built-in ones."""

    label: str
    user_defined: bool


class PoseLibrary(Service):
    """Methods of client.poses. Changes acquire control. Errors: InvalidArgument, FailedPrecondition, NotFound;
    Unavailable while the database is being built."""

    def list(self) -> list[LibraryPose]:
        """All poses of the database."""
        return self._runner.run(
            Call(
                "PoseService/ListLibraryPoses",
                pb.ListLibraryPosesRequest(),
                pb.ListLibraryPosesResponse,
                lambda answer: [LibraryPose(pose.label, pose.user_defined) for pose in answer.poses],
            )
        )

    def add(self, label: str, coordinates_deg: Mapping[str, float] | None = None, subject_id: int = 0) -> int:
        """Adds a pose; returns the number of entries in the database.

        coordinates_deg: by kinevox.COORDINATE_NAMES, degrees; missing ones are 0. None: the latest measured pose of
        subject_id (0: of the only subject).
        """
        request = pb.AddLibraryPoseRequest(
            label=label, coordinates_deg=dict(coordinates_deg or {}), subject_id=subject_id
        )
        return self._runner.run(
            Call(
                "PoseService/AddLibraryPose",
                request,
                pb.AddLibraryPoseResponse,
                lambda answer: int(answer.entry_count),
                True,
                START_TIMEOUT_S,
            )
        )

    def delete(self, label: str) -> int:
        """Deletes all poses with a label, built-in ones included; returns the number of entries in the database."""
        return self._runner.run(
            Call(
                "PoseService/DeleteLibraryPose",
                pb.DeleteLibraryPoseRequest(label=label),
                pb.DeleteLibraryPoseResponse,
                lambda answer: int(answer.entry_count),
                True,
                START_TIMEOUT_S,
            )
        )

    def import_bvh(self, label: str, data: bytes, interval_s: float = 0) -> int:
        """Adds the poses of a BVH file, one per interval_s (0.001 to 3600; 0: 0.1); returns how many were added."""
        request = pb.ImportLibraryPosesRequest(label=label, data=data, interval=duration(interval_s, "interval_s"))
        return self._runner.run(
            Call(
                "PoseService/ImportLibraryPoses",
                request,
                pb.ImportLibraryPosesResponse,
                lambda answer: int(answer.pose_count),
                True,
                IMPORT_TIMEOUT_S,
            )
        )
