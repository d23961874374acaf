"""Two processed trials of one recording: by how much each angle and each joint differs, frame by frame."""
from pathlib import Path

import numpy as np

from .trial import JOINTS, ReportError, column, read_table


def rows_of_both(a_file, a, b_file, b):
    """The rows of either table whose frames both have."""
    frames = [column(t, "frame", f) for t, f in ((a, a_file), (b, b_file))]
    for file, values in ((a_file, frames[0]), (b_file, frames[1])):
        if not np.isfinite(values).all() or not (np.diff(values) > 0).all():
            raise ReportError(f"{file}: frame does not rise from row to row; write it anew with `kinevox process`")
    _, in_a, in_b = np.intersect1d(*frames, assume_unique=True, return_indices=True)
    if len(in_a) == 0:
        raise ReportError(f"{a_file} and {b_file} have no frame in common; give two trials of one recording")
    return in_a, in_b


class Difference:
    """B minus A over the frames that have both. Empty figures are NaN."""

    def __init__(self, name, a, b):
        self.name, self.a, self.b = name, a, b
        self.values = (b - a).ravel() if a.ndim == 1 else np.linalg.norm(b - a, axis=1)
        good = self.values[np.isfinite(self.values)]
        self.count = len(good)
        self.mean = float(good.mean()) if self.count else float("nan")
        self.rms = float(np.sqrt((good ** 2).mean())) if self.count else float("nan")
        self.max = float(np.abs(good).max()) if self.count else float("nan")
        there_a, there_b = (np.isfinite(x if x.ndim == 1 else x[:, 0]) for x in (a, b))
        self.only_a, self.only_b = int((there_a & ~there_b).sum()), int((there_b & ~there_a).sum())


class Comparison:
    def __init__(self, a_folder, b_folder):
        self.folders = Path(a_folder), Path(b_folder)
        for folder in self.folders:
            if not folder.is_dir():
                raise ReportError(f"{folder}: no such folder; give two folders that `kinevox process` wrote")
        files = [f / "angles.csv" for f in self.folders]
        a, b = map(read_table, files)
        in_a, in_b = rows_of_both(files[0], a, files[1], b)
        self.frames = a["frame"][in_a].astype(int)
        self.time_s = column(a, "time_s", files[0])[in_a]
        self.left_out = len(a["frame"]) + len(b["frame"]) - 2 * len(in_a)
        names = [n for n in a if n.endswith("_deg") and n in b]
        if not names:
            raise ReportError(f"{files[0]} and {files[1]} have no angle in common; write them anew with `kinevox process`")
        self.angles = [Difference(n.removesuffix("_deg"), a[n][in_a], b[n][in_b]) for n in names]
        files = [f / "joints.csv" for f in self.folders]
        a, b = map(read_table, files)
        in_a, in_b = rows_of_both(files[0], a, files[1], b)
        self.joints = []   # mm
        for joint in JOINTS:
            places = [1000 * np.stack([column(t, f"{joint}_{axis}", f)[rows] for axis in "xyz"], 1)
                      for t, f, rows in ((a, files[0], in_a), (b, files[1], in_b))]
            self.joints.append(Difference(joint, *places))

    def same(self):
        """To the last digit, withheld values too."""
        every = self.angles + self.joints
        return self.left_out == 0 and all(d.only_a == d.only_b == 0 and not d.max > 0 for d in every)

    def text(self):
        lines = [f"{len(self.frames)} frames in both" + (f", {self.left_out} in one alone" if self.left_out else "")]
        if self.same():
            return "\n".join(lines + ["no difference, to the last digit"]) + "\n"
        lines += ["", f"{'angle, degrees':24}{'mean':>9}{'RMS':>9}{'max':>9}{'frames':>8}{'only A':>8}{'only B':>8}"]
        for d in sorted(self.angles, key=lambda d: -np.nan_to_num(d.rms, nan=-1)):
            lines.append(f"{d.name:24}{d.mean:9.3f}{d.rms:9.3f}{d.max:9.3f}{d.count:8}{d.only_a:8}{d.only_b:8}")
        lines += ["", f"{'joint, mm':24}{'mean':>9}{'RMS':>9}{'max':>9}{'frames':>8}{'only A':>8}{'only B':>8}"]
        for d in self.joints:
            lines.append(f"{d.name:24}{d.mean:9.2f}{d.rms:9.2f}{d.max:9.2f}{d.count:8}{d.only_a:8}{d.only_b:8}")
        return "\n".join(lines) + "\n"

    def csv(self):
        lines = ["name,unit,mean,rms,max,frames,only_a,only_b"]
        for unit, differences in (("deg", self.angles), ("mm", self.joints)):
            for d in differences:
                figures = ["" if np.isnan(v) else f"{v:.6g}" for v in (d.mean, d.rms, d.max)]
                lines.append(",".join([d.name, unit, *figures, str(d.count), str(d.only_a), str(d.only_b)]))
        return "\n".join(lines) + "\n"
