"""A processed trial's folder as `kinevox process` leaves it, for one page. Messages are one line each: ReportError."""
import csv
import tomllib
from pathlib import Path

import numpy as np

SIDED_ANGLES = ("hip_flexion", "knee_flexion", "hip_abduction", "shoulder_elevation", "elbow_flexion")
STAGES = ("segmentation", "tracking", "hull", "colouring", "pose")
SIDED_JOINTS = ("shoulder", "elbow", "wrist", "hand", "hip", "knee", "ankle", "toe")
JOINTS = ("root", "sacroiliac", "skullbase", "head_top", *(f"{j}_{s}" for s in "lr" for j in SIDED_JOINTS))


class ReportError(Exception):
    """One line: what is wrong, where, what to do."""


def read_table(file):
    """A CSV as {column: array}; empty cells are NaN."""
    try:
        with open(file, newline="", encoding="utf-8") as f:
            lines = list(csv.reader(f))
    except FileNotFoundError:
        raise ReportError(f"{file}: no such file; give a folder that `kinevox process` wrote, with poses") from None
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise ReportError(f"{file}: cannot be read: {error}") from None
    if len(lines) < 2:
        raise ReportError(f"{file}: holds no frames; there is nothing to report")
    columns = [[] for _ in lines[0]]
    for number, line in enumerate(lines[1:], 2):
        if len(line) != len(columns):
            raise ReportError(f"{file}:{number}: {len(line)} cells, expected {len(columns)}; "
                              "write it anew with `kinevox process`")
        for name, column, cell in zip(lines[0], columns, line):
            try:
                column.append(float(cell) if cell else np.nan)
            except ValueError:
                column.append(np.inf)
            if np.isinf(column[-1]) or cell.strip().lower() == "nan":
                raise ReportError(f"{file}:{number}: {name} is '{cell[:40]}', expected a number or nothing")
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
        raise ReportError(f"{file}: has no column {name}; write it anew with `kinevox process`")
    return table[name]


class Trial:
    """frames, time_s (n); joints {name: (n, 3) m}; angles {name: (n) deg} and their std, NaN where withheld."""

    def __init__(self, folder):
        self.folder = Path(folder)
        if not self.folder.is_dir():
            raise ReportError(f"{folder}: no such folder; give the folder that `kinevox process` wrote")
        file = self.folder / "joints.csv"
        table = read_table(file)
        frames, self.time_s = column(table, "frame", file), column(table, "time_s", file)
        for what, values in (("frame", frames), ("time_s", self.time_s)):
            if not np.isfinite(values).all() or not (np.diff(values) > 0).all():
                raise ReportError(f"{file}: {what} does not rise from row to row; write it anew with `kinevox process`")
        self.frames = frames.astype(int)
        self.joints = {j: np.stack([column(table, f"{j}_{axis}", file) for axis in "xyz"], 1) for j in JOINTS}
        self.angles = self._angles("angles.csv", "{}_deg")
        self.std = self._angles("uncertainty.csv", "{}_std_deg") if self._has("uncertainty.csv") else {}
        self.run = read_toml(self.folder / "run.toml") if self._has("run.toml") else {}
        self.stage_ms = self._stage_times() if self._has("timing.csv") else {}
        if not any(np.isfinite(a).any() for a in self.angles.values()):
            raise ReportError(f"{self.folder / 'angles.csv'}: every angle of every frame is withheld; there is nothing "
                              "to report, and withheld.csv beside it says why")

    def _has(self, name):
        return (self.folder / name).is_file()

    def _angles(self, name, pattern):
        file = self.folder / name
        table = read_table(file)
        if not np.array_equal(column(table, "frame", file), self.frames):
            raise ReportError(f"{file}: its frames are not those of joints.csv; both must be of one run")
        names = [f"{a}_{side}" for a in SIDED_ANGLES for side in "lr"] + ["trunk_lean"]
        return {n: column(table, pattern.format(n), file) for n in names}

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

    def withheld_share(self):
        """Of all joints' and angles' values."""
        values = [p[:, 0] for p in self.joints.values()] + list(self.angles.values())
        return float(np.mean([np.isnan(v).mean() for v in values]))

    def speed(self, name):
        """deg/s by differences over two frames; NaN beside what is withheld."""
        out = np.full(len(self.time_s), np.nan)
        if len(out) > 2:
            out[1:-1] = (self.angles[name][2:] - self.angles[name][:-2]) / (self.time_s[2:] - self.time_s[:-2])
        return out

    def length_mm(self, a, b):
        """Median distance of two joints; NaN if never both measured."""
        lengths = 1000 * np.linalg.norm(self.joints[a] - self.joints[b], axis=1)
        return float(np.median(lengths[np.isfinite(lengths)])) if np.isfinite(lengths).any() else float("nan")


def spread(values):
    """Least and largest, NaN where nothing was measured."""
    good = values[np.isfinite(values)]
    return (float(good.min()), float(good.max())) if len(good) else (float("nan"), float("nan"))
