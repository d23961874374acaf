"""Poses over time as arrays, tables and files."""
from __future__ import annotations

import csv
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinevox.body_table import COORDINATE_NAMES, JOINT_NAMES, TRANSLATION_NAMES
from kinevox.body_table import GEOMETRIC_ANGLE_NAMES as ANGLE_NAMES
from kinevox.errors import InvalidArgument
from kinevox.poses import Pose, PoseFrame, no_such

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(repr=False)
class PoseTable:
    """n rows, one per frame set and subject, one with subject 0 where no subject is tracked; NaN where a value is
    withheld.

    frame (n,): the recording's frame in a replay, else the sequence. time_s (n,): capture time since the first row.
    subject (n,): the subject's id, 0 if there is none. joints_m (n, 20, 3): world frame, m, in the order of
    JOINT_NAMES. angles_deg (n, 11): geometric angles by ANGLE_NAMES. coordinates_deg (n, 29): the body model's
    rotations by COORDINATE_NAMES. translations_m (n, 3): by TRANSLATION_NAMES. names: by subject id, the latest of each
    subject that has one; two may have the same.
    """

    frame: Ints
    time_s: Floats
    subject: Ints
    joints_m: Floats
    angles_deg: Floats
    coordinates_deg: Floats
    translations_m: Floats
    names: dict[int, str] = field(default_factory=dict)

    @staticmethod
    def of(frames: Iterable[PoseFrame], max_poses: int | None = None) -> "PoseTable":
        """Collects a stream to its end, or until it holds max_poses rows and the frame set is complete."""
        rows: list[tuple[PoseFrame, Pose]] = []
        if max_poses is None or max_poses > 0:
            for frame in frames:
                rows += [(frame, pose) for pose in frame.subjects or (frame.only,)]
                if max_poses is not None and len(rows) >= max_poses:
                    break
        number = [frame.sequence if frame.recorded_frame is None else frame.recorded_frame for frame, _ in rows]
        start_ns = rows[0][0].capture_time_ns if rows else 0
        return PoseTable(
            np.array(number, dtype=np.int64),
            np.array([(frame.capture_time_ns - start_ns) * 1e-9 for frame, _ in rows], dtype=float),
            np.array([pose.subject_id for _, pose in rows], dtype=np.int64),
            _stacked([pose.joints.positions_m for _, pose in rows], (len(JOINT_NAMES), 3)),
            _stacked([pose.angles.deg for _, pose in rows], (len(ANGLE_NAMES),)),
            _stacked([pose.coordinates.deg for _, pose in rows], (len(COORDINATE_NAMES),)),
            _stacked([pose.translations.m for _, pose in rows], (len(TRANSLATION_NAMES),)),
            _latest_names([pose for _, pose in rows]),
        )

    @staticmethod
    def read(folder: str | Path) -> "PoseTable":
        """Reads joints.csv, angles.csv, coordinates.csv and subjects.csv of a results folder or of a recording's poses/
        folder.

        All but the first are optional; without them values are NaN and subjects have no names. InvalidArgument names an unreadable file
        or a missing column.
        """
        folder = Path(folder)
        joint_columns = [f"{name}_{axis}" for name in JOINT_NAMES for axis in "xyz"]
        frame, time_s, subject, joints = _read(folder / "joints.csv", joint_columns)
        n = len(frame)
        angle_columns = [f"{name}_deg" for name in ANGLE_NAMES]
        coordinate_columns = [f"{name}_deg" for name in COORDINATE_NAMES] + [f"{name}_m" for name in TRANSLATION_NAMES]
        rest = []
        for file, names in (("angles.csv", angle_columns), ("coordinates.csv", coordinate_columns)):
            if (folder / file).exists():
                rest.append(_read(folder / file, names, n)[3])
            else:
                rest.append(np.full((n, len(names)), np.nan))
        split = len(COORDINATE_NAMES)
        return PoseTable(
            frame,
            time_s,
            subject,
            joints.reshape(n, len(JOINT_NAMES), 3),
            rest[0],
            rest[1][:, :split],
            rest[1][:, split:],
            _read_names(folder / "subjects.csv"),
        )

    def __len__(self) -> int:
        return len(self.time_s)

    def __repr__(self) -> str:
        duration_s = self.time_s[-1] - self.time_s[0] if len(self) else 0.0
        poses = int(np.isfinite(self.joints_m[:, :, 0]).any(axis=1).sum())
        return f"<PoseTable: {len(self)} rows over {duration_s:.2f} s, {poses} poses, subjects {self.subject_ids}>"

    @property
    def subject_ids(self) -> list[int]:
        """Ids of all subjects in the table, ascending."""
        return [int(value) for value in np.unique(self.subject) if value]

    @property
    def has_several(self) -> bool:
        """Whether several subjects are in one frame set."""
        return len(np.unique(self.time_s)) < len(self)

    def of_subject(self, subject_id: int, every_frame: bool = False) -> "PoseTable":
        """The rows of one subject. every_frame: one row per frame set, so that the tables of all subjects have the same
        time axis; NaN and subject 0 where this one is not tracked."""
        rows = np.flatnonzero(self.subject == subject_id)
        if not every_frame:
            return self._of_rows(rows)
        first = np.unique(self.time_s, return_index=True)[1]
        own = np.isin(self.time_s[first], self.time_s[rows])
        chosen = first.copy()
        chosen[own] = rows[np.searchsorted(self.time_s[rows], self.time_s[first[own]])]
        table = self._of_rows(chosen)
        for values in (table.joints_m, table.angles_deg, table.coordinates_deg, table.translations_m):
            values[~own] = np.nan
        table.subject[~own] = 0
        return table

    def by_subject(self, every_frame: bool = False) -> dict[int, "PoseTable"]:
        """The table of each subject by its id; see of_subject()."""
        return {subject_id: self.of_subject(subject_id, every_frame) for subject_id in self.subject_ids}

    def _of_rows(self, rows: Ints) -> "PoseTable":
        present = {int(value) for value in self.subject[rows]}
        return PoseTable(
            self.frame[rows],
            self.time_s[rows],
            self.subject[rows],
            self.joints_m[rows],
            self.angles_deg[rows],
            self.coordinates_deg[rows],
            self.translations_m[rows],
            {subject: name for subject, name in self.names.items() if subject in present},
        )

    def joint(self, name: str) -> Floats:
        """(n, 3) of one joint, m, world frame. KeyError."""
        if name not in JOINT_NAMES:
            raise no_such("joint", name, JOINT_NAMES)
        column: Floats = self.joints_m[:, JOINT_NAMES.index(name)]
        return column

    def angle(self, name: str) -> Floats:
        """(n,) of one geometric angle, degrees. KeyError."""
        if name not in ANGLE_NAMES:
            raise no_such("angle", name, ANGLE_NAMES)
        column: Floats = self.angles_deg[:, ANGLE_NAMES.index(name)]
        return column

    def coordinate(self, name: str) -> Floats:
        """(n,) of one coordinate of the body model, degrees. KeyError."""
        if name not in COORDINATE_NAMES:
            raise no_such("coordinate", name, COORDINATE_NAMES)
        column: Floats = self.coordinates_deg[:, COORDINATE_NAMES.index(name)]
        return column

    def columns(self) -> dict[str, NDArray[Any]]:
        """Every column by name with its unit, (n,) each: frame, time_s, subject, root_x_m, ...,
        knee_flexion_geometric_l_deg, ..., pelvis_x_m, ..., knee_angle_l_deg, ..."""
        out: dict[str, NDArray[Any]] = {"frame": self.frame, "time_s": self.time_s, "subject": self.subject}
        for j, joint in enumerate(JOINT_NAMES):
            out.update({f"{joint}_{axis}_m": self.joints_m[:, j, k] for k, axis in enumerate("xyz")})
        out.update({f"{name}_deg": self.angles_deg[:, k] for k, name in enumerate(ANGLE_NAMES)})
        out.update({f"{name}_m": self.translations_m[:, k] for k, name in enumerate(TRANSLATION_NAMES)})
        out.update({f"{name}_deg": self.coordinates_deg[:, k] for k, name in enumerate(COORDINATE_NAMES)})
        return out

    def write_csv(self, file: str | Path) -> None:
        """Writes all columns; withheld values and the subject of rows without one are empty cells."""
        columns = self.columns()
        with open(file, "w", newline="") as out:
            writer = csv.writer(out, lineterminator="\n")
            writer.writerow(columns)
            for frame, time_s, subject, *values in zip(*columns.values()):
                cells = ["" if np.isnan(value) else f"{value:.6f}" for value in values]
                writer.writerow([int(frame), f"{time_s:.6f}", int(subject) or "", *cells])

    def to_pandas(self) -> Any:
        """A pandas.DataFrame of all columns. ImportError if pandas is not installed (python3-pandas)."""
        import pandas

        return pandas.DataFrame(self.columns())


def _latest_names(poses: list[Pose]) -> dict[int, str]:
    latest = {pose.subject_id: pose.name for pose in poses}
    return {subject: name for subject, name in sorted(latest.items()) if name}


def _read_names(file: Path) -> dict[int, str]:
    if not file.exists():
        return {}
    try:
        with open(file, newline="", encoding="utf-8") as lines:
            header, *rows = list(csv.reader(lines)) or [[]]
        if header != ["subject", "name"]:
            raise ValueError("its columns are not subject,name")
        return {int(subject): name for subject, name in rows}
    except (OSError, ValueError, csv.Error) as error:
        raise InvalidArgument(f"{file} cannot be read ({error}); correct or delete it") from None


def _stacked(rows: list[Floats], shape: tuple[int, ...]) -> Floats:
    return np.stack(rows) if rows else np.empty((0, *shape))


def _read(file: Path, names: list[str], rows: int | None = None) -> tuple[Ints, Floats, Ints, Floats]:
    try:
        with open(file, newline="") as lines:
            reader = csv.reader(lines)
            head: list[str] = next(reader, [])
            body = list(reader)
    except OSError as error:
        raise InvalidArgument(
            f"{file} cannot be read ({error.strerror}); give a folder with kinevox's tables"
        ) from None
    missing = [name for name in ["frame", "time_s", *names] if name not in head]
    if missing:
        raise InvalidArgument(f"{file} has no column '{missing[0]}'; give a folder with kinevox's tables")
    if rows is not None and rows != len(body):
        raise InvalidArgument(f"{file} has {len(body)} rows, joints.csv {rows}; give tables of one run")
    try:
        numbers = np.array([[float(cell) if cell else np.nan for cell in row] for row in body], dtype=float)
        numbers = numbers.reshape(len(body), len(head))
    except ValueError:
        raise InvalidArgument(f"{file} has a row without {len(head)} numbers; write the file again") from None
    column = {name: i for i, name in enumerate(head)}
    # Tables of a single subject, such as the studio's truth, may have no column for it.
    subject = np.nan_to_num(numbers[:, column["subject"]]) if "subject" in column else np.ones(len(body))
    return (
        numbers[:, column["frame"]].astype(np.int64),
        numbers[:, column["time_s"]],
        subject.astype(np.int64),
        numbers[:, [column[name] for name in names]],
    )
