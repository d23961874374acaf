"""Replay of a recorded session instead of the cameras."""
from __future__ import annotations

import os
from dataclasses import dataclass
from typing import Any

from kinevox.calls import Call, nothing
from kinevox.capture import Service, enum_name
from kinevox.transport import START_TIMEOUT_S
from kinevox.v1 import replay_service_pb2 as pb


@dataclass(frozen=True)
class ReplayStatus:
    """The state of the replay.

    state: live (nothing is replayed), playing, paused, ended or stopped. session_path: of the session.toml on the
    server. frame: latest frame, from 0; None: none yet. position_s: time of that frame. speed: 1: as recorded.
    """

    state: str
    session_path: str
    frame: int | None
    frame_count: int
    position_s: float
    nominal_fps: float
    speed: float
    loop: bool

    @staticmethod
    def of(answer: Any) -> "ReplayStatus":
        """From the daemon's answer."""
        replay = answer.replay
        return ReplayStatus(
            enum_name(pb.ReplayState.DESCRIPTOR, replay.state, "REPLAY_STATE_"),
            replay.session_path,
            replay.frame if replay.HasField("frame") else None,
            replay.frame_count,
            replay.position_s,
            replay.nominal_fps,
            replay.speed,
            replay.loop,
        )


class Replay(Service):
    """client.replay. Changes acquire control. Errors: FailedPrecondition if nothing is replayed or another client holds
    control; OutOfRange for a frame or speed that does not exist."""

    def open(
        self, session: str | os.PathLike[str], paused: bool = False, loop: bool = False, speed: float = 1
    ) -> ReplayStatus:
        """Replays a session; returns when its first frame set may arrive.

        session: a recording's name, or the absolute path of a session.toml on the server. speed: 0.01 to 100, 1: as
        recorded. NotFound, PermissionDenied (outside the configured folders), DataLoss.
        """
        path = os.fspath(session)
        request = pb.OpenReplayRequest(paused=paused, loop=loop, speed=speed)
        if "/" in path:
            request.session_path = path
        else:
            request.recording_name = path
        return self._runner.run(
            Call("ReplayService/OpenReplay", request, pb.OpenReplayResponse, ReplayStatus.of, True, START_TIMEOUT_S)
        )

    def close(self) -> None:
        """Returns to the cameras."""
        return self._runner.run(
            Call(
                "ReplayService/CloseReplay",
                pb.CloseReplayRequest(),
                pb.CloseReplayResponse,
                nothing,
                True,
                START_TIMEOUT_S,
            )
        )

    def status(self) -> ReplayStatus:
        """The state of the replay. Cheap."""
        return self._runner.run(
            Call("ReplayService/GetReplay", pb.GetReplayRequest(), pb.GetReplayResponse, ReplayStatus.of)
        )

    def _update(self, request: pb.UpdateReplayRequest) -> ReplayStatus:
        return self._runner.run(
            Call("ReplayService/UpdateReplay", request, pb.UpdateReplayResponse, ReplayStatus.of, True)
        )

    def play(self) -> ReplayStatus:
        """Continues; at the end, from the beginning."""
        return self._update(pb.UpdateReplayRequest(playing=True))

    def pause(self) -> ReplayStatus:
        """Pauses."""
        return self._update(pb.UpdateReplayRequest(playing=False))

    def step(self, frames: int = 1) -> ReplayStatus:
        """Moves by a number of frames (negative: backwards) and pauses."""
        return self._update(pb.UpdateReplayRequest(step_frames=frames))

    def seek(self, frame: int | None = None, position_s: float | None = None) -> ReplayStatus:
        """Moves to a frame, from 0, or to the frame closest to a time; give one of them."""
        if (frame is None) == (position_s is None):
            raise ValueError("give frame or position_s, one of them")
        return self._update(pb.UpdateReplayRequest(frame=frame, position_s=position_s))  # None leaves a field unset

    def set_speed(self, speed: float) -> ReplayStatus:
        """0.01 to 100, 1: as recorded. Frame sets are skipped if the pipeline is slower."""
        return self._update(pb.UpdateReplayRequest(speed=speed))

    def set_loop(self, loop: bool) -> ReplayStatus:
        """Whether playback restarts at the end."""
        return self._update(pb.UpdateReplayRequest(loop=loop))
