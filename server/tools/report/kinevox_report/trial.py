"""A processed trial or a recording with poses, for one page. Messages are one line each: ReportError."""
import csv
import json
import tomllib
from pathlib import Path

import numpy as np

from .body_table import GEOMETRIC_ANGLE_LABELS, GEOMETRIC_ANGLE_NAMES, JOINT_NAMES

# Base names of angles with a left and a right side, in the order of angles.csv.
SIDED_ANGLES = tuple(dict.fromkeys(n[:-2] for n in GEOMETRIC_ANGLE_NAMES if n.endswith(("_l", "_r"))))
STAGES = ("segmentation", "tracking", "hull", "colouring", "pose")


class ReportError(Exception):
    """One line: what is wrong, where, what to do."""


def read_table(file):
    """A CSV as {column: array}; empty cells are NaN."""
    try:
        with open(file, newline="", encoding="utf-8") as f:
            lines = list(csv.reader(f))
    except FileNotFoundError:
        raise ReportError(f"{file}: no such file; give a folder with poses that `kinevox process` wrote") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ReportError(f"{file}: cannot be read: {error}") from None
    if len(lines) < 2:
        raise ReportError(f"{file}: has no frames; there is nothing to report")
    columns = [[] for _ in lines[0]]
    for number, line in enumerate(lines[1:], 2):
        if len(line) != len(columns):
            raise ReportError(
                f"{file}:{number}: {len(line)} cells, expected {len(columns)}; " "rerun `kinevox process`"
            )
        for name, column, cell in zip(lines[0], columns, line):
            try:
                column.append(float(cell) if cell else np.nan)
            except ValueError:
                column.append(np.inf)
            if np.isinf(column[-1]) or cell.strip().lower() == "nan":
                raise ReportError(f"{file}:{number}: {name} is '{cell[:40]}', expected a number or an empty cell")
    return {name: np.array(column) for name, column in zip(lines[0], columns)}


def read_toml(file):
    try:
        return tomllib.loads(Path(file).read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ReportError(f"{file}: no such file; check the path") from None
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ReportError(f"{file}: cannot be read: {str(error).splitlines()[0]}") from None


def column(table, name, file):
    if name not in table:
        raise ReportError(f"{file}: has no column {name}; rerun `kinevox process`")
    return table[name]


def label_of(angle):
    """ "Knee flexion" of knee_flexion_geometric_l."""
    return GEOMETRIC_ANGLE_LABELS[angle.removesuffix("_l").removesuffix("_r").removesuffix("_geometric")]


def one_subject(table, file, subject=None):
    """The rows of one subject, one per frame: of `subject`, else of the only one in each frame."""
    frames, ids = column(table, "frame", file), column(table, "subject", file)
    if subject is not None:
        keep = ids == subject
        if not keep.any():
            has = ", ".join(f"{i:.0f}" for i in np.unique(ids[np.isfinite(ids)])) or "none"
            raise ReportError(f"{file}: has no subject {subject}; it has {has}")
        keep |= ~np.isin(frames, frames[keep]) & np.r_[True, np.diff(frames) != 0]  # one row of each other frame
        table = {
            n: np.where((ids == subject) | np.isin(n, ["frame", "time_s"]), v, np.nan)[keep] for n, v in table.items()
        }
        return table
    if len(np.unique(frames)) < len(frames) and np.isfinite(ids).any():
        repeated = np.isin(frames, frames[1:][np.diff(frames) == 0])
        several = np.unique(ids[repeated & np.isfinite(ids)])
        if len(several) > 1:
            raise ReportError(
                f"{file}: has subjects {', '.join(f'{i:.0f}' for i in several)}; choose one with --subject"
            )
    return table


def tables_folder(folder):
    """Where the pose tables are, and the session file of a recording: (Path, Path or None)."""
    folder = Path(folder)
    if not folder.is_dir():
        raise ReportError(f"{folder}: no such folder; give a folder that `kinevox process` wrote, or a recording's")
    session = folder / "session.toml"
    if (folder / "joints.csv").is_file() or not session.is_file():
        return folder, session if session.is_file() else None
    recording = read_toml(session).get("recording")
    if not isinstance(recording, dict) or not recording.get("poses"):
        raise ReportError(f"{session}: contains no poses; run `kinevox process` and report its results")
    return folder / recording["poses"], session


def read_names(folder):
    """{id: name} of subjects.csv; empty without the file."""
    file = Path(folder) / "subjects.csv"
    if not file.is_file():
        return {}
    try:
        with open(file, newline="", encoding="utf-8") as f:
            header, *lines = list(csv.reader(f)) or [[]]
        if header != ["subject", "name"]:
            raise ValueError("its columns are not subject,name")
        return {int(number): name for number, name in lines}
    except (OSError, ValueError, csv.Error) as error:
        raise ReportError(f"{file}: cannot be read: {error}; correct it") from None


def subject_name(names, table, file, subject=None):
    """Of `subject`; else the name that all subjects of the table have. Empty: none."""
    if subject is not None or not names:
        return names.get(subject, "")
    ids = column(table, "subject", file)
    distinct = {names.get(int(i), "") for i in np.unique(ids[np.isfinite(ids)])}
    return distinct.pop() if len(distinct) == 1 else ""


class Trial:
    """frames, time_s (n); joints {name: (n, 3) m}; angles {name: (n) deg} and their std, NaN where withheld.
    `folder`: results of `kinevox process`, or a recording; `session_file`: of a recording, else None.
    `subject_name`: empty without one."""

    def __init__(self, folder, subject=None):
        self.name = Path(folder).absolute().name
        self.folder, self.session_file = tables_folder(folder)
        self.subject = subject
        file = self.folder / "joints.csv"
        table = one_subject(read_table(file), file, subject)
        self.subject_name = subject_name(read_names(self.folder), table, file, subject)
        frames, self.time_s = column(table, "frame", file), column(table, "time_s", file)
        for what, values in (("frame", frames), ("time_s", self.time_s)):
            if not np.isfinite(values).all() or not (np.diff(values) > 0).all():
                raise ReportError(f"{file}: {what} does not increase from row to row; rerun `kinevox process`")
        self.frames = frames.astype(int)
        self.joints = {j: np.stack([column(table, f"{j}_{axis}", file) for axis in "xyz"], 1) for j in JOINT_NAMES}
        self.angles = self._angles("angles.csv", "{}_deg")
        self.std = self._angles("uncertainty.csv", "{}_std_deg") if self._has("uncertainty.csv") else {}
        self.run = read_toml(self.folder / "run.toml") if self._has("run.toml") else {}
        self.quality = self._read_quality() if self._has("quality.json") else {}
        self.stage_ms = self._stage_times() if self._has("timing.csv") else {}
        if not any(np.isfinite(a).any() for a in self.angles.values()):
            raise ReportError(
                f"{self.folder / 'angles.csv'}: every angle of every frame is withheld, there is nothing "
                "to report; see withheld.csv for the reasons"
            )

    def _has(self, name):
        return (self.folder / name).is_file()

    def _angles(self, name, pattern):
        file = self.folder / name
        table = one_subject(read_table(file), file, self.subject)
        if not np.array_equal(column(table, "frame", file), self.frames):
            raise ReportError(f"{file}: its frames are not those of joints.csv; both must be from one run")
        return {n: column(table, pattern.format(n), file) for n in GEOMETRIC_ANGLE_NAMES}

    def _read_quality(self):
        """{verdict, cause: None or {cause, reason, remedy}}."""
        file = self.folder / "quality.json"
        try:
            quality = json.loads(file.read_text())
            cause = quality["cause"]
            return {
                "verdict": str(quality["verdict"]),
                "cause": cause and {key: str(cause[key]) for key in ("cause", "reason", "remedy")},
            }
        except (ValueError, KeyError, TypeError) as error:
            raise ReportError(f"{file}: is not a verdict of `kinevox process` ({error}); rerun it") from error

    def _stage_times(self):
        """{stage: (n) ms}, "total" among them."""
        file = self.folder / "timing.csv"
        table = read_table(file)
        return {s: column(table, f"{s}_ms", file) for s in (*STAGES, "total")}

    @property
    def duration_s(self):
        return float(self.time_s[-1] - self.time_s[0]) if len(self.time_s) > 1 else 0.0

    @property
    def rate_hz(self):
        return (len(self.time_s) - 1) / self.duration_s if self.duration_s > 0 else float("nan")

    def withheld_fraction(self):
        """Of all values of joints and angles."""
        values = [p[:, 0] for p in self.joints.values()] + list(self.angles.values())
        return float(np.mean([np.isnan(v).mean() for v in values]))

    def speed(self, name):
        """deg/s by differences over two frames; NaN next to withheld values."""
        out = np.full(len(self.time_s), np.nan)
        if len(out) > 2:
            out[1:-1] = (self.angles[name][2:] - self.angles[name][:-2]) / (self.time_s[2:] - self.time_s[:-2])
        return out

    def length_mm(self, a, b):
        """Median distance of two joints; NaN if never both measured."""
        lengths = 1000 * np.linalg.norm(self.joints[a] - self.joints[b], axis=1)
        return float(np.median(lengths[np.isfinite(lengths)])) if np.isfinite(lengths).any() else float("nan")


def spread(values):
    """Minimum and maximum, NaN if nothing was measured."""
    good = values[np.isfinite(values)]
    return (float(good.min()), float(good.max())) if len(good) else (float("nan"), float("nan"))
