"""Calibrations: making, judging, applying and exchanging them. docs/calibration.md tells how to make a good one."""
from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

from kinevox.calls import Call, StreamCall, nothing
from kinevox.capture import Service, enum_name
from kinevox.transport import START_TIMEOUT_S
from kinevox.v1 import calibration_service_pb2 as pb

Kind = Literal["intrinsics", "extrinsics_board", "extrinsics_wand", "refine_person"]
What = Literal["moving", "board_on_floor", "empty_scene", "pause"]
FileFormat = Literal["toml", "opencv", "kalibr", "qualisys"]


def _value(enum: Any, prefix: str, name: str, what: str) -> Any:
    found = enum.values_by_name.get(prefix + name.upper())
    if found is None or found.number == 0:
        names = ", ".join(value.name.removeprefix(prefix).lower() for value in enum.values if value.number)
        raise ValueError(f"there is no {what} '{name}'; take one of {names}")
    return found.number


def _verdict(value: int) -> str:
    return enum_name(pb.Verdict.DESCRIPTOR, value, "VERDICT_")


@dataclass(frozen=True)
class Procedure:
    """How far the procedure is. state: none, collecting, reading, solving, solved, cancelled or failed. part: of
    reading or solving, 0 to 1. message: one line. hints: what to do next. complete: more observations would add
    little. calibration_id, verdict (go, care, no_go): once solved. raw: all of it, WatchProcedureResponse."""

    state: str
    part: float
    message: str
    hints: tuple[str, ...]
    complete: bool
    calibration_id: str
    verdict: str
    raw: Any = field(repr=False)

    @property
    def over(self) -> bool:
        """Nothing more will come of it."""
        return self.state in ("none", "solved", "cancelled", "failed")

    @staticmethod
    def of(answer: Any, _: str = "") -> "Procedure":
        """From the daemon's message."""
        return Procedure(enum_name(pb.ProcedureState.DESCRIPTOR, answer.state, "PROCEDURE_STATE_"), answer.part,
                         answer.message, tuple(answer.hints), answer.complete, answer.calibration_id, _verdict(answer.verdict), answer)


@dataclass(frozen=True)
class Calibration:
    """A stored calibration. id: "c7". time_ns: UTC, when it was stored. made_by: board, wand, person, lenses or import.
    verdict: go, care, no_go or unspecified. fits: it has all of this daemon's cameras at their sizes."""

    id: str
    time_ns: int
    made_by: str
    verdict: str
    note: str
    cameras: tuple[str, ...]
    in_use: bool
    fits: bool


@dataclass(frozen=True)
class Certificate:
    """What is known about a calibration's quality. verdict: go, care or no_go. findings: (check, camera, reason,
    remedy). json: all of it as text. page_png: a page of pictures, empty unless it was asked for. raw: the daemon's
    message, Certificate."""

    verdict: str
    findings: tuple[tuple[str, str, str, str], ...]
    json: str
    page_png: bytes
    raw: Any = field(repr=False)


class Calibrations(Service):
    """client.calibrations. A procedure is started, fed with observations, solved, and watched meanwhile by
    client.calibration_progress(); it ends by itself when nobody watches it or calls for a minute. Changes take control
    for the moment. Errors: InvalidArgument, FailedPrecondition, NotFound, ResourceExhausted."""

    def list(self) -> list[Calibration]:
        """The stored ones, oldest first."""
        return self._runner.run(Call(
            "CalibrationService/ListCalibrations", pb.ListCalibrationsRequest(), pb.ListCalibrationsResponse,
            lambda answer: [Calibration(entry.id, entry.time_ns, entry.made_by, _verdict(entry.verdict), entry.note,
                                        tuple(entry.cameras), entry.in_use, entry.fits)
                            for entry in answer.calibrations]))

    def certificate(self, id: str, with_page: bool = False) -> Certificate:
        """Of a stored one. with_page: also the page of pictures, which takes some seconds."""
        return self._runner.run(Call(
            "CalibrationService/GetCertificate", pb.GetCertificateRequest(id=id, with_page=with_page),
            pb.GetCertificateResponse,
            lambda answer: Certificate(_verdict(answer.certificate.verdict),
                                       tuple((f.check, f.camera, f.reason, f.remedy)
                                             for f in answer.certificate.findings),
                                       answer.json, answer.page_png, answer.certificate), timeout_s=START_TIMEOUT_S))

    def apply(self, id: str, restart_capture: bool = False, although_bad: bool = False) -> bool:
        """Takes it into use, at the capture's next start or, with restart_capture, now. although_bad: even if its
        verdict is NO-GO or its world is not set. Whether it is in use already."""
        request = pb.ApplyCalibrationRequest(id=id, restart_capture=restart_capture, although_bad=although_bad)
        return self._runner.run(Call("CalibrationService/ApplyCalibration", request, pb.ApplyCalibrationResponse,
                                     lambda answer: bool(answer.in_use), True, START_TIMEOUT_S))

    def undo(self, restart_capture: bool = False) -> str:
        """Back to what was in use before; returns its id, empty: the source's own."""
        return self._runner.run(Call("CalibrationService/UndoCalibration",
                                     pb.UndoCalibrationRequest(restart_capture=restart_capture),
                                     pb.UndoCalibrationResponse,
                                     lambda answer: str(answer.id), True, START_TIMEOUT_S))

    def import_(self, text: bytes, form: FileFormat = "toml", note: str = "") -> str:
        """Stores a calibration of this or another program, 1 MB at most; returns its id. It is not applied."""
        value = _value(pb.CalibrationFormat.DESCRIPTOR, "CALIBRATION_FORMAT_", form, "format")
        return self._runner.run(Call("CalibrationService/ImportCalibration",
                                     pb.ImportCalibrationRequest(text=text, format=value, note=note),
                                     pb.ImportCalibrationResponse, lambda answer: str(answer.id), True))

    def export(self, id: str = "", form: FileFormat = "toml") -> bytes:
        """A calibration as the content of a file; empty id: the one in use. Qualisys is for import only."""
        value = _value(pb.CalibrationFormat.DESCRIPTOR, "CALIBRATION_FORMAT_", form, "format")
        return self._runner.run(Call("CalibrationService/ExportCalibration",
                                     pb.ExportCalibrationRequest(id=id, format=value), pb.ExportCalibrationResponse,
                                     lambda answer: bytes(answer.text)))

    def remove(self, id: str) -> None:
        """Deletes a stored one that is neither in use nor to be undone to."""
        return self._runner.run(Call("CalibrationService/RemoveCalibration", pb.RemoveCalibrationRequest(id=id),
                                     pb.RemoveCalibrationResponse, nothing, True))

    def begin(self, kind: Kind, *, cameras: Sequence[str] = (), board: str = "", wand: str = "", lenses_from: str = "",
              refine_lenses: bool = False, k3: bool = False, subject_height_m: float = 0, note: str = "",
              abandon_after_s: float = 60) -> int:
        """Begins a procedure; returns its number.

        kind: intrinsics (lenses), extrinsics_board, extrinsics_wand (places) or refine_person. board: for instance
        "charuco:4x5:54:40.5:DICT_4X4_1000" or "checkerboard:4x7:60"; wand: "wand:200:600"; lengths there in mm.
        lenses_from: id whose lenses are taken. subject_height_m: 0.5 to 2.6, checks the scale; 0: not known.

        """
        request = pb.StartProcedureRequest(
            kind=_value(pb.ProcedureKind.DESCRIPTOR, "PROCEDURE_KIND_", kind, "kind"), cameras=cameras, board=board,
            wand=wand, lenses_from=lenses_from, refine_lenses=refine_lenses, k3=k3, subject_height_m=subject_height_m, note=note,
            abandon_after_ms=int(1000 * abandon_after_s))
        return self._runner.run(Call("CalibrationService/StartProcedure", request, pb.StartProcedureResponse,
                                     lambda answer: int(answer.procedure), True))

    def observe(self, what: What = "moving") -> None:
        """Takes frame sets of the running capture from now on: the board, wand or person moves; the board lies on the
        floor; the scene is empty; or pause."""
        value = _value(pb.LiveObservations.What.DESCRIPTOR, "WHAT_", what, "observation")
        request = pb.AddObservationsRequest(live=pb.LiveObservations(what=value))
        return self._runner.run(Call("CalibrationService/AddObservations", request, pb.AddObservationsResponse,
                                     nothing, True))

    def observe_files(self, clips: Mapping[str, str | os.PathLike[str]] | None = None, *, every: int = 0,
                      floor_frame: int | None = None, session: str = "") -> None:
        """Reads files on the daemon's machine, absolute paths: a clip for each camera's name, or, for refine_person, a
        session. every: so many pictures only one. floor_frame: in which the board lies on the floor."""
        files = pb.FileObservations(every=every, session=session,
                                    clips=[pb.CameraClip(camera=camera, file=os.fspath(file))
                                           for camera, file in (clips or {}).items()])
        if floor_frame is not None:
            files.floor_frame = floor_frame
        return self._runner.run(Call("CalibrationService/AddObservations", pb.AddObservationsRequest(files=files),
                                     pb.AddObservationsResponse, nothing, True, START_TIMEOUT_S))

    def solve(self) -> None:
        """Begins to solve what was observed; the progress ends with the calibration's id."""
        return self._runner.run(Call("CalibrationService/SolveProcedure", pb.SolveProcedureRequest(),
                                     pb.SolveProcedureResponse, nothing, True))

    def cancel(self, keep_observations: bool = False) -> None:
        """Ends the procedure, or, keeping what was observed, its reading or solving alone."""
        return self._runner.run(Call("CalibrationService/CancelProcedure",
                                     pb.CancelProcedureRequest(keep_observations=keep_observations),
                                     pb.CancelProcedureResponse, nothing, True))


def progress_call() -> StreamCall[Procedure]:
    """See Client.calibration_progress."""
    return StreamCall("CalibrationService/WatchProcedure", pb.WatchProcedureRequest(), pb.WatchProcedureResponse,
                      Procedure.of)
