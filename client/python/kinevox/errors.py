"""What goes wrong, as one line: what, where, what to do."""
from __future__ import annotations

import grpc


class KinevoxError(Exception):
    """Something that the daemon refused or that could not be done; its text is one line for people.

    code: gRPC's name of the status, "NOT_FOUND" say. server: "host:port" that was asked.

    """

    code = "UNKNOWN"

    def __init__(self, message: str, server: str = "") -> None:
        super().__init__(message)
        self.server = server


class Unavailable(KinevoxError, ConnectionError):
    """The daemon cannot be reached, is stopping, or is busy with what it needs for this first."""

    code = "UNAVAILABLE"


class DeadlineExceeded(KinevoxError, TimeoutError):
    """No answer, or no message of a stream, came in time."""

    code = "DEADLINE_EXCEEDED"


class InvalidArgument(KinevoxError, ValueError):
    """A value is out of its range or makes no sense."""

    code = "INVALID_ARGUMENT"


class OutOfRange(KinevoxError, ValueError):
    """There is no such frame or speed."""

    code = "OUT_OF_RANGE"


class NotFound(KinevoxError, LookupError):
    """There is no camera, recording, calibration or file of that name."""

    code = "NOT_FOUND"


class AlreadyExists(KinevoxError):
    """There is one of that name already."""

    code = "ALREADY_EXISTS"


class FailedPrecondition(KinevoxError):
    """The daemon is not in the state that this needs, or somebody else holds control."""

    code = "FAILED_PRECONDITION"


class ResourceExhausted(KinevoxError):
    """A stream without losses was read too slowly, or the disk is full."""

    code = "RESOURCE_EXHAUSTED"


class Aborted(KinevoxError):
    """A stop came before it was done."""

    code = "ABORTED"


class DataLoss(KinevoxError):
    """A file or a message is damaged."""

    code = "DATA_LOSS"


class Cancelled(KinevoxError):
    """This client cancelled the call or closed its channel."""

    code = "CANCELLED"


class Unauthenticated(KinevoxError):
    """There is no token, or one that is wrong, expired or revoked."""

    code = "UNAUTHENTICATED"


class PermissionDenied(KinevoxError, PermissionError):
    """The token's role may not do that."""

    code = "PERMISSION_DENIED"


class Unimplemented(KinevoxError):
    """What answers is not a Kinevox daemon, or one of another version."""

    code = "UNIMPLEMENTED"


_CLASSES: dict[str, type[KinevoxError]] = {
    kind.code: kind
    for kind in (Unavailable, DeadlineExceeded, InvalidArgument, OutOfRange, NotFound, AlreadyExists,
                 FailedPrecondition, ResourceExhausted, Aborted, DataLoss, Cancelled, Unauthenticated,
                 PermissionDenied, Unimplemented)
}


def _here(message: str) -> bool:
    """Whether a cancelled call was cancelled by this client."""
    return message.startswith(("Locally cancelled", "Channel closed"))


def from_status(code: grpc.StatusCode | None, details: str | None, server: str) -> KinevoxError:
    """The exception for a call's status. The daemon's own words stay; gRPC's get an address and a remedy."""
    name = code.name if code is not None else "UNKNOWN"
    message = " ".join((details or "").split())
    own = "daemon" in message   # the daemon's own words, or gRPC's
    if name == "CANCELLED" and not _here(message):
        # What gRPC says of a call that reaches a server that is stopping.
        name = "UNAVAILABLE"
        message = f"the daemon at {server} ended the call, as it does when it stops; connect again later"
    elif name == "UNAVAILABLE" and not own:
        message = (f"cannot reach a daemon at {server} ({message}); start kinevoxd there or give another address")
    elif name == "DEADLINE_EXCEEDED":
        message = f"the daemon at {server} did not answer in time; try again or allow it more with timeout_s"
    elif name == "UNIMPLEMENTED":
        message = f"what answers at {server} is not a Kinevox daemon of this version ({message}); update one of the two"
    elif name == "UNAUTHENTICATED":
        message = f"{server} refuses the token ({message}); give Client another one"
    error = _CLASSES.get(name, KinevoxError)(message or name, server)
    error.code = name
    return error


def from_rpc(error: grpc.RpcError, server: str) -> KinevoxError:
    """The exception for what a blocking or asynchronous call of gRPC raised."""
    code = error.code() if hasattr(error, "code") else None
    details = error.details() if hasattr(error, "details") else str(error)
    return from_status(code, details, server)
