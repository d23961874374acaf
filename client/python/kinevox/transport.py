"""The connection to a daemon: options, channel and blocking calls."""
from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

import grpc

from kinevox.calls import Call, operator_name, plan
from kinevox.errors import InvalidArgument, from_rpc

T = TypeVar("T")

DEFAULT_SERVER = "127.0.0.1:50770"
START_TIMEOUT_S = 60.0  # for calls that wait for cameras, a background or a disk

CHANNEL_OPTIONS: list[tuple[str, int]] = [
    ("grpc.max_receive_message_length", 256 << 20),  # for 16 cameras at 2 mm
    ("grpc.keepalive_time_ms", 20_000),
    ("grpc.initial_reconnect_backoff_ms", 200),
    ("grpc.max_reconnect_backoff_ms", 2_000),
    ("grpc.use_local_subchannel_pool", 1),  # one connection per client
]


@dataclass(frozen=True)
class Options:
    """Address, timeout and security of a connection; see Client."""

    server: str = ""
    timeout_s: float = 5.0
    operator: str = ""
    credentials: grpc.ChannelCredentials | None = None
    token: str | None = None
    server_name: str | None = None

    def __post_init__(self) -> None:
        for name, value, kind in (("server", self.server, str), ("operator", self.operator, str)):
            if not isinstance(value, kind):
                raise TypeError(f"{name} is {value!r}, of type {type(value).__name__}; give a string")
        if isinstance(self.timeout_s, bool) or not isinstance(self.timeout_s, (int, float)):
            raise TypeError(f"timeout_s is {self.timeout_s!r}; give a number of seconds")
        server = self.server or os.environ.get("KINEVOX_SERVER", "") or DEFAULT_SERVER
        object.__setattr__(self, "server", server)
        object.__setattr__(self, "operator", self.operator or operator_name())
        if ":" not in server:
            raise InvalidArgument(f"server is '{server}'; give HOST:PORT, for instance {DEFAULT_SERVER}", server)
        if not self.timeout_s > 0:
            raise InvalidArgument(f"timeout_s is {self.timeout_s}; give seconds, more than 0", server)

    @property
    def metadata(self) -> Sequence[tuple[str, str]]:
        """Sent with every call."""
        return [("authorization", f"Bearer {self.token}")] if self.token else []

    @property
    def channel_options(self) -> list[tuple[str, Any]]:
        """Options of the gRPC channel."""
        options: list[tuple[str, Any]] = list(CHANNEL_OPTIONS)
        if self.server_name:
            options.append(("grpc.ssl_target_name_override", self.server_name))
        return options


def path(method: str) -> str:
    """The gRPC path of "CaptureService/GetStatus"."""
    return f"/kinevox.v1.{method}"


class Transport:
    """A channel, and the control lease while one is held. Thread-safe."""

    def __init__(self, options: Options) -> None:
        self.options = options
        self.lease_id = ""
        if options.credentials is not None:
            self.channel = grpc.secure_channel(options.server, options.credentials, options.channel_options)
        else:
            self.channel = grpc.insecure_channel(options.server, options.channel_options)

    def run(self, call: Call[T]) -> T:
        """The call's result; KinevoxError."""
        steps = plan(call, self.lease_id, self.options.operator)
        try:
            step = next(steps)
            while True:
                try:
                    answer = self._once(step)
                except BaseException as error:
                    step = steps.throw(error)
                else:
                    step = steps.send(answer)
        except StopIteration as done:
            result: T = done.value
            return result

    def _once(self, call: Call[Any]) -> Any:
        ask = self.channel.unary_unary(
            path(call.method), type(call.request).SerializeToString, call.response.FromString
        )
        try:
            answer = ask(call.request, timeout=call.timeout_s or self.options.timeout_s, metadata=self.options.metadata)
        except grpc.RpcError as error:
            raise from_rpc(error, self.options.server) from None
        return call.convert(answer)

    def close(self) -> None:
        """Ends every call and stream."""
        self.channel.close()
