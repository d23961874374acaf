"""The blocking client of a Kinevox daemon."""
from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import TypeVar

import grpc

from kinevox import requests
from kinevox.body import Body, BodyState, PoseDatabaseState, body_call, database_call
from kinevox.calibration import Calibrations, Procedure, progress_call
from kinevox.calls import StreamCall, acquire, release
from kinevox.capture import Capture, Event
from kinevox.errors import KinevoxError
from kinevox.export_files import ExportFiles, OnProgress
from kinevox.library import PoseLibrary
from kinevox.poses import PoseFrame
from kinevox.recordings import ExportOptions, Format, Recordings, export_call
from kinevox.replay import Replay
from kinevox.requests import Delivery, Preview
from kinevox.streams import OnReconnect, Stream
from kinevox.transport import Options, Transport
from kinevox.volumes import VolumeFrame

T = TypeVar("T")

SESSION_LEASE_S = 600.0  # for a loop body that is slow between two steps


class Poses(PoseLibrary):
    """client.poses: called, it streams poses; its methods manage the poses of the pose database."""

    def __init__(self, transport: Transport) -> None:
        super().__init__(transport)
        self._transport = transport

    def __call__(
        self,
        delivery: Delivery | None = None,
        max_rate_hz: float = 0,
        *,
        reconnect: bool = False,
        idle_timeout_s: float | None = None,
        on_reconnect: OnReconnect | None = None,
    ) -> Stream[PoseFrame]:
        """Streams poses, one message per frame set.

        delivery: "lossless", every result in order; the daemon queues 256 for a slow reader and then ends the stream
        with ResourceExhausted; "latest", a slow reader receives the latest, and missed_count the number of the others.
        Default: "lossless", or "latest" if max_rate_hz is given. max_rate_hz: maximum messages per second, 0: no limit;
        only with "latest". reconnect: reconnects with pauses of up to 5 s when the daemon becomes unavailable;
        results of the meantime are lost; on_reconnect receives the reason. Without it: Unavailable. idle_timeout_s:
        DeadlineExceeded after this time without a message; None: no limit.
        """
        call = requests.poses(delivery, max_rate_hz)
        return Stream(self._transport, call, reconnect, idle_timeout_s, on_reconnect)


class Client(Capture):
    """A Kinevox daemon. `for frame in Client("host:50770").poses(): frame.angles["knee_flexion_geometric_r"]`

    Attributes: poses, recordings, replay, calibrations, body. Thread-safe, but each stream belongs to one thread. A
    context manager; close() ends its streams.
    """

    def __init__(
        self,
        server: str = "",
        *,
        timeout_s: float = 5.0,
        operator: str = "",
        credentials: grpc.ChannelCredentials | None = None,
        token: str | None = None,
        server_name: str | None = None,
    ) -> None:
        """Connects at the first call, which raises Unavailable if the daemon is not accessible.

        server: "host:port"; default: the environment variable KINEVOX_SERVER, else 127.0.0.1:50770. timeout_s: of a
        call, including the connection. operator: name that other clients see while this one holds control.

        A daemon on the network requires TLS and a token (docs/access.md): credentials, for instance
        grpc.ssl_channel_credentials(Path("ca.pem").read_bytes()); server_name, expected name in its certificate if it
        differs from the host; token, sent as "authorization: Bearer TOKEN" with every call. TypeError, InvalidArgument.
        """
        self._transport = Transport(Options(server, timeout_s, operator, credentials, token, server_name))
        super().__init__(self._transport)
        self.poses = Poses(self._transport)
        self.recordings = Recordings(self._transport)
        self.replay = Replay(self._transport)
        self.calibrations = Calibrations(self._transport)
        self.body = Body(self._transport)

    @property
    def server(self) -> str:
        """ "host:port"."""
        return self._transport.options.server

    def volumes(
        self,
        delivery: Delivery | None = None,
        max_rate_hz: float = 0,
        *,
        max_voxel_m: float | None = None,
        downsample_level: int | None = None,
        colours: bool = True,
        reconnect: bool = False,
        idle_timeout_s: float | None = None,
        on_reconnect: OnReconnect | None = None,
    ) -> Stream[VolumeFrame]:
        """Streams coloured volumes, one message per frame set.

        max_voxel_m: largest acceptable voxel edge, m; downsample_level: number of halvings of the resolution, 0 to 5;
        neither: full resolution. colours=False: about a fifth of the size. delivery: default "latest". The other
        parameters as for poses().
        """
        call = requests.volumes(delivery, max_rate_hz, max_voxel_m, downsample_level, colours)
        return self._stream(call, reconnect, idle_timeout_s, on_reconnect)

    def previews(
        self,
        camera: str,
        *,
        silhouette: bool = False,
        max_width_px: int = 0,
        max_height_px: int = 0,
        jpeg_quality: int = 0,
        max_rate_hz: float = 0,
        reconnect: bool = False,
        idle_timeout_s: float | None = None,
        on_reconnect: OnReconnect | None = None,
    ) -> Stream[Preview]:
        """Streams scaled images of one camera, always latest-only.

        silhouette: instead of the image, the sharp silhouette white and the rest of the loose one grey. 0 selects the
        daemon's default: 320 px wide, JPEG quality 80 (1 to 100), ten per second. NotFound lists the cameras. The
        other parameters as for poses().
        """
        call = requests.previews(camera, silhouette, max_width_px, max_height_px, jpeg_quality, max_rate_hz)
        return self._stream(call, reconnect, idle_timeout_s, on_reconnect)

    def events(
        self,
        history: int = 0,
        *,
        reconnect: bool = False,
        idle_timeout_s: float | None = None,
        on_reconnect: OnReconnect | None = None,
    ) -> Stream[Event]:
        """Streams events, the latest `history` past ones first (0 to 100). The other parameters as for poses()."""
        return self._stream(requests.events(history), reconnect, idle_timeout_s, on_reconnect)

    def calibration_progress(self, idle_timeout_s: float | None = None) -> Stream[Procedure]:
        """The calibration procedure, now and at each change; see Calibrations."""
        return self._stream(progress_call(), False, idle_timeout_s, None)

    def body_progress(self, idle_timeout_s: float | None = None) -> Stream[BodyState]:
        """The active bodies and the progress of a fit, now and at each change."""
        return self._stream(body_call(), False, idle_timeout_s, None)

    def database_progress(self, idle_timeout_s: float | None = None) -> Stream[PoseDatabaseState]:
        """The state of the pose database, now and at each change."""
        return self._stream(database_call(), False, idle_timeout_s, None)

    def export(
        self,
        recording: str,
        format: Format,
        to: str | Path,
        *,
        first_frame: int = 0,
        last_frame: int | None = None,
        yaw_deg: float = 0,
        hold_withheld: bool = False,
        camera: str = "",
        width_px: int = 0,
        anonymous: bool = False,
        subject_id: int = 0,
        on_progress: OnProgress | None = None,
    ) -> list[Path]:
        """Exports a recording to the folder or file `to`; returns the files, each complete or absent.

        format: trc, mot (OpenSim), c3d, bvh, csv, ply (one file of coloured points per frame set; `to` is a folder),
        mp4 (images with the skeleton) or session (a folder, requires anonymous). first_frame, last_frame: from 0,
        inclusive; None: to the end. yaw_deg: rotation about the vertical, counter-clockwise from above; not for mp4.
        hold_withheld: bvh, repeat the last value where one is withheld. camera, width_px: mp4, one camera instead of
        all as tiles, and the width of the video. anonymous: silhouettes instead of images, no colours, no names.
        subject_id: 0: the only subject. on_progress: called four times per second with the progress of creating the
        files, 0 to 1. NotFound, InvalidArgument, FailedPrecondition.
        """
        options = ExportOptions(
            first_frame, last_frame, yaw_deg, hold_withheld, camera, width_px, anonymous, subject_id
        )
        files = ExportFiles(Path(to), on_progress)
        with self._stream(export_call(recording, format, options), False, None, None) as pieces, files:
            for piece in pieces:
                files.take(piece)
        return files.written

    def measure_session(self, session: str | Path, idle_timeout_s: float = 60) -> Iterator[PoseFrame]:
        """Replays a recorded session frame by frame and yields the poses of every frame, however long each takes.

        session: a recording's name, or the absolute path of a session.toml on the server. Holds control and replaces
        the cameras meanwhile. recorded_frame counts from 0. NotFound, DataLoss, FailedPrecondition while another
        client holds control.
        """
        with ExitStack() as held:
            if not self._transport.lease_id:
                held.enter_context(self.control(timeout_s=SESSION_LEASE_S))
            poses = held.enter_context(self.poses("lossless", idle_timeout_s=idle_timeout_s))
            poses.wait_until_subscribed()
            frame_count = self.replay.open(session, paused=True).frame_count
            held.callback(self.replay.close)
            for frame in range(frame_count):
                yield next(pose for pose in poses if pose.recorded_frame == frame)
                if frame + 1 < frame_count:
                    self.replay.step()

    @contextmanager
    def control(self, operator: str = "", timeout_s: float = 30.0) -> Iterator[None]:
        """Holds control over several calls: `with client.control("Anna"): ...`. Without it, each call that needs control
        acquires and releases it. The lease expires timeout_s after the last call that used it. FailedPrecondition while
        another client holds control; the message names the operator."""
        transport = self._transport
        if transport.lease_id:
            raise KinevoxError(
                "this client holds control already; use one `with client.control()` at a time", self.server
            )
        transport.lease_id = transport.run(acquire(operator or transport.options.operator, timeout_s))
        try:
            yield
        finally:
            lease, transport.lease_id = transport.lease_id, ""
            try:
                transport.run(release(lease))
            except KinevoxError:
                pass  # the lease expires

    def _stream(
        self, call: StreamCall[T], reconnect: bool, idle_timeout_s: float | None, on_reconnect: OnReconnect | None
    ) -> Stream[T]:
        return Stream(self._transport, call, reconnect, idle_timeout_s, on_reconnect)

    def close(self) -> None:
        """Closes the connection and ends every stream."""
        self._transport.close()

    def __enter__(self) -> "Client":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
