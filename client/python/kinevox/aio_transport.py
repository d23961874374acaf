"""Calls and streams of the asynchronous client."""
from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from types import TracebackType
from typing import Any, Generic, TypeVar

import grpc
import grpc.aio

from kinevox.calls import Call, StreamCall, plan
from kinevox.errors import KinevoxError, Unavailable, from_rpc
from kinevox.streams import FIRST_PAUSE_S, MAX_PAUSE_S, OnReconnect, idle_error
from kinevox.transport import Options, path

T = TypeVar("T")


class AsyncTransport:
    """A channel of the running event loop, created at first use, and the control lease while one is held."""

    def __init__(self, options: Options) -> None:
        self.options = options
        self.lease_id = ""
        self._channel: Any = None

    @property
    def channel(self) -> Any:
        """The gRPC channel."""
        if self._channel is None:
            server, more = self.options.server, self.options.channel_options
            if self.options.credentials is not None:
                self._channel = grpc.aio.secure_channel(server, self.options.credentials, more)
            else:
                self._channel = grpc.aio.insecure_channel(server, more)
        return self._channel

    async def run(self, call: Call[T]) -> T:
        """The call's result; KinevoxError. A cancelled call still releases control."""
        steps = plan(call, self.lease_id, self.options.operator)
        try:
            step = next(steps)
            while True:
                try:
                    answer = await self._once(step)
                except BaseException as error:
                    step = steps.throw(error)
                else:
                    step = steps.send(answer)
        except StopIteration as done:
            result: T = done.value
            return result

    async def _once(self, call: Call[Any]) -> Any:
        ask = self.channel.unary_unary(
            path(call.method), type(call.request).SerializeToString, call.response.FromString
        )
        try:
            answer = await ask(
                call.request, timeout=call.timeout_s or self.options.timeout_s, metadata=list(self.options.metadata)
            )
        except grpc.RpcError as error:
            raise from_rpc(error, self.options.server) from None
        return call.convert(answer)

    async def close(self) -> None:
        """Ends every call and stream."""
        if self._channel is not None:
            await self._channel.close()


class AsyncStream(Generic[T], AsyncIterator[T]):
    """Iterates over a stream's messages with `async for`; otherwise as Stream."""

    def __init__(
        self,
        transport: AsyncTransport,
        call: StreamCall[T],
        reconnect: bool = False,
        idle_timeout_s: float | None = None,
        on_reconnect: OnReconnect | None = None,
    ) -> None:
        self.reconnects = 0
        self._transport, self._what = transport, call
        self._reconnect, self._idle_timeout_s, self._on_reconnect = (reconnect, idle_timeout_s, on_reconnect)
        self._call: Any = None
        self._closed = False
        self._pause_s = FIRST_PAUSE_S

    def __aiter__(self) -> AsyncStream[T]:
        return self

    async def __anext__(self) -> T:
        while not self._closed:
            try:
                if self._call is None:
                    self._call = self._open()
                message = await asyncio.wait_for(self._call.read(), self._idle_timeout_s)
            except asyncio.TimeoutError:
                self.close()
                raise idle_error(self._transport.options.server, self._idle_timeout_s or 0) from None
            except grpc.RpcError as error:
                await self._reopen(from_rpc(error, self._transport.options.server))
                continue
            except asyncio.CancelledError:
                if self._closed:
                    break  # close() by another task
                self.close()
                raise
            if message is grpc.aio.EOF:
                self.close()
                break
            self._pause_s = FIRST_PAUSE_S
            return self._what.convert(message, self._transport.options.server)
        raise StopAsyncIteration

    async def wait_until_subscribed(self) -> None:
        """Returns when the daemon has registered the subscription. Errors are raised by the first read."""
        if self._call is None:
            self._call = self._open()
        try:
            await self._call.initial_metadata()
        except grpc.RpcError:
            pass

    def _open(self) -> Any:
        what = self._what
        ask = self._transport.channel.unary_stream(
            path(what.method), type(what.request).SerializeToString, what.response.FromString
        )
        return ask(what.request, metadata=list(self._transport.options.metadata))

    async def _reopen(self, why: KinevoxError) -> None:
        if self._closed:
            return
        if not self._reconnect or not isinstance(why, Unavailable):
            self.close()
            raise why
        self._call = None
        if self._on_reconnect is not None:
            self._on_reconnect(why)
        await asyncio.sleep(self._pause_s)
        self._pause_s = min(2 * self._pause_s, MAX_PAUSE_S)
        self.reconnects += 1

    def close(self) -> None:
        """Ends the stream here and at the daemon; a loop over it ends."""
        self._closed = True
        if self._call is not None:
            self._call.cancel()

    async def __aenter__(self) -> AsyncStream[T]:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __del__(self) -> None:
        if getattr(self, "_call", None) is not None and not self._call.done():
            self._call.cancel()
