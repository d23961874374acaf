"""Calls as values: request, response and whether the call needs control.

The blocking and the asynchronous client carry out the same values, so that each call is written once.
"""
from __future__ import annotations

import getpass
import socket
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, Generic, Protocol, TypeVar

from google.protobuf.duration_pb2 import Duration
from google.protobuf.message import Message

from kinevox.errors import InvalidArgument, KinevoxError
from kinevox.v1 import capture_service_pb2 as capture_pb

T = TypeVar("T")
T_co = TypeVar("T_co", covariant=True)

LEASE_TIMEOUT_S = 30.0


@dataclass(frozen=True)
class Call(Generic[T]):
    """A unary call. convert: makes the result from the response. control: fill in the request's lease_id. timeout_s:
    None: the client's."""

    method: str  # "CaptureService/GetStatus"
    request: Message
    response: type[Message]
    convert: Callable[[Any], T]
    control: bool = False
    timeout_s: float | None = None


@dataclass(frozen=True)
class StreamCall(Generic[T]):
    """A server-streaming call. convert takes a response and the server's address."""

    method: str
    request: Message
    response: type[Message]
    convert: Callable[[Any, str], T]


class Runner(Protocol):
    """Carries calls out."""

    def run(self, call: Call[T]) -> T:
        """The call's result; KinevoxError."""
        ...


def nothing(_: object) -> None:
    """Converts empty responses."""


def duration(seconds: float, name: str = "duration_s") -> Duration | None:
    """The message for a number of seconds; None, which leaves the field unset, for 0. InvalidArgument names `name`."""
    if seconds == 0:
        return None
    message = Duration()
    try:
        message.FromNanoseconds(round(seconds * 1e9))
    except (ValueError, OverflowError):
        raise InvalidArgument(f"{name} is {seconds}; give finite seconds") from None
    return message


def operator_name() -> str:
    """The default operator name, which other clients see while this program holds control."""
    try:
        user = getpass.getuser()
    except (KeyError, OSError):
        user = "unknown"
    return f"{user}@{socket.gethostname()}"[:90] + " (Python)"


def acquire(operator: str, timeout_s: float, lease_id: str = "") -> Call[str]:
    """Acquires control, or renews the lease; yields the lease_id."""
    request = capture_pb.AcquireControlRequest(
        operator_name=operator, timeout=duration(timeout_s, "timeout_s"), lease_id=lease_id
    )
    return Call(
        "CaptureService/AcquireControl", request, capture_pb.AcquireControlResponse, lambda answer: str(answer.lease_id)
    )


def release(lease_id: str) -> Call[None]:
    """Releases control."""
    request = capture_pb.ReleaseControlRequest(lease_id=lease_id)
    return Call("CaptureService/ReleaseControl", request, capture_pb.ReleaseControlResponse, nothing)


def plan(call: Call[T], lease_id: str, operator: str) -> Generator[Call[Any], Any, T]:
    """The single calls that lead to the result; each is sent its own result.

    A call that needs control while no lease is held acquires and releases control. A list call requests all pages.
    """
    if "page_token" in call.request.DESCRIPTOR.fields_by_name:
        pages: T = yield from _all_pages(call)
        return pages
    if not call.control:
        result: T = yield call
        return result
    own = "" if lease_id else (yield acquire(operator, LEASE_TIMEOUT_S))
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
                pass  # the lease expires, and the call's own result or error matters more


def _all_pages(call: Call[T]) -> Generator[Call[Any], Any, T]:
    request: Any = type(call.request)()
    request.CopyFrom(call.request)
    merged: Any = call.response()
    while True:
        page = yield Call(call.method, request, call.response, lambda answer: answer, timeout_s=call.timeout_s)
        merged.MergeFrom(page)  # appends to the list
        if not page.next_page_token or page.next_page_token == request.page_token:
            return call.convert(merged)
        request.page_token = page.next_page_token
