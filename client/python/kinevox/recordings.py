"""Recordings on the server: making, listing, deleting and exporting them."""
from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

from kinevox.calls import Call, StreamCall, duration, nothing
from kinevox.capture import Service, enum_name
from kinevox.transport import START_TIMEOUT_S
from kinevox.v1 import recording_service_pb2 as pb

Codec = Literal["ffv1", "utvideo", "h264"]
Format = Literal["trc", "mot", "c3d", "bvh", "csv", "ply", "mp4", "session"]


@dataclass(frozen=True)
class Recording:
    """A recording on the server.

    start_time_ns: capture time of its first frame set, UTC. duration_s: from the first to the last frame set, plus one
    frame. frame_set_count: recorded; dropped_frame_set_count: received but not recorded; lost_frame_set_count: lost
    before the recorder. closed: False while it is being written. end_reason: empty if it was stopped on request.
    message: kinevox.v1.recording_service_pb2.Recording.
    """

    name: str
    start_time_ns: int
    duration_s: float
    nominal_fps: float
    frame_set_count: int
    size_bytes: int
    dropped_frame_set_count: int
    lost_frame_set_count: int
    cameras: tuple[str, ...]
    closed: bool
    end_reason: str
    message: Any = field(repr=False)

    @staticmethod
    def of(recording: Any) -> "Recording":
        """From the daemon's message."""
        return Recording(
            recording.name,
            recording.start_time.ToNanoseconds(),
            recording.duration.ToNanoseconds() * 1e-9,
            recording.nominal_fps,
            recording.frame_set_count,
            recording.size_bytes,
            recording.dropped_frame_set_count,
            recording.lost_frame_set_count,
            tuple(recording.cameras),
            recording.closed,
            recording.end_reason,
            recording,
        )


@dataclass(frozen=True)
class RecorderStatus:
    """The state of the recorder.

    state: disabled (no folder for recordings), idle, waiting (for the first frame set), recording or finishing.
    current: being written; latest: ended last; None if there is none. folder: on the server. buffered_s: length of the
    rolling buffer's content. message: kinevox.v1.recording_service_pb2.GetRecorderStatusResponse.
    """

    state: str
    current: Recording | None
    latest: Recording | None
    folder: str
    free_bytes: int
    buffered_s: float
    message: Any = field(repr=False)

    @staticmethod
    def of(status: Any) -> "RecorderStatus":
        """From the daemon's message."""
        return RecorderStatus(
            enum_name(pb.RecorderState.DESCRIPTOR, status.state, "RECORDER_STATE_"),
            Recording.of(status.current) if status.HasField("current") else None,
            Recording.of(status.latest) if status.HasField("latest") else None,
            status.folder,
            status.free_bytes,
            status.buffered_duration.ToNanoseconds() * 1e-9,
            status,
        )


@dataclass(frozen=True)
class ExportPiece:
    """A chunk of an exported file. last_chunk: of this file. warning: one line, or empty. Without file_name: the
    progress of creating the files, 0 to 1."""

    file_name: str
    data: bytes
    last_chunk: bool
    warning: str
    progress: float

    @staticmethod
    def of(piece: Any, _: str = "") -> "ExportPiece":
        """From the daemon's message."""
        return ExportPiece(piece.file_name, piece.data, piece.last_chunk, piece.warning, piece.progress)


@dataclass(frozen=True)
class ExportOptions:
    """Options of Client.export; see there."""

    first_frame: int = 0
    last_frame: int | None = None
    yaw_deg: float = 0
    hold_withheld: bool = False
    camera: str = ""
    width_px: int = 0
    anonymous: bool = False
    subject_id: int = 0


def export_call(recording: str, format: Format, options: ExportOptions) -> StreamCall[ExportPiece]:
    """See Client.export."""
    value = pb.ExportFormat.DESCRIPTOR.values_by_name.get(f"EXPORT_FORMAT_{format.upper()}")
    if value is None or value.number == 0:
        raise ValueError(f"unknown format '{format}'; use trc, mot, c3d, bvh, csv, ply, mp4 or session")
    request = pb.ExportRecordingRequest(
        name=recording,
        format=value.number,
        first_frame=options.first_frame,
        last_frame=options.last_frame,  # None leaves it unset
        yaw_deg=options.yaw_deg,
        hold_withheld=options.hold_withheld,
        camera=options.camera,
        width_px=options.width_px,
        anonymous=options.anonymous,
        report_progress=True,
        subject_id=options.subject_id,
    )
    return StreamCall("RecordingService/ExportRecording", request, pb.ExportRecordingResponse, ExportPiece.of)


class Recordings(Service):
    """client.recordings. Changes acquire control."""

    def start(self, name: str = "", codec: Codec | None = None) -> str:
        """Starts a recording with the next frame set, or with the first one of a stopped capture; returns its name.

        name: 1 to 100 letters, digits, . _ -; default: date and time. codec: default: the daemon's. InvalidArgument,
        AlreadyExists, FailedPrecondition, ResourceExhausted (the disk is full).
        """
        value: Any = getattr(pb, f"RECORDING_CODEC_{codec.upper()}", None) if codec else 0
        if value is None:
            raise ValueError(f"unknown codec '{codec}'; use ffv1, utvideo or h264")
        return self._runner.run(
            Call(
                "RecordingService/StartRecording",
                pb.StartRecordingRequest(name=name, codec=value),
                pb.StartRecordingResponse,
                lambda answer: str(answer.name),
                True,
                START_TIMEOUT_S,
            )
        )

    def stop(self, timeout_s: float = START_TIMEOUT_S) -> Recording:
        """Stops the recording; returns it when everything is on disk. FailedPrecondition if nothing is recorded."""
        return self._runner.run(
            Call(
                "RecordingService/StopRecording",
                pb.StopRecordingRequest(),
                pb.StopRecordingResponse,
                lambda answer: Recording.of(answer.recording),
                True,
                timeout_s,
            )
        )

    def save_buffer(
        self,
        duration_s: float = 0,
        name: str = "",
        continue_recording: bool = False,
        timeout_s: float = START_TIMEOUT_S,
    ) -> Recording:
        """Saves the latest duration_s of the rolling buffer as a recording; 0: the whole buffer.

        continue_recording: continue recording without a gap. FailedPrecondition if the daemon has no buffer
        (max_buffer_s in its configuration).
        """
        request = pb.SaveBufferRequest(name=name, duration=duration(duration_s), continue_recording=continue_recording)
        return self._runner.run(
            Call(
                "RecordingService/SaveBuffer",
                request,
                pb.SaveBufferResponse,
                lambda answer: Recording.of(answer.recording),
                True,
                timeout_s,
            )
        )

    def status(self) -> RecorderStatus:
        """The state of the recorder. Cheap. Unavailable."""
        return self._runner.run(
            Call(
                "RecordingService/GetRecorderStatus",
                pb.GetRecorderStatusRequest(),
                pb.GetRecorderStatusResponse,
                RecorderStatus.of,
            )
        )

    def list(self) -> list[Recording]:
        """All recordings, oldest first."""
        return self._runner.run(
            Call(
                "RecordingService/ListRecordings",
                pb.ListRecordingsRequest(),
                pb.ListRecordingsResponse,
                lambda answer: [Recording.of(recording) for recording in answer.recordings],
            )
        )

    def get(self, name: str) -> Recording:
        """The recording of that name. NotFound."""
        return self._runner.run(
            Call(
                "RecordingService/GetRecording",
                pb.GetRecordingRequest(name=name),
                pb.GetRecordingResponse,
                lambda answer: Recording.of(answer.recording),
            )
        )

    def delete(self, name: str) -> None:
        """Deletes a recording. NotFound; FailedPrecondition for the one being written."""
        return self._runner.run(
            Call(
                "RecordingService/DeleteRecording",
                pb.DeleteRecordingRequest(name=name),
                pb.DeleteRecordingResponse,
                nothing,
                True,
                START_TIMEOUT_S,
            )
        )
