"""The capture: what runs, with which cameras, and who may change that."""
from __future__ import annotations

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
    """"running" of CAPTURE_STATE_RUNNING; "unknown" of what this version does not know."""
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
        return Camera(camera.name, (camera.width_px, camera.height_px),
                      np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]]),
                      np.array(camera.distortion, dtype=float),
                      np.array(camera.rotation_camera_from_world, dtype=float).reshape(3, 3), np.array([t.x, t.y, t.z]))


@dataclass(frozen=True)
class Status:
    """What the daemon does.

    state: stopped, starting, running, learning, ended or failed, with one line for people in state_message. fps:
    nominal frame sets a second; results_per_second: of the last two seconds; results, lost: frame sets since the last
    start. median_times_ms: of the last 128 results, by kinevox.header.STAGES. control: who holds control, empty:
    nobody. message: all of it, kinevox.v1.capture_service_pb2.GetStatusResponse.
    """

    version: str
    state: str
    state_message: str
    source: str
    fps: float
    results_per_second: float
    results: int
    lost: int
    tracked: bool
    median_times_ms: dict[str, float]
    control: str
    message: Any = field(repr=False)

    @staticmethod
    def of(status: Any) -> "Status":
        """From the daemon's message."""
        return Status(status.version, enum_name(pb.CaptureState.DESCRIPTOR, status.state, "CAPTURE_STATE_"),
                      status.state_message,
                      status.source, status.source_fps, status.results_per_second, status.results, status.lost,
                      status.HasField("subject"), {stage: getattr(status.median_times, stage) for stage in STAGES},
                      status.control.holder, status)


@dataclass(frozen=True)
class Event:
    """Something that happened. kind: "subject_found", "recording_started", ... (EventKind in the API). time_ns: UTC.
    sequence: of the frame set it belongs to, 0: of none. camera: empty where none is concerned. message: one line for
    people. missed: events that were dropped just before, because the reader was slow."""

    number: int
    kind: str
    time_ns: int
    sequence: int
    camera: str
    message: str
    missed: int

    @staticmethod
    def of(event: Any, _: str = "") -> "Event":
        """From the daemon's message."""
        return Event(event.event_number, enum_name(pb.EventKind.DESCRIPTOR, event.kind, "EVENT_KIND_"), event.time_ns,
                     event.sequence, event.camera, event.message, event.missed)


class Service:
    """Part of a client: carries calls out by `runner`. Its methods only describe calls, so that the asynchronous
    client can use the same."""

    def __init__(self, runner: Runner) -> None:
        self._runner = runner


class Capture(Service):
    """Status, cameras, start and stop; Client has these methods, too. Changes take control for the moment."""

    def status(self) -> Status:
        """What the daemon does now. Cheap. Unavailable."""
        return self._runner.run(Call("CaptureService/GetStatus", pb.GetStatusRequest(), pb.GetStatusResponse,
                                     Status.of))

    def cameras(self) -> list[Camera]:
        """The cameras with their calibration, in the order of the frame set. Unavailable."""
        return self._runner.run(Call("CaptureService/ListCameras", pb.ListCamerasRequest(), pb.ListCamerasResponse,
                                     lambda answer: [Camera.of(camera) for camera in answer.cameras]))

    def start(self) -> None:
        """Starts capturing; a recording that has ended starts from its beginning. FailedPrecondition."""
        return self._runner.run(Call("CaptureService/Start", pb.StartRequest(), pb.StartResponse, nothing, True,
                                     START_TIMEOUT_S))

    def stop(self) -> None:
        """Stops capturing; streams stay open. FailedPrecondition."""
        return self._runner.run(Call("CaptureService/Stop", pb.StopRequest(), pb.StopResponse, nothing, True,
                                     START_TIMEOUT_S))

    def learn_background(self, frames: int = 0, timeout_s: float = START_TIMEOUT_S) -> None:
        """Learns the background anew from so many live frame sets, 1 to 1000, while the scene is empty; 0: from the
        source's own clip. Returns when it is learned. InvalidArgument, FailedPrecondition."""
        return self._runner.run(Call("CaptureService/LearnBackground", pb.LearnBackgroundRequest(frames=frames),
                                     pb.LearnBackgroundResponse, nothing, True, timeout_s))
