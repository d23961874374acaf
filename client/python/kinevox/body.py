"""The subject's body, and the predefined poses that a lost body is looked for with."""
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from kinevox.calls import Call, StreamCall, nothing
from kinevox.capture import Service, enum_name
from kinevox.transport import START_TIMEOUT_S
from kinevox.v1 import pose_service_pb2 as pb


@dataclass(frozen=True)
class BodyState:
    """The body in use, and how far a fit is.

    state: none, collecting, fitting, ready or failed. part: 0 to 1. message: one line. stature_m; lengths_m, between
    rotation centres, half-widths and radii; girths_m, circumferences, clothes included: by body.toml's names, m.
    frames: that it was fitted to; 0: it is from a file or an adult of average build. raw: all of it, with standard
    deviations.
    """

    state: str
    part: float
    message: str
    stature_m: float
    lengths_m: dict[str, float]
    girths_m: dict[str, float]
    frames: int
    raw: Any = field(repr=False)

    @staticmethod
    def of(answer: Any, _: str = "") -> "BodyState":
        """From the daemon's message."""
        body = answer.body
        return BodyState(enum_name(pb.BodyFitState.DESCRIPTOR, answer.state, "BODY_FIT_STATE_"), answer.part,
                         answer.message, body.stature.value_m, {m.name: m.value_m for m in body.lengths},
                         {m.name: m.value_m for m in body.girths}, body.frames, answer)


@dataclass(frozen=True)
class DatabaseState:
    """state: none, building, ready, cancelled or failed. part: 0 to 1. entries: of the database that answers now."""

    state: str
    part: float
    entries: int
    message: str

    @staticmethod
    def of(answer: Any, _: str = "") -> "DatabaseState":
        """From the daemon's message."""
        return DatabaseState(enum_name(pb.DatabaseState.DESCRIPTOR, answer.state, "DATABASE_STATE_"), answer.part,
                             answer.entries, answer.message)


def body_call() -> StreamCall[BodyState]:
    """See Client.body_progress."""
    return StreamCall("PoseService/WatchBody", pb.WatchBodyRequest(), pb.WatchBodyResponse, BodyState.of)


def database_call() -> StreamCall[DatabaseState]:
    """See Client.database_progress."""
    return StreamCall("PoseService/WatchDatabase", pb.WatchDatabaseRequest(), pb.WatchDatabaseResponse,
                      DatabaseState.of)


class Body(Service):
    """client.body. Changes take control for the moment. Errors: InvalidArgument, FailedPrecondition, NotFound;
    Unavailable while the database is being built."""

    def fit(self, seconds: float = 0) -> None:
        """Begins to fit stature, lengths and girths to the person in the space, from the next 1 to 30 s, 0: 4;
        client.body_progress() tells the rest. A T-pose tells most."""
        return self._runner.run(Call("PoseService/FitBody", pb.FitBodyRequest(seconds=seconds), pb.FitBodyResponse,
                                     nothing, True))

    def poses(self) -> list[tuple[str, bool]]:
        """The database's poses: label, and whether a user added it."""
        return self._runner.run(Call("PoseService/ListPoses", pb.ListPosesRequest(), pb.ListPosesResponse,
                                     lambda answer: [(pose.label, pose.added) for pose in answer.poses]))

    def add_pose(self, label: str, coordinates_deg: Mapping[str, float] | None = None) -> int:
        """Adds a pose by kinevox.COORDINATE_NAMES, degrees, those not given 0; without any, the pose that was measured
        last. The database's entries."""
        return self._runner.run(Call("PoseService/AddPose",
                                     pb.AddPoseRequest(label=label, coordinates_deg=dict(coordinates_deg or {})),
                                     pb.AddPoseResponse, lambda answer: int(answer.entries), True, START_TIMEOUT_S))

    def remove_pose(self, label: str) -> int:
        """Takes out all poses of that label, the daemon's own, too. The database's entries."""
        return self._runner.run(Call("PoseService/RemovePose", pb.RemovePoseRequest(label=label), pb.RemovePoseResponse,
                                     lambda answer: int(answer.entries), True, START_TIMEOUT_S))

    def import_bvh(self, label: str, bvh: bytes, every_s: float = 0) -> int:
        """Adds the poses of a movement, one every so many seconds, 0.001 to 3600; 0: 0.1. How many were added."""
        return self._runner.run(Call("PoseService/ImportBvh",
                                     pb.ImportBvhRequest(label=label, bvh=bvh, every_s=every_s),
                                     pb.ImportBvhResponse, lambda answer: int(answer.poses), True, 600.0))
