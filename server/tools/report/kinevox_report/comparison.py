"""Two processed trials of one recording: the differences of angles and joints at equal times."""
import json
from pathlib import Path

import numpy as np

from .body_table import JOINT_NAMES
from .trial import ReportError, column, one_subject, read_table, tables_folder

KEY_COLUMNS = ("frame", "time_s", "subject")
MAX_TIME_DIFFERENCE = 0.25  # of a frame


def rows_of_both(a_file, a, b_file, b):
    """The rows of either table at the times that both have. Equal times must have equal frame numbers."""
    times = [column(t, "time_s", f) for t, f in ((a, a_file), (b, b_file))]
    for file, values in ((a_file, times[0]), (b_file, times[1])):
        if not np.isfinite(values).all() or not (np.diff(values) > 0).all():
            raise ReportError(f"{file}: time_s does not increase from row to row; rerun `kinevox process`")
    steps = np.concatenate([np.diff(t) for t in times])
    tolerance_s = MAX_TIME_DIFFERENCE * float(np.median(steps)) if len(steps) else 1e-3
    nearest = np.clip(np.searchsorted(times[1], times[0]), 1, max(len(times[1]) - 1, 1))
    before = np.maximum(nearest - 1, 0)
    nearest = np.minimum(nearest, len(times[1]) - 1)
    nearest = np.where(np.abs(times[1][before] - times[0]) <= np.abs(times[1][nearest] - times[0]), before, nearest)
    in_a = np.flatnonzero(np.abs(times[1][nearest] - times[0]) <= tolerance_s)
    in_b = nearest[in_a]
    if len(in_a) == 0:
        raise ReportError(f"{a_file} and {b_file} have no time in common; give two trials of one recording")
    frames_a, frames_b = (column(t, "frame", f)[rows] for t, f, rows in ((a, a_file, in_a), (b, b_file, in_b)))
    if not np.array_equal(frames_a, frames_b):
        n = np.flatnonzero(frames_a != frames_b)[0]
        raise ReportError(
            f"at {times[0][in_a[n]]:.3f} s {a_file} has frame {frames_a[n]:.0f}, but {b_file} frame "
            f"{frames_b[n]:.0f}; process both with the same offsets and first frame"
        )
    return in_a, in_b


class Difference:
    """B minus A over the frames in which both have a value. Empty statistics are NaN."""

    def __init__(self, name, a, b):
        self.name, self.a, self.b = name, a, b
        self.values = (b - a).ravel() if a.ndim == 1 else np.linalg.norm(b - a, axis=1)
        good = self.values[np.isfinite(self.values)]
        self.count = len(good)
        self.mean = float(good.mean()) if self.count else float("nan")
        self.rms = float(np.sqrt((good**2).mean())) if self.count else float("nan")
        self.max = float(np.abs(good).max()) if self.count else float("nan")
        there_a, there_b = (np.isfinite(x if x.ndim == 1 else x[:, 0]) for x in (a, b))
        self.only_a, self.only_b = int((there_a & ~there_b).sum()), int((there_b & ~there_a).sum())


class Comparison:
    def __init__(self, a_folder, b_folder, subject=None):
        self.folders = Path(a_folder), Path(b_folder)
        tables = [tables_folder(f)[0] for f in self.folders]
        files, a, b, in_a, in_b = self._both(tables, "angles.csv", subject)
        self.frames = a["frame"][in_a].astype(int)
        self.time_s = a["time_s"][in_a]
        self.unmatched = len(a["frame"]) + len(b["frame"]) - 2 * len(in_a)
        names = [n for n in a if n not in KEY_COLUMNS and n in b]
        if not names:
            raise ReportError(f"{files[0]} and {files[1]} have no angle in common; rerun `kinevox process`")
        self.angles = [Difference(n.removesuffix("_deg"), a[n][in_a], b[n][in_b]) for n in names]
        files, a, b, in_a, in_b = self._both(tables, "joints.csv", subject)
        self.joints = []  # mm
        for joint in JOINT_NAMES:
            positions = [
                1000 * np.stack([column(t, f"{joint}_{axis}", f)[rows] for axis in "xyz"], 1)
                for t, f, rows in ((a, files[0], in_a), (b, files[1], in_b))
            ]
            self.joints.append(Difference(joint, *positions))

    @staticmethod
    def _both(folders, name, subject):
        files = [f / name for f in folders]
        a, b = (one_subject(read_table(f), f, subject) for f in files)
        return files, a, b, *rows_of_both(files[0], a, files[1], b)

    def same(self):
        """Identical to the last digit, including withheld values."""
        every = self.angles + self.joints
        return self.unmatched == 0 and all(d.only_a == d.only_b == 0 and not d.max > 0 for d in every)

    def text(self):
        lines = [f"{len(self.frames)} frames in both" + (f", {self.unmatched} in only one" if self.unmatched else "")]
        if self.same():
            return "\n".join(lines + ["identical to the last digit"]) + "\n"
        lines += [
            "",
            f"{'geometric angle, deg':32}{'mean':>9}{'RMS':>9}{'max':>9}{'frames':>8}{'only A':>8}{'only B':>8}",
        ]
        for d in sorted(self.angles, key=lambda d: -np.nan_to_num(d.rms, nan=-1)):
            lines.append(f"{d.name:32}{d.mean:9.3f}{d.rms:9.3f}{d.max:9.3f}{d.count:8}{d.only_a:8}{d.only_b:8}")
        lines += ["", f"{'joint, mm':32}{'mean':>9}{'RMS':>9}{'max':>9}{'frames':>8}{'only A':>8}{'only B':>8}"]
        for d in self.joints:
            lines.append(f"{d.name:32}{d.mean:9.2f}{d.rms:9.2f}{d.max:9.2f}{d.count:8}{d.only_a:8}{d.only_b:8}")
        return "\n".join(lines) + "\n"

    def json(self):
        def rows(differences):
            return [
                {
                    "name": d.name,
                    **{
                        key: None if np.isnan(value) else value
                        for key, value in (("mean", float(d.mean)), ("rms", float(d.rms)), ("max", float(d.max)))
                    },
                    "frame_count": int(d.count),
                    "only_a_count": int(d.only_a),
                    "only_b_count": int(d.only_b),
                }
                for d in differences
            ]

        return (
            json.dumps(
                {
                    "frame_count": len(self.frames),
                    "unmatched_count": int(self.unmatched),
                    "identical": bool(self.same()),
                    "angles_deg": rows(self.angles),
                    "joints_mm": rows(self.joints),
                }
            )
            + "\n"
        )

    def csv(self):
        lines = ["name,unit,mean,rms,max,frames,only_a,only_b"]
        for unit, differences in (("deg", self.angles), ("mm", self.joints)):
            for d in differences:
                statistics = ["" if np.isnan(v) else f"{v:.6g}" for v in (d.mean, d.rms, d.max)]
                lines.append(",".join([d.name, unit, *statistics, str(d.count), str(d.only_a), str(d.only_b)]))
        return "\n".join(lines) + "\n"
