"""Poses over time as arrays, tables and files."""
from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinevox.coordinates import COORDINATE_NAMES
from kinevox.errors import InvalidArgument
from kinevox.poses import ANGLE_NAMES, JOINT_NAMES, Pose

Floats = NDArray[np.float64]


@dataclass
class PoseTable:
    """n poses, one row each; NaN where a value was withheld or nobody was seen.

    frame (n,): the recording's frame, else the sequence. time_s (n,): from the first row on, by capture time. joints_m
    (n, 20, 3): world frame, m, in the order of JOINT_NAMES. angles_deg (n, 11): of ANGLE_NAMES. coordinates_deg (n,
    29): of COORDINATE_NAMES, the body model's turns by OpenSim's names.
    """

    frame: NDArray[np.int64]
    time_s: Floats
    joints_m: Floats
    angles_deg: Floats
    coordinates_deg: Floats

    @staticmethod
    def of(poses: Iterable[Pose], most: int | None = None) -> "PoseTable":
        """Collects a stream, to its end or so many poses."""
        kept: list[Pose] = []
        if most is None or most > 0:
            for pose in poses:
                kept.append(pose)
                if len(kept) == most:
                    break
        frame = [pose.sequence if pose.recorded_frame is None else pose.recorded_frame for pose in kept]
        start = kept[0].time_ns if kept else 0
        return PoseTable(
            np.array(frame, dtype=np.int64), np.array([(pose.time_ns - start) * 1e-9 for pose in kept], dtype=float),
            _stacked([pose.joints.positions_m for pose in kept], (len(JOINT_NAMES), 3)),
            _stacked([pose.angles.deg for pose in kept], (len(ANGLE_NAMES),)),
            _stacked([pose.coordinates.deg for pose in kept], (len(COORDINATE_NAMES),)))

    @staticmethod
    def read(folder: str | Path) -> "PoseTable":
        """From joints.csv, angles.csv and coordinates.csv, as `kinevox process` and recordings (poses/) have them; of
        the last two, what is not there is NaN. InvalidArgument where joints.csv cannot be read."""
        folder = Path(folder)
        frame, time_s, joints = _read(folder / "joints.csv",
                                      [f"{name}_{axis}" for name in JOINT_NAMES for axis in "xyz"])
        n = len(frame)
        rest = []
        for file, names in (("angles.csv", ANGLE_NAMES), ("coordinates.csv", COORDINATE_NAMES)):
            if (folder / file).exists():
                rest.append(_read(folder / file, [f"{name}_deg" for name in names], n)[2])
            else:
                rest.append(np.full((n, len(names)), np.nan))
        return PoseTable(frame, time_s, joints.reshape(n, len(JOINT_NAMES), 3), rest[0], rest[1])

    def __len__(self) -> int:
        return len(self.time_s)

    def joint(self, name: str) -> Floats:
        """(n, 3) of one joint, m, world frame. KeyError."""
        if name not in JOINT_NAMES:
            raise KeyError(f"there is no joint '{name}'; there are {', '.join(JOINT_NAMES)}")
        column: Floats = self.joints_m[:, JOINT_NAMES.index(name)]
        return column

    def angle(self, name: str) -> Floats:
        """(n,) of one angle, degrees, by the names that Angles takes. KeyError."""
        if name in ANGLE_NAMES:
            column: Floats = self.angles_deg[:, ANGLE_NAMES.index(name)]
            return column
        return self.coordinate(name)

    def coordinate(self, name: str) -> Floats:
        """(n,) of one of COORDINATE_NAMES, degrees. KeyError."""
        if name not in COORDINATE_NAMES:
            raise KeyError(f"there is no angle '{name}'; there are {', '.join(ANGLE_NAMES + COORDINATE_NAMES)}")
        column: Floats = self.coordinates_deg[:, COORDINATE_NAMES.index(name)]
        return column

    def columns(self) -> dict[str, NDArray[Any]]:
        """Every column by name with its unit, (n,) each: frame, time_s, root_x_m, ..., knee_flexion_l_deg, ..., and the
        coordinates as model_knee_angle_l_deg, ..."""
        out: dict[str, NDArray[Any]] = {"frame": self.frame, "time_s": self.time_s}
        for j, joint in enumerate(JOINT_NAMES):
            out.update({f"{joint}_{axis}_m": self.joints_m[:, j, k] for k, axis in enumerate("xyz")})
        out.update({f"{name}_deg": self.angles_deg[:, k] for k, name in enumerate(ANGLE_NAMES)})
        out.update({f"model_{name}_deg": self.coordinates_deg[:, k] for k, name in enumerate(COORDINATE_NAMES)})
        return out

    def write_csv(self, file: str | Path) -> None:
        """All columns; an empty cell where there is no value."""
        columns = self.columns()
        with open(file, "w", newline="") as out:
            writer = csv.writer(out, lineterminator="\n")
            writer.writerow(columns)
            for row in zip(*columns.values()):
                writer.writerow([int(row[0])] + ["" if np.isnan(value) else f"{value:.6f}" for value in row[1:]])

    def to_pandas(self) -> Any:
        """A pandas.DataFrame of all columns. ImportError where pandas is not installed (python3-pandas)."""
        import pandas

        return pandas.DataFrame(self.columns())


def _stacked(rows: list[Floats], shape: tuple[int, ...]) -> Floats:
    return np.stack(rows) if rows else np.empty((0, *shape))


def _read(file: Path, names: list[str], rows: int | None = None) -> tuple[NDArray[np.int64], Floats, Floats]:
    try:
        with open(file, newline="") as lines:
            reader = csv.reader(lines)
            head: list[str] = next(reader, [])
            body = list(reader)
    except OSError as error:
        raise InvalidArgument(
            f"{file} cannot be read ({error.strerror}); give a folder with kinevox's tables") from None
    missing = [name for name in ["frame", "time_s", *names] if name not in head]
    if missing:
        raise InvalidArgument(f"{file} has no column '{missing[0]}'; give a folder with kinevox's tables")
    if rows is not None and rows != len(body):
        raise InvalidArgument(f"{file} has {len(body)} rows, joints.csv {rows}; give tables of one run")
    try:
        numbers = np.array([[float(cell) if cell else np.nan for cell in row] for row in body], dtype=float)
        numbers = numbers.reshape(len(body), len(head))
    except ValueError:
        raise InvalidArgument(f"{file} has a row that is no row of {len(head)} numbers; make it anew") from None
    place = {name: i for i, name in enumerate(head)}
    return (numbers[:, place["frame"]].astype(np.int64), numbers[:, place["time_s"]],
            numbers[:, [place[name] for name in names]])
