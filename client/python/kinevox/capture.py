"""The capture: its state, cameras, events and control."""
from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinevox.calls import Call, Runner, nothing
from kinevox.header import STAGES
from kinevox.transport import START_TIMEOUT_S
from kinevox.v1 import capture_service_pb2 as pb

Floats = NDArray[np.float64]


def enum_name(enum: Any, value: int, prefix: str) -> str:
    """ "running" for CAPTURE_STATE_RUNNING; "unknown" for values of a newer daemon."""
    known = enum.values_by_number.get(value)
    return str(known.name).removeprefix(prefix).lower() if known is not None else "unknown"


@dataclass(frozen=True)
class Camera:
    """A calibrated camera: OpenCV's pinhole with distortion, the first pixel's centre at (0, 0).

    size_px: width, height. matrix: (3, 3) of fx, fy, cx, cy, px. distortion: k1 k2 p1 p2 k3. rotation_camera_from_world
    (3, 3) and translation_camera_from_world (3,), m: x_camera = R x_world + t, camera axes x right, y down, z forward.

    """

    name: str
    size_px: tuple[int, int]
    matrix: Floats
    distortion: Floats
    rotation_camera_from_world: Floats
    translation_camera_from_world: Floats

    @property
    def centre_in_world(self) -> Floats:
        """(3,), m."""
        centre: Floats = -self.rotation_camera_from_world.T @ self.translation_camera_from_world
        return centre

    def project(self, points_in_world: Floats) -> Floats:
        """Pixels (n, 2) of points (n, 3), m; NaN behind the camera."""
        points = np.atleast_2d(points_in_world) @ self.rotation_camera_from_world.T + self.translation_camera_from_world
        with np.errstate(divide="ignore", invalid="ignore"):
            x, y = (np.where(points[:, 2] > 0, points[:, k] / points[:, 2], np.nan) for k in (0, 1))
        k1, k2, p1, p2, k3 = np.append(self.distortion, np.zeros(5))[:5]
        r2 = x * x + y * y
        radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
        seen_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
        seen_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
        (fx, _, cx), (_, fy, cy), _ = self.matrix
        return np.stack([fx * seen_x + cx, fy * seen_y + cy], axis=1)

    @staticmethod
    def of(camera: Any) -> "Camera":
        """From the daemon's message."""
        t = camera.translation_camera_from_world
        return Camera(
            camera.name,
            (camera.width_px, camera.height_px),
            np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]]),
            np.array(camera.distortion, dtype=float),
            np.array(camera.rotation_camera_from_world, dtype=float).reshape(3, 3),
            np.array([t.x, t.y, t.z]),
        )


@dataclass(frozen=True)
class SubjectStatus:
    """One tracked subject. centre_m, (3,): world frame, with centre_std_m along one axis. volume_litres: of its volume.
    name: empty: none."""

    subject_id: int
    centre_m: Floats
    centre_std_m: float
    pose_found: bool
    volume_litres: float
    name: str = ""

    @staticmethod
    def of(status: Any) -> "SubjectStatus":
        """From the daemon's message."""
        subject, at = status.subject, status.subject.centre_in_world
        centre = np.array([at.x, at.y, at.z])
        return SubjectStatus(
            subject.subject_id,
            centre,
            subject.centre_std_m,
            status.pose_found,
            status.volume.volume_litres,
            subject.name,
        )


@dataclass(frozen=True)
class ListedSubject:
    """A person in the scene, or one who left and may return.

    name: empty: none. following: followed, ignored, outside, too_many or absent. centre_m: (3,), world frame; if absent,
    the last one. height_m: of the highest part above the floor; if absent, the median. absent_s: 0 while present.
    """

    subject_id: int
    name: str
    following: str
    centre_m: Floats
    height_m: float
    absent_s: float

    @staticmethod
    def of(subject: Any) -> "ListedSubject":
        """From the daemon's message."""
        at = subject.centre_in_world
        return ListedSubject(
            subject.subject_id,
            subject.name,
            enum_name(pb.SubjectFollowing.DESCRIPTOR, subject.following, "SUBJECT_FOLLOWING_"),
            np.array([at.x, at.y, at.z]),
            subject.height_m,
            subject.absent_duration.ToNanoseconds() / 1e9,
        )


@dataclass(frozen=True)
class Status:
    """The state of the daemon.

    state: stopped, starting, running, learning_background, source_ended or failed; state_message: one line. nominal_fps:
    frame sets per second; result_rate_hz: results per second, over the last two seconds; result_count,
    lost_frame_set_count: since the last start. median_stage_times_ms: over the last 128 results, by
    kinevox.header.STAGES. operator_name: holder of control, empty if control is free. message:
    kinevox.v1.capture_service_pb2.GetStatusResponse.
    """

    version: str
    state: str
    state_message: str
    source: str
    nominal_fps: float
    result_rate_hz: float
    result_count: int
    lost_frame_set_count: int
    subjects: tuple[SubjectStatus, ...]
    median_stage_times_ms: dict[str, float]
    operator_name: str
    message: Any = field(repr=False)

    @staticmethod
    def of(status: Any) -> "Status":
        """From the daemon's message."""
        return Status(
            status.version,
            enum_name(pb.CaptureState.DESCRIPTOR, status.state, "CAPTURE_STATE_"),
            status.state_message,
            status.source,
            status.nominal_fps,
            status.result_rate_hz,
            status.result_count,
            status.lost_frame_set_count,
            tuple(SubjectStatus.of(subject) for subject in status.subjects),
            {stage: getattr(status.median_stage_times, stage) for stage in STAGES},
            status.control_lease.operator_name,
            status,
        )


@dataclass(frozen=True)
class Event:
    """An event of the daemon.

    kind: "subject_found", "recording_started", ... (EventKind of the API). event_time_ns: UTC. sequence: of the frame
    set it belongs to; 0: none. camera: empty if no camera is concerned. subject_id: 0 if no subject is concerned.
    message: one line. missed_count: events dropped just before this one because the client is slow.
    """

    event_id: int
    kind: str
    event_time_ns: int
    sequence: int
    camera: str
    subject_id: int
    message: str
    missed_count: int

    @staticmethod
    def of(answer: Any, _: str = "") -> "Event":
        """From the daemon's message."""
        event = answer.event
        return Event(
            event.event_id,
            enum_name(pb.EventKind.DESCRIPTOR, event.kind, "EVENT_KIND_"),
            event.event_time.ToNanoseconds(),
            event.sequence,
            event.camera,
            event.subject_id,
            event.message,
            answer.missed_count,
        )


class Service:
    """Part of a client. Its methods only describe calls, which `runner` carries out, so that the asynchronous client
    uses the same."""

    def __init__(self, runner: Runner) -> None:
        self._runner = runner


class Capture(Service):
    """Status, cameras, start and stop: methods of Client, too. Changes acquire control."""

    def status(self) -> Status:
        """The state of the daemon. Cheap. Unavailable."""
        return self._runner.run(
            Call("CaptureService/GetStatus", pb.GetStatusRequest(), pb.GetStatusResponse, Status.of)
        )

    def cameras(self) -> list[Camera]:
        """The cameras with their calibration, in the order of the frame set. Unavailable."""
        return self._runner.run(
            Call(
                "CaptureService/ListCameras",
                pb.ListCamerasRequest(),
                pb.ListCamerasResponse,
                lambda answer: [Camera.of(camera) for camera in answer.cameras],
            )
        )

    def start(self) -> None:
        """Starts the capture; a recorded source that has ended starts from its beginning. FailedPrecondition."""
        return self._runner.run(
            Call(
                "CaptureService/StartCapture",
                pb.StartCaptureRequest(),
                pb.StartCaptureResponse,
                nothing,
                True,
                START_TIMEOUT_S,
            )
        )

    def stop(self) -> None:
        """Stops the capture; streams stay open. FailedPrecondition."""
        return self._runner.run(
            Call(
                "CaptureService/StopCapture",
                pb.StopCaptureRequest(),
                pb.StopCaptureResponse,
                nothing,
                True,
                START_TIMEOUT_S,
            )
        )

    def learn_background(
        self, frame_set_count: int = 0, timeout_s: float = START_TIMEOUT_S, force: bool = False
    ) -> None:
        """Relearns the background; returns when it is learned.

        frame_set_count: live frame sets to learn from, 1 to 1000, with the scene empty; 0: the source's own background
        clip. force: even while a subject is tracked. InvalidArgument, FailedPrecondition.
        """
        return self._runner.run(
            Call(
                "CaptureService/LearnBackground",
                pb.LearnBackgroundRequest(frame_set_count=frame_set_count, force=force),
                pb.LearnBackgroundResponse,
                nothing,
                True,
                timeout_s,
            )
        )

    def subjects(self) -> list[ListedSubject]:
        """Everybody who is tracked, followed or not, by id."""
        return self._runner.run(
            Call(
                "CaptureService/ListSubjects",
                pb.ListSubjectsRequest(),
                pb.ListSubjectsResponse,
                lambda answer: [ListedSubject.of(subject) for subject in answer.subjects],
            )
        )

    def select_subjects(self, follow: Iterable[int] = (), ignore: Iterable[int] = ()) -> None:
        """Chooses who is followed, from the next frame set until the track is reset.

        follow: only these ids, wherever they are. ignore: not these, others as before. Neither: whom the configuration
        selects. NotFound names the ids there are; InvalidArgument for both, or more than max_subjects.
        """
        followed, ignored = list(follow), list(ignore)
        return self._runner.run(
            Call(
                "CaptureService/SelectSubjects",
                pb.SelectSubjectsRequest(
                    followed_ids=followed, ignored_ids=ignored, follow_all=not followed and not ignored
                ),
                pb.SelectSubjectsResponse,
                nothing,
                True,
            )
        )

    def name_subject(self, subject_id: int, name: str) -> None:
        """Gives a subject a name, which lists, status, volumes, poses and recordings contain; "" removes it. NotFound, InvalidArgument."""
        return self._runner.run(
            Call(
                "CaptureService/NameSubject",
                pb.NameSubjectRequest(subject_id=subject_id, name=name),
                pb.NameSubjectResponse,
                nothing,
                True,
            )
        )
