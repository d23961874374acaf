"""Messages of the pose stream: joints, angles, model coordinates and orientations with their uncertainty.

Lengths are in metres in the world frame (right-handed, z up, origin on the floor), angles in degrees. A withheld value
is NaN, and `withheld_reason` states why.
"""
from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinevox.body_table import COORDINATE_NAMES, JOINT_NAMES, SEGMENT_NAMES, TRANSLATION_NAMES
from kinevox.body_table import GEOMETRIC_ANGLE_NAMES as ANGLE_NAMES
from kinevox.header import Header, only_subject

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

RATIO_NAMES = (
    "thigh_length_ratio",
    "shank_length_ratio",
    "upper_arm_length_ratio",
    "forearm_length_ratio",
    "knee_hip_flexion_ratio_l",
    "knee_hip_flexion_ratio_r",
)
NAN = float("nan")

_JOINT_INDEX = {name: i for i, name in enumerate(JOINT_NAMES)}
_SEGMENT_INDEX = {name: i for i, name in enumerate(SEGMENT_NAMES)}


def no_such(kind: str, name: object, names: tuple[str, ...]) -> KeyError:
    """The error of an unknown name."""
    return KeyError(f"unknown {kind} '{name}'; the {kind}s are {', '.join(names)}")


class Joints(Mapping[str, Floats]):
    """Joint positions by name: joints["knee_r"] is [x, y, z], world frame, m; NaN where withheld.

    positions_m (20, 3); std_m (20,), standard deviation per axis; camera_count (20,), cameras whose silhouettes
    determine the joint; all in the order of JOINT_NAMES. withheld_reason: by name, of the withheld joints only.
    """

    def __init__(self, estimates: Any) -> None:
        # Filling lists takes a third of the time of writing array elements.
        positions: list[tuple[float, float, float]] = [(NAN, NAN, NAN)] * len(JOINT_NAMES)
        std, cameras = [NAN] * len(JOINT_NAMES), [0] * len(JOINT_NAMES)
        self.withheld_reason: dict[str, str] = {}
        for estimate in estimates:
            name = estimate.name
            i = _JOINT_INDEX.get(name)
            if i is None:
                continue  # a joint of a newer daemon
            cameras[i] = estimate.camera_count
            if estimate.HasField("position_in_world"):
                at = estimate.position_in_world
                positions[i] = (at.x, at.y, at.z)
                std[i] = estimate.std_m
            else:
                self.withheld_reason[name] = estimate.withheld_reason
        self.positions_m: Floats = np.array(positions)
        self.std_m: Floats = np.array(std)
        self.camera_count: Ints = np.array(cameras, dtype=np.int64)

    def __getitem__(self, name: str) -> Floats:
        index = _JOINT_INDEX.get(name)
        if index is None:
            raise no_such("joint", name, JOINT_NAMES)
        row: Floats = self.positions_m[index]
        return row

    def __iter__(self) -> Iterator[str]:
        return iter(JOINT_NAMES)

    def __len__(self) -> int:
        return len(JOINT_NAMES)


class _Scalars(Mapping[str, float]):
    """Scalar estimates by name. A subclass sets _names, _kind (for errors) and the values' unit."""

    _names: tuple[str, ...] = ()
    _kind = ""
    _unit = "deg"
    _index: dict[str, int]

    def __init_subclass__(cls) -> None:
        cls._index = {name: i for i, name in enumerate(cls._names)}

    def __init__(self, estimates: Any) -> None:
        size = len(self._names)
        index = self._index
        value_field, std_field = f"value_{self._unit}", f"std_{self._unit}"
        velocity_field = f"velocity_{self._unit}_per_s"
        values, std, velocity = [NAN] * size, [NAN] * size, [NAN] * size
        self.withheld_reason: dict[str, str] = {}
        for estimate in estimates:
            name = estimate.name
            i = index.get(name)
            if i is None:
                continue  # a name of a newer daemon
            if estimate.HasField(value_field):
                values[i] = getattr(estimate, value_field)
                std[i] = getattr(estimate, std_field)
                if estimate.HasField(velocity_field):
                    velocity[i] = getattr(estimate, velocity_field)
            else:
                self.withheld_reason[name] = estimate.withheld_reason
        self._values: Floats = np.array(values)
        self._std: Floats = np.array(std)
        self._velocity: Floats = np.array(velocity)

    def __getitem__(self, name: str) -> float:
        index = self._index.get(name)
        if index is None:
            raise no_such(self._kind, name, self._names)
        return float(self._values[index])

    def __iter__(self) -> Iterator[str]:
        return iter(self._names)

    def __len__(self) -> int:
        return len(self._names)


class _Degrees(_Scalars):
    """Scalar estimates in degrees."""

    @property
    def deg(self) -> Floats:
        """Values, degrees, (n,); NaN where withheld."""
        return self._values

    @property
    def rad(self) -> Floats:
        """Values, radians, (n,); NaN where withheld."""
        return np.radians(self._values)

    @property
    def std_deg(self) -> Floats:
        """Standard deviations, degrees, (n,); NaN where withheld."""
        return self._std

    @property
    def velocity_deg_per_s(self) -> Floats:
        """Angular velocities, (n,); NaN where withheld or without a previous frame set."""
        return self._velocity


class Angles(_Degrees):
    """Geometric angles by name, degrees: angles["knee_flexion_geometric_r"]; NaN where withheld.

    They are computed from joint positions and named by ANGLE_NAMES, as in angles.csv; docs/python.md defines them.
    Model coordinates such as "knee_angle_r" are in Pose.coordinates.

    deg, rad, std_deg, velocity_deg_per_s and camera_count: (11,) in the order of ANGLE_NAMES. withheld_reason: by name.
    """

    _names = ANGLE_NAMES
    _kind = "angle"

    def __init__(self, estimates: Any) -> None:
        super().__init__(estimates)
        self.camera_count: Ints = np.zeros(len(ANGLE_NAMES), dtype=np.int64)
        for estimate in estimates:
            if estimate.name in self._index:
                self.camera_count[self._index[estimate.name]] = estimate.camera_count


class Coordinates(_Degrees):
    """The body model's rotations by OpenSim's names, degrees: coordinates["knee_angle_r"]; NaN where withheld.

    deg, rad, std_deg, velocity_deg_per_s: (29,) in the order of COORDINATE_NAMES, as in coordinates.csv.
    withheld_reason: by name.
    """

    _names = COORDINATE_NAMES
    _kind = "coordinate"


class Translations(_Scalars):
    """Position of the pelvis in the world by name, m: translations["pelvis_z"]; NaN where withheld.

    m, std_m, velocity_m_per_s: (3,) in the order of TRANSLATION_NAMES. withheld_reason: by name.
    """

    _names = TRANSLATION_NAMES
    _kind = "translation"
    _unit = "m"

    @property
    def m(self) -> Floats:
        """Values, m, (3,)."""
        return self._values

    @property
    def std_m(self) -> Floats:
        """Standard deviations, m, (3,)."""
        return self._std

    @property
    def velocity_m_per_s(self) -> Floats:
        """Velocities, m/s, (3,); NaN without a previous frame set."""
        return self._velocity


class Segments:
    """Orientations of the body's segments. At identity a segment's x axis points forward, y left and z up.

    world_from_segment, parent_from_segment: (15, 4) unit quaternions w x y z in the order of SEGMENT_NAMES; NaN without
    a pose. The parent of the pelvis is the world.
    """

    def __init__(self, orientations: Any) -> None:
        none = (NAN, NAN, NAN, NAN)
        world, parent = [none] * len(SEGMENT_NAMES), [none] * len(SEGMENT_NAMES)
        for orientation in orientations:
            i = _SEGMENT_INDEX.get(orientation.name)
            if i is not None:
                w, p = orientation.world_from_segment, orientation.parent_from_segment
                world[i] = (w.w, w.x, w.y, w.z)
                parent[i] = (p.w, p.x, p.y, p.z)
        self.world_from_segment: Floats = np.array(world)
        self.parent_from_segment: Floats = np.array(parent)


class Pose:
    """The pose of one subject in one frame set.

    subject_id: from 1; 0 if no subject is tracked. name: given by an operator; empty: none. found: whether there is a pose; if not, every value is NaN. Joints,
    angles and the other parts are decoded at first access. message: kinevox.v1.pose_pb2.Pose.
    """

    def __init__(self, message: Any, subject_id: int = 0, found: bool = True, name: str = "") -> None:
        self.message = message
        self.subject_id = subject_id
        self.found = found
        self.name = name

    @cached_property
    def joints(self) -> Joints:
        """Joint positions by name, m, world frame."""
        return Joints(self.message.joints)

    @cached_property
    def angles(self) -> Angles:
        """Geometric angles by name, degrees."""
        return Angles(self.message.angles)

    @cached_property
    def coordinates(self) -> Coordinates:
        """The body model's rotations by OpenSim's names, degrees."""
        return Coordinates(self.message.coordinates)

    @cached_property
    def translations(self) -> Translations:
        """Position of the pelvis, m, world frame."""
        return Translations(self.message.translations)

    @cached_property
    def segments(self) -> Segments:
        """Segment orientations as quaternions."""
        return Segments(self.message.segment_orientations)

    @cached_property
    def ratios(self) -> dict[str, float]:
        """By RATIO_NAMES: left over right segment lengths (1 for a symmetric body) and knee over hip flexion per side.
        NaN without a pose, and for the second kind where the hip is nearly straight."""
        ratios = self.message.ratios
        if not self.found:
            return dict.fromkeys(RATIO_NAMES, NAN)
        out = {name: float(getattr(ratios, name)) for name in RATIO_NAMES[:4]}
        out.update({name: float(getattr(ratios, name)) if ratios.HasField(name) else NAN for name in RATIO_NAMES[4:]})
        return out

    @property
    def contour_residual_rms_m(self) -> float:
        """RMS distance between the silhouettes' contours and those of the fitted body, m; NaN without a pose."""
        return float(self.message.contour_residual_rms_m) if self.found else NAN

    @property
    def filtered(self) -> bool:
        """Whether a causal filter smoothed the pose over time."""
        return bool(self.message.filtered)

    def __repr__(self) -> str:
        who = f"{self.subject_id} ({self.name})" if self.name else f"{self.subject_id}"
        if not self.found:
            return f"<Pose of subject {who}: none>" if self.subject_id else "<Pose: no subject>"
        left, right = (self.angles["knee_flexion_geometric_l"], self.angles["knee_flexion_geometric_r"])
        return f"<Pose of subject {who}: knees {left:.1f} {right:.1f} deg>"


class PoseFrame:
    """The poses of one frame set: a message of Client.poses().

    subjects: a Pose for each tracked subject, ordered by subject_id; empty while no subject is tracked. With at most
    one subject, joints, angles, coordinates and the other members of Pose can be read from the frame itself; with
    several they raise FailedPrecondition. message: kinevox.v1.stream_service_pb2.StreamPosesResponse.
    """

    def __init__(self, message: Any, _: str = "") -> None:
        self.message = message
        self.subjects: tuple[Pose, ...] = tuple(
            Pose(subject.pose, subject.subject_id, subject.HasField("pose"), subject.name)
            for subject in message.subjects
        )

    @cached_property
    def header(self) -> Header:
        """Number and times of the frame set, and the results missed before it."""
        return Header.of(self.message.header)

    @property
    def sequence(self) -> int:
        """See Header."""
        return int(self.message.header.sequence)

    @property
    def capture_time_ns(self) -> int:
        """See Header. In a replay: start time of the recording plus the time within it."""
        return int(self.message.header.capture_time_ns)

    @property
    def missed_count(self) -> int:
        """See Header; always 0 with delivery "lossless"."""
        return int(self.message.header.missed_count)

    @property
    def recorded_frame(self) -> int | None:
        """See Header."""
        header = self.message.header
        return int(header.recorded_frame) if header.HasField("recorded_frame") else None

    def subject(self, subject_id: int) -> Pose:
        """The pose of one subject; one without values if that subject is not tracked."""
        for pose in self.subjects:
            if pose.subject_id == subject_id:
                return pose
        return _no_pose()

    @cached_property
    def only(self) -> Pose:
        """The pose of the only subject; one without values if there is no subject. FailedPrecondition if there are
        several."""
        return only_subject(self.subjects, [pose.subject_id for pose in self.subjects], _no_pose())

    @property
    def found(self) -> bool:
        """Whether the only subject has a pose."""
        return self.only.found

    @property
    def subject_id(self) -> int:
        """Of the only subject; 0 if there is none."""
        return self.only.subject_id

    @property
    def name(self) -> str:
        """Of the only subject; empty if it has none."""
        return self.only.name

    @property
    def joints(self) -> Joints:
        """Of the only subject; see Pose."""
        return self.only.joints

    @property
    def angles(self) -> Angles:
        """Of the only subject; see Pose."""
        return self.only.angles

    @property
    def coordinates(self) -> Coordinates:
        """Of the only subject; see Pose."""
        return self.only.coordinates

    @property
    def translations(self) -> Translations:
        """Of the only subject; see Pose."""
        return self.only.translations

    @property
    def segments(self) -> Segments:
        """Of the only subject; see Pose."""
        return self.only.segments

    @property
    def ratios(self) -> dict[str, float]:
        """Of the only subject; see Pose."""
        return self.only.ratios

    @property
    def contour_residual_rms_m(self) -> float:
        """Of the only subject; see Pose."""
        return self.only.contour_residual_rms_m

    @property
    def filtered(self) -> bool:
        """Of the only subject; see Pose."""
        return self.only.filtered

    def __repr__(self) -> str:
        return f"<PoseFrame {self.sequence}: {list(self.subjects)}>"


def _no_pose() -> Pose:
    from kinevox.v1 import pose_pb2

    return Pose(pose_pb2.Pose(), 0, False)
