"""The subject's body model and the state of the pose database."""
from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from kinevox.calls import Call, StreamCall, duration, nothing
from kinevox.capture import Service, enum_name
from kinevox.header import only_subject
from kinevox.v1 import pose_service_pb2 as pb


@dataclass(frozen=True)
class SubjectBody:
    """The active body of one subject and the progress of a fit.

    subject_id: 0 for the default body, before a subject is tracked. state: not_started, collecting, fitting, ready or
    failed. progress: 0 to 1. message: one line. stature_m; lengths_m, between rotation centres, half-widths and radii;
    girths_m, circumferences including clothes: by the names of body.toml, m. frame_set_count: used for the fit; 0: the
    body is from a file or of average build. raw: kinevox.v1.pose_service_pb2.SubjectBody, with standard deviations.
    """

    subject_id: int
    state: str
    progress: float
    message: str
    stature_m: float
    lengths_m: dict[str, float]
    girths_m: dict[str, float]
    frame_set_count: int
    raw: Any = field(repr=False)

    @staticmethod
    def of(subject: Any) -> "SubjectBody":
        """From the daemon's message."""
        body = subject.body
        return SubjectBody(
            subject.subject_id,
            enum_name(pb.BodyFitState.DESCRIPTOR, subject.state, "BODY_FIT_STATE_"),
            subject.progress,
            subject.message,
            body.stature.value_m,
            {m.name: m.value_m for m in body.lengths},
            {m.name: m.value_m for m in body.girths},
            body.frame_set_count,
            subject,
        )


@dataclass(frozen=True)
class BodyState:
    """A message of Client.body_progress(). subjects: ordered by subject_id."""

    subjects: tuple[SubjectBody, ...]

    @property
    def only(self) -> SubjectBody:
        """The body of the only subject. FailedPrecondition if there are several."""
        none = SubjectBody.of(pb.SubjectBody())
        return only_subject(self.subjects, [body.subject_id for body in self.subjects], none)

    @staticmethod
    def of(answer: Any, _: str = "") -> "BodyState":
        """From the daemon's message."""
        return BodyState(tuple(SubjectBody.of(subject) for subject in answer.subjects))


@dataclass(frozen=True)
class PoseDatabaseState:
    """state: not_started, building, ready, cancelled or failed. progress: of the build, 0 to 1. entry_count: of the
    database in use, during a rebuild of the previous one. message: one line."""

    state: str
    progress: float
    entry_count: int
    message: str

    @staticmethod
    def of(answer: Any, _: str = "") -> "PoseDatabaseState":
        """From the daemon's message."""
        state = enum_name(pb.PoseDatabaseState.DESCRIPTOR, answer.state, "POSE_DATABASE_STATE_")
        return PoseDatabaseState(state, answer.progress, answer.entry_count, answer.message)


def body_call() -> StreamCall[BodyState]:
    """See Client.body_progress."""
    return StreamCall("PoseService/WatchBody", pb.WatchBodyRequest(), pb.WatchBodyResponse, BodyState.of)


def database_call() -> StreamCall[PoseDatabaseState]:
    """See Client.database_progress."""
    return StreamCall(
        "PoseService/WatchPoseDatabase",
        pb.WatchPoseDatabaseRequest(),
        pb.WatchPoseDatabaseResponse,
        PoseDatabaseState.of,
    )


class Body(Service):
    """client.body: fits the body model to the subject."""

    def fit(self, duration_s: float = 0, subject_id: int = 0) -> None:
        """Starts to fit stature, lengths and girths to the subject; acquires control.

        duration_s: capture time with the subject in view, 1 to 30; 0: 4. A T-pose is best. subject_id: 0: the only one.
        Returns when the fit has started; client.body_progress() reports its progress. InvalidArgument,
        FailedPrecondition.
        """
        request = pb.FitBodyRequest(duration=duration(duration_s), subject_id=subject_id)
        return self._runner.run(Call("PoseService/FitBody", request, pb.FitBodyResponse, nothing, True))
