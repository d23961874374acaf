"""Message streams as iterators, with reconnection and an idle timeout."""
from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Any, Generic, TypeVar

import grpc

from kinevox.calls import StreamCall
from kinevox.errors import DeadlineExceeded, KinevoxError, Unavailable, from_rpc
from kinevox.transport import Transport, path

T = TypeVar("T")

FIRST_PAUSE_S, MAX_PAUSE_S = 0.2, 5.0

OnReconnect = Callable[[KinevoxError], None]


def idle_error(server: str, seconds: float) -> DeadlineExceeded:
    """The error of a stream without a message for `seconds`."""
    return DeadlineExceeded(
        f"no message from {server} for {seconds:g} s; check the capture with `kinevox "
        "status`, or increase idle_timeout_s",
        server,
    )


class _Watchdog:
    """Cancels a call that receives no message in time. It holds no reference to the stream, so that an unused stream is
    collected."""

    def __init__(self, call: Any, seconds: float) -> None:
        self.deadline = float("inf")  # of the current wait
        self.expired = False
        self._call, self._seconds = call, seconds
        self._over = threading.Event()
        threading.Thread(target=self._watch, name="kinevox-idle", daemon=True).start()

    def _watch(self) -> None:
        while not self._over.wait(min(self._seconds / 8, 0.5)):
            if time.monotonic() > self.deadline:
                self.expired = True
                self._call.cancel()
                return

    def stop(self) -> None:
        self._over.set()


class Stream(Generic[T], Iterator[T]):
    """Iterates over a stream's messages; ends where the daemon ends it, raises KinevoxError where it fails.

    Leaving a loop early ends the stream when the last reference to it is gone; use it as a context manager or call
    close(), from any thread, to end it at once. One thread may iterate.

    reconnects: number of reconnections, with reconnect=True.

    """

    def __init__(
        self,
        transport: Transport,
        call: StreamCall[T],
        reconnect: bool = False,
        idle_timeout_s: float | None = None,
        on_reconnect: OnReconnect | None = None,
    ) -> None:
        self.reconnects = 0
        self._transport, self._what = transport, call
        self._reconnect, self._idle_timeout_s, self._on_reconnect = (reconnect, idle_timeout_s, on_reconnect)
        self._call: Any = None
        self._watchdog: _Watchdog | None = None
        self._closed = threading.Event()
        self._pause_s = FIRST_PAUSE_S
        self._open()

    def __iter__(self) -> Stream[T]:
        return self

    def __next__(self) -> T:
        while not self._closed.is_set():
            try:
                message = self._receive()
            except StopIteration:
                self.close()
                raise
            except grpc.RpcError as error:
                self._reopen(error)
                continue
            self._pause_s = FIRST_PAUSE_S
            return self._what.convert(message, self._transport.options.server)
        raise StopIteration

    def wait_until_subscribed(self) -> None:
        """Returns when the daemon has registered the subscription. Errors are raised by the first read."""
        try:
            self._call.initial_metadata()
        except grpc.RpcError:
            pass

    def _receive(self) -> Any:
        watchdog = self._watchdog
        if watchdog is None or self._idle_timeout_s is None:
            return next(self._call)
        watchdog.deadline = time.monotonic() + self._idle_timeout_s
        try:
            return next(self._call)
        finally:
            watchdog.deadline = float("inf")

    def _open(self) -> None:
        what, options = self._what, self._transport.options
        ask = self._transport.channel.unary_stream(
            path(what.method), type(what.request).SerializeToString, what.response.FromString
        )
        self._call = ask(what.request, metadata=options.metadata)
        if self._idle_timeout_s is not None:
            self._watchdog = _Watchdog(self._call, self._idle_timeout_s)

    def _reopen(self, error: grpc.RpcError) -> None:
        """After an error: reconnects if requested and possible, else raises. Returns after close()."""
        if self._closed.is_set():
            return
        expired = self._watchdog is not None and self._watchdog.expired
        self._release()
        server = self._transport.options.server
        why = idle_error(server, self._idle_timeout_s or 0) if expired else from_rpc(error, server)
        if not self._reconnect or not isinstance(why, Unavailable):
            self.close()
            raise why from None
        if self._on_reconnect is not None:
            self._on_reconnect(why)
        if self._closed.wait(self._pause_s):
            return
        self._pause_s = min(2 * self._pause_s, MAX_PAUSE_S)
        self.reconnects += 1
        self._open()

    def _release(self) -> None:
        if self._watchdog is not None:
            self._watchdog.stop()
            self._watchdog = None
        if self._call is not None:
            self._call.cancel()

    def close(self) -> None:
        """Ends the stream here and at the daemon; a loop over it ends. May be called twice, and by any thread."""
        self._closed.set()
        self._release()

    def __enter__(self) -> Stream[T]:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __del__(self) -> None:
        if hasattr(self, "_closed"):
            self.close()
