"""Recordings: made on the daemon's machine, fetched in other programs' formats."""
from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from kinevox.calls import Call, StreamCall, nothing
from kinevox.capture import Service, enum_name
from kinevox.transport import START_TIMEOUT_S
from kinevox.v1 import recording_service_pb2 as pb

Codec = Literal["ffv1", "utvideo", "h264"]
Format = Literal["trc", "mot", "c3d", "bvh", "csv", "ply", "mp4", "session"]


@dataclass(frozen=True)
class Recording:
    """A session on the daemon's machine.

    started_ns: UTC, of its first frame set. seconds: from its first to its last frame set, and one frame. dropped:
    frame sets that came but were not recorded; lost: before the recorder. closed: False while it is written.
    end_reason: why it ended, where nobody asked for that. message: all of it,
    kinevox.v1.recording_service_pb2.Recording.
    """

    name: str
    started_ns: int
    seconds: float
    fps: float
    frames: int
    bytes: int
    dropped: int
    lost: int
    cameras: tuple[str, ...]
    closed: bool
    end_reason: str
    message: Any = field(repr=False)

    @staticmethod
    def of(recording: Any) -> "Recording":
        """From the daemon's message."""
        return Recording(recording.name, recording.started_ns, recording.seconds, recording.fps, recording.frames,
                         recording.bytes, recording.dropped, recording.lost, tuple(recording.cameras), recording.closed,
                         recording.end_reason, recording)


@dataclass(frozen=True)
class RecorderStatus:
    """state: off (no folder for recordings), idle, waiting (for the first frame set), recording or finishing.
    recording: the one being written; last: the one that ended last; None: there is none. folder: on the daemon's
    machine. held_seconds: what the rolling buffer holds. message: all of it, GetRecorderStatusResponse."""

    state: str
    recording: Recording | None
    last: Recording | None
    folder: str
    free_bytes: int
    held_seconds: float
    message: Any = field(repr=False)

    @staticmethod
    def of(status: Any) -> "RecorderStatus":
        """From the daemon's message."""
        return RecorderStatus(enum_name(pb.RecorderState.DESCRIPTOR, status.state, "RECORDER_STATE_"),
                              Recording.of(status.recording) if status.HasField("recording") else None,
                              Recording.of(status.last) if status.HasField("last") else None, status.folder,
                              status.free_bytes, status.held_seconds, status)


@dataclass(frozen=True)
class ExportPiece:
    """Part of an exported file. last: of this file. remark: one line where there is something to know. Without
    file_name: done_share of the files, 0 to 1, is made."""

    file_name: str
    data: bytes
    last: bool
    remark: str
    done_share: float

    @staticmethod
    def of(piece: Any, _: str = "") -> "ExportPiece":
        """From the daemon's message."""
        return ExportPiece(piece.file_name, piece.data, piece.last_of_file, piece.remark, piece.done_share)


def export_call(recording: str, form: Format, first_frame: int, last_frame: int, turn_deg: float, hold: bool,
                camera: str, width_px: int, anonymous: bool) -> StreamCall[ExportPiece]:
    """See Client.export."""
    value = pb.ExportFormat.DESCRIPTOR.values_by_name.get(f"EXPORT_FORMAT_{form.upper()}")
    if value is None:
        raise ValueError(f"there is no format '{form}'; take trc, mot, c3d, bvh, csv, ply, mp4 or session")
    request = pb.ExportRequest(recording=recording, format=value.number, first_frame=first_frame, last_frame=last_frame,
                               turn_deg=turn_deg, hold=hold, camera=camera, width_px=width_px,
                               anonymous=anonymous, progress=True)
    return StreamCall("RecordingService/Export", request, pb.ExportResponse, ExportPiece.of)


class Recordings(Service):
    """client.recordings. Changes take control for the moment."""

    def start(self, name: str = "", codec: Codec | None = None) -> str:
        """Begins a recording with the next frame set; before the capture runs, with its first. Its name, 1 to 100 of
        letters, digits, . _ -; empty: date and time. codec: None takes the daemon's. Returns the name.
        InvalidArgument, AlreadyExists, FailedPrecondition, ResourceExhausted (the disk is full)."""
        value: Any = getattr(pb, f"RECORDING_CODEC_{codec.upper()}", None) if codec else 0
        if value is None:
            raise ValueError(f"there is no codec '{codec}'; take ffv1, utvideo or h264")
        return self._runner.run(Call("RecordingService/StartRecording", pb.StartRecordingRequest(name=name,
                                                                                                 codec=value),
                                     pb.StartRecordingResponse, lambda answer: str(answer.name), True, START_TIMEOUT_S))

    def stop(self, timeout_s: float = START_TIMEOUT_S) -> Recording:
        """Ends the recording; returns it when everything is on disk. FailedPrecondition where none is made."""
        return self._runner.run(Call("RecordingService/StopRecording", pb.StopRecordingRequest(),
                                     pb.StopRecordingResponse,
                                     lambda answer: Recording.of(answer.recording), True, timeout_s))

    def keep_last(self, seconds: float = 0, name: str = "", go_on: bool = False,
                  timeout_s: float = START_TIMEOUT_S) -> Recording:
        """Writes out the newest seconds of the rolling buffer, 0: all it holds; go_on: records on from there without a
        gap. FailedPrecondition where the daemon keeps none (keep_last_s in its configuration)."""
        request = pb.KeepLastRequest(name=name, seconds=seconds, go_on=go_on)
        return self._runner.run(Call("RecordingService/KeepLast", request, pb.KeepLastResponse,
                                     lambda answer: Recording.of(answer.recording), True, timeout_s))

    def status(self) -> RecorderStatus:
        """What is being recorded. Cheap. Unavailable."""
        return self._runner.run(Call("RecordingService/GetRecorderStatus", pb.GetRecorderStatusRequest(),
                                     pb.GetRecorderStatusResponse, RecorderStatus.of))

    def list(self) -> list[Recording]:
        """All recordings, oldest first."""
        return self._runner.run(Call("RecordingService/ListRecordings", pb.ListRecordingsRequest(),
                                     pb.ListRecordingsResponse,
                                     lambda answer: [Recording.of(recording) for recording in answer.recordings]))

    def get(self, name: str) -> Recording:
        """The recording of that name. NotFound."""
        return self._runner.run(Call("RecordingService/GetRecording", pb.GetRecordingRequest(name=name),
                                     pb.GetRecordingResponse, lambda answer: Recording.of(answer.recording)))

    def delete(self, name: str) -> None:
        """Removes a recording's folder. NotFound; FailedPrecondition for the one being written."""
        return self._runner.run(Call("RecordingService/DeleteRecording", pb.DeleteRecordingRequest(name=name),
                                     pb.DeleteRecordingResponse, nothing, True, START_TIMEOUT_S))
