"""The blocking client of a Kinevox daemon."""
from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import grpc

from kinevox import requests
from kinevox.body import Body, BodyState, DatabaseState, body_call, database_call
from kinevox.calibration import Calibrations, Procedure, progress_call
from kinevox.calls import StreamCall, acquire, release
from kinevox.capture import Capture, Event
from kinevox.errors import KinevoxError
from kinevox.export_files import ExportFiles, OnProgress
from kinevox.poses import Pose
from kinevox.recordings import Format, Recordings, export_call
from kinevox.replay import Replay
from kinevox.requests import Delivery, Preview
from kinevox.streams import OnReconnect, Stream
from kinevox.transport import Options, Transport
from kinevox.volumes import VolumeFrame

T = TypeVar("T")


class Client(Capture):
    """A Kinevox daemon. `for pose in Client("host:50770").poses(): pose.angles["knee_angle_r"]`

    recordings, replay, calibrations, body: what else it does. Any thread may use it; a stream is for one thread. A
    context manager; close() ends its streams.
    """

    def __init__(self, server: str = "", *, timeout_s: float = 5.0, operator: str = "",
                 credentials: grpc.ChannelCredentials | None = None, token: str | None = None,
                 server_name: str | None = None) -> None:
        """Connects when it is first used, so that an unreachable daemon is told by the first call.

        server: "host:port"; empty: the environment's KINEVOX_SERVER, else 127.0.0.1:50770. timeout_s: of a call, the
        connection included. operator: whom others read about while this program holds control.

        For a daemon beyond this machine, which asks for TLS and a token (docs/access.md): credentials, for instance
        grpc.ssl_channel_credentials(Path("ca.pem").read_bytes()); server_name, the name in its certificate where that
        is not the address; token, sent as "authorization: Bearer TOKEN" with every call.
        """
        self._transport = Transport(Options(server, timeout_s, operator, credentials, token, server_name))
        super().__init__(self._transport)
        self.recordings = Recordings(self._transport)
        self.replay = Replay(self._transport)
        self.calibrations = Calibrations(self._transport)
        self.body = Body(self._transport)

    @property
    def server(self) -> str:
        """"host:port"."""
        return self._transport.options.server

    def poses(self, delivery: Delivery | None = None, max_rate_hz: float = 0, *, reconnect: bool = False,
              silence_s: float | None = None, on_reconnect: OnReconnect | None = None) -> Stream[Pose]:
        """Poses as they are measured, one for each frame set.

        delivery: "all", every result in order: the daemon queues 256 for a slow reader and then ends the stream with
        ResourceExhausted; "latest", a slow reader gets the newest, and pose.missed says how many he did not. The
        default is "all" unless max_rate_hz, messages a second at most, is given, which goes with "latest" alone.
        reconnect: connects again, with growing pauses up to 5 s, when the daemon goes away; what was measured
        meanwhile is lost; on_reconnect is told why. Else that is Unavailable. silence_s: DeadlineExceeded after so
        long without a message; None waits for ever.
        """
        return self._stream(requests.poses(delivery, max_rate_hz), reconnect, silence_s, on_reconnect)

    def volumes(self, delivery: Delivery | None = None, max_rate_hz: float = 0, *, max_voxel_m: float | None = None,
                level: int | None = None, colours: bool = True, reconnect: bool = False, silence_s: float | None = None,
                on_reconnect: OnReconnect | None = None) -> Stream[VolumeFrame]:
        """Coloured volumes as they are carved.

        max_voxel_m: voxels of at most this edge, m, halving the resolution as long as that holds; level: so many
        halvings, 0 to 5; neither: full resolution. colours=False: a fifth of the bytes. delivery: as in poses(), but
        "latest" is the default. Else as poses().
        """
        return self._stream(requests.volumes(delivery, max_rate_hz, max_voxel_m, level, colours), reconnect, silence_s,
                            on_reconnect)

    def previews(self, camera: str, *, silhouette: bool = False, max_width_px: int = 0, max_height_px: int = 0,
                 jpeg_quality: int = 0, max_rate_hz: float = 0, reconnect: bool = False, silence_s: float | None = None,
                 on_reconnect: OnReconnect | None = None) -> Stream[Preview]:
        """Small pictures of one camera, the newest only.

        silhouette: the sharp one white, what only the loose one has grey. 0 for a size, 1 to 100 for jpeg_quality or a
        rate takes the daemon's default: 320 px wide, 80, ten a second. NotFound lists the cameras. Else as poses().

        """
        call = requests.previews(camera, silhouette, max_width_px, max_height_px, jpeg_quality, max_rate_hz)
        return self._stream(call, reconnect, silence_s, on_reconnect)

    def events(self, past: int = 0, *, reconnect: bool = False, silence_s: float | None = None,
               on_reconnect: OnReconnect | None = None) -> Stream[Event]:
        """Events as they happen, after the newest `past` ones from before, 0 to 100. Else as poses()."""
        return self._stream(requests.events(past), reconnect, silence_s, on_reconnect)

    def calibration_progress(self, silence_s: float | None = None) -> Stream[Procedure]:
        """The calibration procedure now and whenever it changes; see Calibrations."""
        return self._stream(progress_call(), False, silence_s, None)

    def body_progress(self, silence_s: float | None = None) -> Stream[BodyState]:
        """The body in use and how far a fit is, now and whenever that changes."""
        return self._stream(body_call(), False, silence_s, None)

    def database_progress(self, silence_s: float | None = None) -> Stream[DatabaseState]:
        """The pose database's state, now and whenever it changes."""
        return self._stream(database_call(), False, silence_s, None)

    def export(self, recording: str, form: Format, to: str | Path, *, first_frame: int = 0, last_frame: int = -1,
               turn_deg: float = 0, hold: bool = False, camera: str = "", width_px: int = 0,
               anonymous: bool = False, on_progress: OnProgress | None = None) -> list[Path]:
        """A recording in another program's format, written to the folder or file `to`; returns the files.

        form: trc, mot (OpenSim), c3d, bvh, csv, ply (a file of coloured points a frame set; `to` is a folder), mp4
        (the pictures with the skeleton). first_frame, last_frame: from 0, included; -1: to the end. turn_deg: about
        the vertical, anticlockwise from above; not for mp4. hold: bvh, where a value is withheld, repeat the last one.
        camera, width_px: mp4, one camera instead of all in tiles, and the film's width. anonymous: silhouettes for
        pictures, no colours and names; form "session", a folder to pass on, wants it. on_progress: called four times a
        second with the share, 0 to 1, of the files that is made, before they come. NotFound, InvalidArgument,
        FailedPrecondition. A file is there whole or not at all.
        """
        files = ExportFiles(Path(to), on_progress)
        with self._stream(export_call(recording, form, first_frame, last_frame, turn_deg, hold, camera, width_px,
                                      anonymous),
                          False, None, None) as pieces:
            with files:
                for piece in pieces:
                    files.take(piece)
        return files.written

    def replayed(self, session: str | Path, silence_s: float = 60) -> Iterator[Pose]:
        """The pose of every frame of a recorded session, none left out however long each takes; the cameras' place is
        taken meanwhile, and control held.

        session: absolute path of a session.toml on the daemon's machine. Each pose's recorded_frame counts from 0.
        NotFound, DataLoss, FailedPrecondition while somebody else holds control.
        """
        with ExitStack() as held:
            if not self._transport.lease_id:
                held.enter_context(self.control(timeout_s=600))
            poses = held.enter_context(self.poses("all", silence_s=silence_s))
            poses.wait_until_subscribed()
            frames = self.replay.open(session, paused=True).frames
            held.callback(self.replay.close)
            for frame in range(frames):
                yield next(pose for pose in poses if pose.recorded_frame == frame)
                if frame + 1 < frames:
                    self.replay.step()

    @contextmanager
    def control(self, operator: str = "", timeout_s: float = 30.0) -> Iterator[None]:
        """Holds control over several calls: `with client.control("Anna"): ...`; without it each call takes it for the
        moment. It runs out timeout_s after the last call that used it. FailedPrecondition while somebody else holds it;
        the message says who."""
        transport = self._transport
        if transport.lease_id:
            raise KinevoxError("this client holds control already; use one `with client.control()` at a time",
                               self.server)
        transport.lease_id = transport.run(acquire(operator or transport.options.operator, int(1000 * timeout_s)))
        try:
            yield
        finally:
            lease, transport.lease_id = transport.lease_id, ""
            try:
                transport.run(release(lease))
            except KinevoxError:
                pass   # it runs out by itself

    def _stream(self, call: StreamCall[T], reconnect: bool, silence_s: float | None,
                on_reconnect: OnReconnect | None) -> Stream[T]:
        return Stream(self._transport, call, reconnect, silence_s, on_reconnect)

    def close(self) -> None:
        """Ends the connection and every stream."""
        self._transport.close()

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None,
                 trace: TracebackType | None) -> None:
        self.close()
