"""A recorded session in the place of the cameras."""
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
    """state: live (nothing is replayed), playing, paused, ended or stopped. session: its file on the daemon's machine.
    frame: shown last, from 0; -1: none yet. frames: of the recording. position_s: of that frame. speed: times the
    recording's own."""

    state: str
    session: str
    frame: int
    frames: int
    position_s: float
    fps: float
    speed: float
    loop: bool

    @staticmethod
    def of(answer: Any) -> "ReplayStatus":
        """From the daemon's answer."""
        replay = answer.replay
        return ReplayStatus(enum_name(pb.ReplayState.DESCRIPTOR, replay.state, "REPLAY_STATE_"), replay.session,
                            replay.frame,
                            replay.frames, replay.position_s, replay.fps, replay.speed, replay.loop)


class Replay(Service):
    """client.replay. Changes take control for the moment. Errors: FailedPrecondition where nothing is replayed or
    somebody else holds control; OutOfRange for a frame or speed that there is not."""

    def open(self, session: str | os.PathLike[str], paused: bool = False, loop: bool = False,
             speed: float = 1) -> ReplayStatus:
        """Plays a session in the cameras' place; returns when its first frame set may come. session: absolute path of a
        session.toml on the daemon's machine. speed: times its own, 0.01 to 100. NotFound, DataLoss."""
        request = pb.OpenReplayRequest(session=os.fspath(session), paused=paused, loop=loop, speed=speed)
        return self._runner.run(Call("ReplayService/OpenReplay", request, pb.OpenReplayResponse, ReplayStatus.of, True,
                                     START_TIMEOUT_S))

    def close(self) -> None:
        """Back to the cameras."""
        return self._runner.run(Call("ReplayService/CloseReplay", pb.CloseReplayRequest(), pb.CloseReplayResponse,
                                     nothing,
                                     True, START_TIMEOUT_S))

    def status(self) -> ReplayStatus:
        """Where the replay is. Cheap."""
        return self._runner.run(Call("ReplayService/GetReplay", pb.GetReplayRequest(), pb.GetReplayResponse,
                                     ReplayStatus.of))

    def _set(self, request: pb.SetReplayRequest) -> ReplayStatus:
        return self._runner.run(Call("ReplayService/SetReplay", request, pb.SetReplayResponse, ReplayStatus.of, True))

    def play(self) -> ReplayStatus:
        """Goes on; behind the end, from the beginning."""
        return self._set(pb.SetReplayRequest(play=True))

    def pause(self) -> ReplayStatus:
        """Stands still."""
        return self._set(pb.SetReplayRequest(play=False))

    def step(self, frames: int = 1) -> ReplayStatus:
        """So many frames on, or back where negative, and stands still there."""
        return self._set(pb.SetReplayRequest(step=frames))

    def seek(self, frame: int | None = None, position_s: float | None = None) -> ReplayStatus:
        """To a frame, from 0, or to the frame nearest to a position, s: give one of them."""
        if (frame is None) == (position_s is None):
            raise ValueError("give frame or position_s, one of them")
        request = pb.SetReplayRequest(frame=frame, position_s=position_s)   # None sets nothing
        return self._set(request)

    def set_speed(self, speed: float) -> ReplayStatus:
        """Times the recording's own, 0.01 to 100. What the pipeline cannot follow is left out."""
        return self._set(pb.SetReplayRequest(speed=speed))

    def set_loop(self, loop: bool) -> ReplayStatus:
        """Whether it begins anew behind the end."""
        return self._set(pb.SetReplayRequest(loop=loop))
