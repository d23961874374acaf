"""Making, judging, applying and exchanging calibrations; docs/calibration.md describes the procedures."""
from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from kinevox.calls import Call, StreamCall, duration, nothing
from kinevox.capture import Service, enum_name
from kinevox.transport import START_TIMEOUT_S
from kinevox.v1 import calibration_service_pb2 as pb

Kind = Literal["intrinsics", "extrinsics_board", "extrinsics_wand", "extrinsics_refine_person"]
Step = Literal["moving_target", "board_on_floor", "empty_scene", "pause"]
FileFormat = Literal["toml", "opencv", "kalibr", "qualisys"]


def _value(enum: Any, prefix: str, name: str, what: str) -> Any:
    found = enum.values_by_name.get(prefix + name.upper())
    if found is None or found.number == 0:
        names = ", ".join(value.name.removeprefix(prefix).lower() for value in enum.values if value.number)
        raise ValueError(f"unknown {what} '{name}'; use one of {names}")
    return found.number


def _verdict(value: int) -> str:
    return enum_name(pb.Verdict.DESCRIPTOR, value, "VERDICT_")


def _method(value: int) -> str:
    return enum_name(pb.CalibrationMethod.DESCRIPTOR, value, "CALIBRATION_METHOD_")


@dataclass(frozen=True)
class Procedure:
    """The state of the calibration procedure.

    state: none, collecting, reading_files, solving, solved, cancelled or failed. progress: of reading or solving, 0 to
    1. message: one line. hints: what to do next. sufficient: more observations would add little. calibration_id,
    verdict (go, caution, no_go): once solved. raw: kinevox.v1.calibration_service_pb2.WatchProcedureResponse.
    """

    state: str
    progress: float
    message: str
    hints: tuple[str, ...]
    sufficient: bool
    calibration_id: str
    verdict: str
    raw: Any = field(repr=False)

    @property
    def over(self) -> bool:
        """Whether the procedure has ended."""
        return self.state in ("none", "solved", "cancelled", "failed")

    @staticmethod
    def of(answer: Any, _: str = "") -> "Procedure":
        """From the daemon's message."""
        return Procedure(
            enum_name(pb.ProcedureState.DESCRIPTOR, answer.state, "PROCEDURE_STATE_"),
            answer.progress,
            answer.message,
            tuple(answer.hints),
            answer.sufficient,
            answer.calibration_id,
            _verdict(answer.verdict),
            answer,
        )


@dataclass(frozen=True)
class Calibration:
    """A stored calibration.

    id: "c7". create_time_ns: UTC. method: intrinsics_board, extrinsics_board, extrinsics_wand, person or import.
    verdict: go, caution, no_go or unspecified. compatible: it has all cameras of this daemon with their image sizes.
    """

    id: str
    create_time_ns: int
    method: str
    verdict: str
    note: str
    cameras: tuple[str, ...]
    active: bool
    compatible: bool

    @staticmethod
    def of(entry: Any) -> "Calibration":
        """From the daemon's message."""
        return Calibration(
            entry.id,
            entry.create_time.ToNanoseconds(),
            _method(entry.method),
            _verdict(entry.verdict),
            entry.note,
            tuple(entry.cameras),
            entry.active,
            entry.compatible,
        )


@dataclass(frozen=True)
class Certificate:
    """The quality of a calibration.

    verdict: go, caution or no_go. findings: (check, camera, reason, remedy). json: the complete certificate. page_png:
    a page of plots, empty unless requested. raw: kinevox.v1.calibration_service_pb2.Certificate.
    """

    verdict: str
    findings: tuple[tuple[str, str, str, str], ...]
    json: str
    page_png: bytes
    raw: Any = field(repr=False)

    @staticmethod
    def of(answer: Any) -> "Certificate":
        """From the daemon's answer."""
        certificate = answer.certificate
        findings = tuple((f.check, f.camera, f.reason, f.remedy) for f in certificate.findings)
        return Certificate(
            _verdict(certificate.verdict), findings, answer.certificate_json, answer.page_png, certificate
        )


class Calibrations(Service):
    """client.calibrations.

    A procedure is started, receives observations and is solved; client.calibration_progress() reports its state. It
    ends after idle_timeout_s without a watcher or a call. Changes acquire control. Errors: InvalidArgument,
    FailedPrecondition, NotFound, ResourceExhausted.
    """

    def list(self) -> list[Calibration]:
        """Stored calibrations, oldest first."""
        return self._runner.run(
            Call(
                "CalibrationService/ListCalibrations",
                pb.ListCalibrationsRequest(),
                pb.ListCalibrationsResponse,
                lambda answer: [Calibration.of(entry) for entry in answer.calibrations],
            )
        )

    def certificate(self, calibration_id: str, include_page: bool = False) -> Certificate:
        """The certificate of a stored calibration. include_page: with the page of plots, which takes some seconds."""
        request = pb.GetCertificateRequest(calibration_id=calibration_id, include_page=include_page)
        return self._runner.run(
            Call(
                "CalibrationService/GetCertificate",
                request,
                pb.GetCertificateResponse,
                Certificate.of,
                timeout_s=START_TIMEOUT_S,
            )
        )

    def apply(self, calibration_id: str, restart_capture: bool = False, force: bool = False) -> bool:
        """Applies a stored calibration at the capture's next start, or immediately with restart_capture.

        force: apply despite NO-GO or an undefined world frame. Returns whether it is active already.
        """
        request = pb.ApplyCalibrationRequest(
            calibration_id=calibration_id, restart_capture=restart_capture, force=force
        )
        return self._runner.run(
            Call(
                "CalibrationService/ApplyCalibration",
                request,
                pb.ApplyCalibrationResponse,
                lambda answer: bool(answer.active),
                True,
                START_TIMEOUT_S,
            )
        )

    def undo(self, restart_capture: bool = False) -> str:
        """Reverts to the previous calibration; returns its id, empty for the source's own."""
        return self._runner.run(
            Call(
                "CalibrationService/UndoCalibration",
                pb.UndoCalibrationRequest(restart_capture=restart_capture),
                pb.UndoCalibrationResponse,
                lambda answer: str(answer.calibration_id),
                True,
                START_TIMEOUT_S,
            )
        )

    def import_(self, data: bytes, format: FileFormat = "toml", note: str = "") -> str:
        """Stores a calibration file of at most 1 MB without applying it; returns its id."""
        value = _value(pb.CalibrationFormat.DESCRIPTOR, "CALIBRATION_FORMAT_", format, "format")
        return self._runner.run(
            Call(
                "CalibrationService/ImportCalibration",
                pb.ImportCalibrationRequest(data=data, format=value, note=note),
                pb.ImportCalibrationResponse,
                lambda answer: str(answer.calibration_id),
                True,
            )
        )

    def export(self, calibration_id: str = "", format: FileFormat = "toml") -> bytes:
        """The content of a calibration file; empty id: of the active calibration. Qualisys is for import only."""
        value = _value(pb.CalibrationFormat.DESCRIPTOR, "CALIBRATION_FORMAT_", format, "format")
        return self._runner.run(
            Call(
                "CalibrationService/ExportCalibration",
                pb.ExportCalibrationRequest(calibration_id=calibration_id, format=value),
                pb.ExportCalibrationResponse,
                lambda answer: bytes(answer.data),
            )
        )

    def delete(self, calibration_id: str) -> None:
        """Deletes a stored calibration that is neither active, pending nor needed by undo()."""
        return self._runner.run(
            Call(
                "CalibrationService/DeleteCalibration",
                pb.DeleteCalibrationRequest(calibration_id=calibration_id),
                pb.DeleteCalibrationResponse,
                nothing,
                True,
            )
        )

    def start(
        self,
        kind: Kind,
        *,
        cameras: Sequence[str] = (),
        board: str = "",
        wand: str = "",
        intrinsics_calibration_id: str = "",
        refine_intrinsics: bool = False,
        estimate_k3: bool = False,
        stature_m: float = 0,
        note: str = "",
        idle_timeout_s: float = 60,
    ) -> int:
        """Starts a procedure without observations; returns its id.

        board: for instance "charuco:4x5:54:40.5:DICT_4X4_1000" or "checkerboard:4x7:60"; wand: "wand:200:600"; lengths
        in mm. cameras: names, default all. intrinsics_calibration_id: for extrinsics, the calibration that supplies the
        intrinsics; default: the active one. estimate_k3: third radial coefficient, for very wide lenses. stature_m: for
        extrinsics_refine_person, 0.5 to 2.6, checks the scale; 0: unknown.
        """
        request = pb.StartProcedureRequest(
            kind=_value(pb.ProcedureKind.DESCRIPTOR, "PROCEDURE_KIND_", kind, "kind"),
            cameras=cameras,
            board=board,
            wand=wand,
            intrinsics_calibration_id=intrinsics_calibration_id,
            refine_intrinsics=refine_intrinsics,
            estimate_k3=estimate_k3,
            stature_m=stature_m,
            note=note,
            idle_timeout=duration(idle_timeout_s, "idle_timeout_s"),
        )
        return self._runner.run(
            Call(
                "CalibrationService/StartProcedure",
                request,
                pb.StartProcedureResponse,
                lambda answer: int(answer.procedure_id),
                True,
            )
        )

    def add_live(self, step: Step = "moving_target") -> None:
        """Collects frame sets of the running capture from now on: moving_target, the board, wand or person moves;
        board_on_floor; empty_scene; or pause."""
        value = _value(pb.LiveObservations.Step.DESCRIPTOR, "STEP_", step, "step")
        request = pb.AddObservationsRequest(live=pb.LiveObservations(step=value))
        return self._runner.run(
            Call("CalibrationService/AddObservations", request, pb.AddObservationsResponse, nothing, True)
        )

    def add_files(
        self,
        clips: Mapping[str, str | os.PathLike[str]] | None = None,
        *,
        stride: int = 0,
        board_on_floor_frame: int | None = None,
        session_path: str | os.PathLike[str] = "",
    ) -> None:
        """Reads files on the daemon's machine, absolute paths.

        clips: the video, image or folder of images of each camera. session_path: a session.toml, for
        extrinsics_refine_person. stride: use every stride-th image; 0: each. board_on_floor_frame: the image, from 0,
        with the board on the floor.
        """
        files = pb.FileObservations(
            stride=stride,
            session_path=os.fspath(session_path),
            board_on_floor_frame=board_on_floor_frame,  # None leaves it unset
            clips=[pb.CameraClip(camera=camera, path=os.fspath(file)) for camera, file in (clips or {}).items()],
        )
        return self._runner.run(
            Call(
                "CalibrationService/AddObservations",
                pb.AddObservationsRequest(files=files),
                pb.AddObservationsResponse,
                nothing,
                True,
                START_TIMEOUT_S,
            )
        )

    def solve(self) -> None:
        """Starts to solve; client.calibration_progress() reports the calibration's id at the end."""
        return self._runner.run(
            Call(
                "CalibrationService/SolveProcedure",
                pb.SolveProcedureRequest(),
                pb.SolveProcedureResponse,
                nothing,
                True,
            )
        )

    def cancel(self, keep_observations: bool = False) -> None:
        """Cancels the procedure; with keep_observations only its solving or reading of files."""
        return self._runner.run(
            Call(
                "CalibrationService/CancelProcedure",
                pb.CancelProcedureRequest(keep_observations=keep_observations),
                pb.CancelProcedureResponse,
                nothing,
                True,
            )
        )


def progress_call() -> StreamCall[Procedure]:
    """See Client.calibration_progress."""
    return StreamCall(
        "CalibrationService/WatchProcedure", pb.WatchProcedureRequest(), pb.WatchProcedureResponse, Procedure.of
    )
