"""The asynchronous client: the methods of the blocking client, awaited, and its streams for `async for`.

    async with AsyncClient("host:50770") as client:
        async for frame in client.poses():
            print(frame.coordinates["knee_angle_r"])
"""
from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import AsyncExitStack, asynccontextmanager
from functools import wraps
from pathlib import Path
from types import TracebackType
from typing import Any, Concatenate, ParamSpec, TypeVar, cast

import grpc

from kinevox import requests
from kinevox.aio_transport import AsyncStream, AsyncTransport
from kinevox.body import Body, BodyState, PoseDatabaseState, body_call, database_call
from kinevox.calibration import Calibrations, Procedure, progress_call
from kinevox.calls import Call, acquire, release
from kinevox.capture import Capture, Event, Service
from kinevox.client import SESSION_LEASE_S
from kinevox.errors import KinevoxError
from kinevox.export_files import ExportFiles, OnProgress
from kinevox.library import PoseLibrary
from kinevox.poses import PoseFrame
from kinevox.recordings import ExportOptions, Format, Recordings, export_call
from kinevox.replay import Replay
from kinevox.requests import Delivery, Preview
from kinevox.streams import OnReconnect
from kinevox.transport import Options
from kinevox.volumes import VolumeFrame

T = TypeVar("T")
P = ParamSpec("P")
S = TypeVar("S", bound=Service)


class _Describer:
    """Returns the call itself instead of carrying it out."""

    def run(self, call: Call[T]) -> T:
        return cast(T, call)


class AsyncService:
    """Part of an asynchronous client: the methods of the blocking class, awaited."""

    _kind: type[Any] = Service

    def __init__(self, transport: AsyncTransport) -> None:
        self._transport = transport
        self._described: Any = self._kind(_Describer())


def awaited(method: Callable[Concatenate[S, P], T]) -> Callable[Concatenate[Any, P], Coroutine[Any, Any, T]]:
    """The method of a blocking service, for an asynchronous one."""

    @wraps(method)
    async def call(self: Any, /, *args: P.args, **kwargs: P.kwargs) -> T:
        described = cast(Call[T], method(self._described, *args, **kwargs))
        result: T = await self._transport.run(described)
        return result

    return call


class AsyncCapture(AsyncService):
    """As kinevox.capture.Capture, awaited."""

    _kind = Capture
    status = awaited(Capture.status)
    cameras = awaited(Capture.cameras)
    start = awaited(Capture.start)
    stop = awaited(Capture.stop)
    learn_background = awaited(Capture.learn_background)
    subjects = awaited(Capture.subjects)
    select_subjects = awaited(Capture.select_subjects)
    name_subject = awaited(Capture.name_subject)


class AsyncRecordings(AsyncService):
    """As kinevox.recordings.Recordings, awaited."""

    _kind = Recordings
    start = awaited(Recordings.start)
    stop = awaited(Recordings.stop)
    save_buffer = awaited(Recordings.save_buffer)
    status = awaited(Recordings.status)
    list = awaited(Recordings.list)
    get = awaited(Recordings.get)
    delete = awaited(Recordings.delete)


class AsyncReplay(AsyncService):
    """As kinevox.replay.Replay, awaited."""

    _kind = Replay
    open = awaited(Replay.open)
    close = awaited(Replay.close)
    status = awaited(Replay.status)
    play = awaited(Replay.play)
    pause = awaited(Replay.pause)
    step = awaited(Replay.step)
    seek = awaited(Replay.seek)
    set_speed = awaited(Replay.set_speed)
    set_loop = awaited(Replay.set_loop)


class AsyncCalibrations(AsyncService):
    """As kinevox.calibration.Calibrations, awaited."""

    _kind = Calibrations
    list = awaited(Calibrations.list)
    certificate = awaited(Calibrations.certificate)
    apply = awaited(Calibrations.apply)
    undo = awaited(Calibrations.undo)
    import_ = awaited(Calibrations.import_)
    export = awaited(Calibrations.export)
    delete = awaited(Calibrations.delete)
    start = awaited(Calibrations.start)
    add_live = awaited(Calibrations.add_live)
    add_files = awaited(Calibrations.add_files)
    solve = awaited(Calibrations.solve)
    cancel = awaited(Calibrations.cancel)


class AsyncBody(AsyncService):
    """As kinevox.body.Body, awaited."""

    _kind = Body
    fit = awaited(Body.fit)


class AsyncPoses(AsyncService):
    """As kinevox.client.Poses: called, it streams poses; its methods are awaited."""

    _kind = PoseLibrary
    list = awaited(PoseLibrary.list)
    add = awaited(PoseLibrary.add)
    delete = awaited(PoseLibrary.delete)
    import_bvh = awaited(PoseLibrary.import_bvh)

    def __call__(
        self,
        delivery: Delivery | None = None,
        max_rate_hz: float = 0,
        *,
        reconnect: bool = False,
        idle_timeout_s: float | None = None,
        on_reconnect: OnReconnect | None = None,
    ) -> AsyncStream[PoseFrame]:
        """See kinevox.client.Poses."""
        call = requests.poses(delivery, max_rate_hz)
        return AsyncStream(self._transport, call, reconnect, idle_timeout_s, on_reconnect)


class AsyncClient(AsyncCapture):
    """As kinevox.Client, for asyncio: calls are awaited, streams are for `async for`, contexts for `async with`. It belongs to one
    event loop."""

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
        """See Client."""
        super().__init__(AsyncTransport(Options(server, timeout_s, operator, credentials, token, server_name)))
        self.poses = AsyncPoses(self._transport)
        self.recordings = AsyncRecordings(self._transport)
        self.replay = AsyncReplay(self._transport)
        self.calibrations = AsyncCalibrations(self._transport)
        self.body = AsyncBody(self._transport)

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
    ) -> AsyncStream[VolumeFrame]:
        """See Client.volumes."""
        call = requests.volumes(delivery, max_rate_hz, max_voxel_m, downsample_level, colours)
        return AsyncStream(self._transport, call, reconnect, idle_timeout_s, on_reconnect)

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
    ) -> AsyncStream[Preview]:
        """See Client.previews."""
        call = requests.previews(camera, silhouette, max_width_px, max_height_px, jpeg_quality, max_rate_hz)
        return AsyncStream(self._transport, call, reconnect, idle_timeout_s, on_reconnect)

    def events(
        self,
        history: int = 0,
        *,
        reconnect: bool = False,
        idle_timeout_s: float | None = None,
        on_reconnect: OnReconnect | None = None,
    ) -> AsyncStream[Event]:
        """See Client.events."""
        return AsyncStream(self._transport, requests.events(history), reconnect, idle_timeout_s, on_reconnect)

    def calibration_progress(self, idle_timeout_s: float | None = None) -> AsyncStream[Procedure]:
        """See Client.calibration_progress."""
        return AsyncStream(self._transport, progress_call(), idle_timeout_s=idle_timeout_s)

    def body_progress(self, idle_timeout_s: float | None = None) -> AsyncStream[BodyState]:
        """See Client.body_progress."""
        return AsyncStream(self._transport, body_call(), idle_timeout_s=idle_timeout_s)

    def database_progress(self, idle_timeout_s: float | None = None) -> AsyncStream[PoseDatabaseState]:
        """See Client.database_progress."""
        return AsyncStream(self._transport, database_call(), idle_timeout_s=idle_timeout_s)

    async def export(
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
        """See Client.export."""
        options = ExportOptions(
            first_frame, last_frame, yaw_deg, hold_withheld, camera, width_px, anonymous, subject_id
        )
        async with AsyncStream(self._transport, export_call(recording, format, options)) as pieces:
            with ExportFiles(Path(to), on_progress) as files:
                async for piece in pieces:
                    files.take(piece)
        return files.written

    async def measure_session(self, session: str | Path, idle_timeout_s: float = 60) -> AsyncIterator[PoseFrame]:
        """See Client.measure_session."""
        async with AsyncExitStack() as held:
            if not self._transport.lease_id:
                await held.enter_async_context(self.control(timeout_s=SESSION_LEASE_S))
            poses = await held.enter_async_context(self.poses("lossless", idle_timeout_s=idle_timeout_s))
            await poses.wait_until_subscribed()
            frame_count = (await self.replay.open(session, paused=True)).frame_count
            held.push_async_callback(self.replay.close)
            for frame in range(frame_count):
                async for pose in poses:
                    if pose.recorded_frame == frame:
                        yield pose
                        break
                if frame + 1 < frame_count:
                    await self.replay.step()

    @asynccontextmanager
    async def control(self, operator: str = "", timeout_s: float = 30.0) -> AsyncIterator[None]:
        """See Client.control."""
        transport = self._transport
        if transport.lease_id:
            raise KinevoxError(
                "this client holds control already; use one `async with client.control()` at a time", self.server
            )
        transport.lease_id = await transport.run(acquire(operator or transport.options.operator, timeout_s))
        try:
            yield
        finally:
            lease, transport.lease_id = transport.lease_id, ""
            try:
                await transport.run(release(lease))
            except KinevoxError:
                pass  # the lease expires

    async def close(self) -> None:
        """Closes the connection and ends every stream."""
        await self._transport.close()

    async def __aenter__(self) -> "AsyncClient":
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()
