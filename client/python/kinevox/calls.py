"""Calls as values: what is asked, what comes back, whether it needs control. Blocking and asynchronous clients carry
the same ones out, so that each is written once."""
from __future__ import annotations

import getpass
import socket
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from google.protobuf.message import Message

from kinevox.errors import KinevoxError
from kinevox.v1 import capture_service_pb2 as capture_pb

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)

LEASE_TIMEOUT_MS = 30_000


@dataclass(frozen=True)
class Call(Generic[T]):
    """One question with one answer. convert: makes the result of the answer. control: the request has a lease_id that
    is to be filled in. timeout_s: None takes the client's."""

    method: str                       # "CaptureService/GetStatus"
    request: Message
    response: type[Message]
    convert: Callable[[Any], T]
    control: bool = False
    timeout_s: float | None = None


@dataclass(frozen=True)
class StreamCall(Generic[T]):
    """One question with many answers. convert takes an answer and the server's address."""

    method: str
    request: Message
    response: type[Message]
    convert: Callable[[Any, str], T]


class Runner(Protocol):
    """What carries calls out."""

    def run(self, call: Call[T]) -> T:
        """The call's result; KinevoxError."""
        ...


def nothing(_: object) -> None:
    """For answers that say nothing."""


def operator_name() -> str:
    """Whom others read about while this program holds control."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):
        user = "somebody"
    return f"{user}@{socket.gethostname()}"[:90] + " (Python)"


def acquire(name: str, timeout_ms: int, lease_id: str = "") -> Call[str]:
    """Takes control, or renews it; yields the lease_id."""
    return Call("CaptureService/AcquireControl",
                capture_pb.AcquireControlRequest(name=name, timeout_ms=timeout_ms, lease_id=lease_id),
                capture_pb.AcquireControlResponse, lambda answer: str(answer.lease_id))


def release(lease_id: str) -> Call[None]:
    """Gives control back."""
    return Call("CaptureService/ReleaseControl", capture_pb.ReleaseControlRequest(lease_id=lease_id),
                capture_pb.ReleaseControlResponse, nothing)


def plan(call: Call[T], lease_id: str, name: str) -> Generator[Call[Any], Any, T]:
    """The calls one after the other that lead to the result; each is sent its own. A call that needs control while
    no lease is held takes it for itself and gives it back, whatever happens."""
    if not call.control:
        result: T = yield call
        return result
    own = "" if lease_id else (yield acquire(name, LEASE_TIMEOUT_MS))
    try:
        request = type(call.request)()
        request.CopyFrom(call.request)
        setattr(request, "lease_id", lease_id or own)
        result = yield Call(call.method, request, call.response, call.convert, timeout_s=call.timeout_s)
        return result
    finally:
        if own:
            try:
                yield release(own)
            except KinevoxError:
                pass   # it runs out by itself, and what was done is what counts
