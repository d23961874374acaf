"""Errors with a one-line message: what, where, remedy."""
from __future__ import annotations

import grpc


class KinevoxError(Exception):
    """A call that failed or was refused; its text is one line.

    code: name of the gRPC status, such as "NOT_FOUND". server: "host:port" of the daemon.
    """

    code = "UNKNOWN"

    def __init__(self, message: str, server: str = "") -> None:
        super().__init__(message)
        self.server = server


class Unavailable(KinevoxError, ConnectionError):
    """The daemon is not accessible, is stopping, or still prepares what the call needs."""

    code = "UNAVAILABLE"


class DeadlineExceeded(KinevoxError, TimeoutError):
    """No answer, or no message of a stream, arrived in time."""

    code = "DEADLINE_EXCEEDED"


class InvalidArgument(KinevoxError, ValueError):
    """A value is out of range or invalid."""

    code = "INVALID_ARGUMENT"


class OutOfRange(KinevoxError, ValueError):
    """The frame or speed does not exist."""

    code = "OUT_OF_RANGE"


class NotFound(KinevoxError, LookupError):
    """No camera, recording, calibration or file has that name."""

    code = "NOT_FOUND"


class AlreadyExists(KinevoxError):
    """The name is in use."""

    code = "ALREADY_EXISTS"


class FailedPrecondition(KinevoxError):
    """The daemon is not in the required state, another client holds control, or several subjects are tracked and none
    was chosen."""

    code = "FAILED_PRECONDITION"


class ResourceExhausted(KinevoxError):
    """A lossless stream was read too slowly, or the disk is full."""

    code = "RESOURCE_EXHAUSTED"


class Aborted(KinevoxError):
    """The capture was stopped before the call was done."""

    code = "ABORTED"


class DataLoss(KinevoxError):
    """A file or a message is damaged."""

    code = "DATA_LOSS"


class Cancelled(KinevoxError):
    """This client cancelled the call or closed its channel."""

    code = "CANCELLED"


class Unauthenticated(KinevoxError):
    """The token is missing, wrong, expired or revoked."""

    code = "UNAUTHENTICATED"


class PermissionDenied(KinevoxError, PermissionError):
    """The token's role does not permit the call."""

    code = "PERMISSION_DENIED"


class Unimplemented(KinevoxError):
    """The server is not a Kinevox daemon, or has another version."""

    code = "UNIMPLEMENTED"


_CLASSES: dict[str, type[KinevoxError]] = {
    kind.code: kind
    for kind in (
        Unavailable,
        DeadlineExceeded,
        InvalidArgument,
        OutOfRange,
        NotFound,
        AlreadyExists,
        FailedPrecondition,
        ResourceExhausted,
        Aborted,
        DataLoss,
        Cancelled,
        Unauthenticated,
        PermissionDenied,
        Unimplemented,
    )
}


def _here(message: str) -> bool:
    """Whether this client cancelled the call."""
    return message.startswith(("Locally cancelled", "Channel closed"))


def from_status(code: grpc.StatusCode | None, details: str | None, server: str) -> KinevoxError:
    """The exception for a call's status. The daemon's messages are kept; gRPC's get the address and a remedy."""
    name = code.name if code is not None else "UNKNOWN"
    message = " ".join((details or "").split())
    from_daemon = "daemon" in message  # or from gRPC
    if name == "CANCELLED" and not _here(message):
        # gRPC's status of a call to a server that is stopping.
        name = "UNAVAILABLE"
        message = f"the daemon at {server} ended the call because it is stopping; connect again later"
    elif name == "UNAVAILABLE" and not from_daemon:
        if "SSL" in message or "andshake" in message:
            message = (
                f"TLS handshake with {server} failed ({message}); check credentials and server_name, or omit "
                "credentials if the daemon serves without TLS"
            )
        elif "Socket closed" in message or "Connection reset" in message or "GOAWAY" in message:
            message = f"{server} closed the connection ({message}); if the daemon serves with TLS, give credentials"
        else:
            message = (
                f"cannot connect to a daemon at {server} ({message}); start kinevoxd there or give another address"
            )
    elif name == "DEADLINE_EXCEEDED":
        message = f"the daemon at {server} did not answer in time; try again or increase timeout_s"
    elif name == "UNIMPLEMENTED":
        message = f"the server at {server} is not a Kinevox daemon of this version ({message}); update the daemon or this package"
    elif name == "UNAUTHENTICATED":
        message = f"{server} rejected the token ({message}); give Client a valid token"
    error = _CLASSES.get(name, KinevoxError)(message or name, server)
    error.code = name
    return error


def from_rpc(error: grpc.RpcError, server: str) -> KinevoxError:
    """The exception for an error of a blocking or asynchronous gRPC call."""
    code = error.code() if hasattr(error, "code") else None
    details = error.details() if hasattr(error, "details") else str(error)
    return from_status(code, details, server)
