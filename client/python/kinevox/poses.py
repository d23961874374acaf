"""One message of the stream of poses: joints, angles, orientations, with their uncertainty.

Lengths in metres in the world frame (right-handed, z up, origin on the floor), angles in degrees. A value that the
cameras do not determine is NaN, and `withheld` says why; it is never invented.
"""
from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from kinevox.coordinates import COORDINATE_NAMES, HINGE_OF, SEGMENT_NAMES, coordinates_deg, hinge_deg
from kinevox.header import Header

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

# The order of joints.csv and angles.csv, and of the arrays below.
JOINT_NAMES = (
    "root", "sacroiliac", "skullbase", "head_top", "shoulder_l", "elbow_l", "wrist_l", "hand_l", "hip_l", "knee_l",
    "ankle_l", "toe_l", "shoulder_r", "elbow_r", "wrist_r", "hand_r", "hip_r", "knee_r", "ankle_r", "toe_r")
ANGLE_NAMES = (
    "knee_flexion_l", "knee_flexion_r", "elbow_flexion_l", "elbow_flexion_r", "hip_flexion_l", "hip_flexion_r",
    "hip_abduction_l", "hip_abduction_r", "shoulder_elevation_l", "shoulder_elevation_r", "trunk_lean")
RATIO_NAMES = ("thigh_left_right", "shank_left_right", "upper_arm_left_right", "forearm_left_right", "knee_hip_l",
               "knee_hip_r")
NAN = float("nan")

_JOINT_PLACE = {name: i for i, name in enumerate(JOINT_NAMES)}
_ANGLE_PLACE = {name: i for i, name in enumerate(ANGLE_NAMES)}
_SEGMENT_PLACE = {name: i for i, name in enumerate(SEGMENT_NAMES)}
_COORDINATE_PLACE = {name: i for i, name in enumerate(COORDINATE_NAMES)}


def _no_such(kind: str, name: object, names: tuple[str, ...]) -> KeyError:
    return KeyError(f"there is no {kind} '{name}'; there are {', '.join(names)}")


class Joints(Mapping[str, Floats]):
    """Joints by name: joints["knee_r"] is [x, y, z] in the world, m; NaN where withheld.

    positions_m (20, 3), std_m (20,) of one axis, cameras (20,) whose silhouettes determine it: in the order of
    JOINT_NAMES. withheld: why there is no value, by name.

    """

    def __init__(self, estimates: Any) -> None:
        # Lists first: writing into arrays one by one takes three times as long.
        positions: list[tuple[float, float, float]] = [(NAN, NAN, NAN)] * len(JOINT_NAMES)
        std, cameras = [NAN] * len(JOINT_NAMES), [0] * len(JOINT_NAMES)
        self.withheld: dict[str, str] = {}
        for estimate in estimates:
            name = estimate.name
            i = _JOINT_PLACE.get(name)
            if i is None:
                continue   # a newer daemon's
            cameras[i] = estimate.cameras
            if estimate.HasField("position_in_world"):
                at = estimate.position_in_world
                positions[i] = (at.x, at.y, at.z)
                std[i] = estimate.std_m
            else:
                self.withheld[name] = estimate.withheld
        self.positions_m: Floats = np.array(positions)
        self.std_m: Floats = np.array(std)
        self.cameras: Ints = np.array(cameras, dtype=np.int64)

    def __getitem__(self, name: str) -> Floats:
        place = _JOINT_PLACE.get(name)
        if place is None:
            raise _no_such("joint", name, JOINT_NAMES)
        row: Floats = self.positions_m[place]
        return row

    def __iter__(self) -> Iterator[str]:
        return iter(JOINT_NAMES)

    def __len__(self) -> int:
        return len(JOINT_NAMES)


class Angles(Mapping[str, float]):
    """Angles by name, degrees; NaN where withheld: angles["knee_flexion_r"].

    The names are those of angles.csv (ANGLE_NAMES), which are computed from joint positions (docs/python.md has their
    definitions). Every other name of COORDINATE_NAMES, OpenSim's "knee_angle_r" and "ankle_angle_l" say, works, too,
    and gives the coordinate of the body model. Where both have a name, as hip_flexion_l, this is the first and
    Pose.coordinates the second. Iterating yields ANGLE_NAMES.

    deg, std_deg, velocity_deg_s (NaN without a frame before), cameras: (11,) each, in the order of ANGLE_NAMES. rad:
    deg in radians. withheld: why there is no value, by name.
    """

    def __init__(self, estimates: Any, coordinates: Coordinates) -> None:
        size = len(ANGLE_NAMES)
        self.deg: Floats = np.full(size, NAN)
        self.std_deg: Floats = np.full(size, NAN)
        self.velocity_deg_s: Floats = np.full(size, NAN)
        self.cameras: Ints = np.zeros(size, dtype=np.int64)
        self.withheld: dict[str, str] = {}
        self._coordinates = coordinates
        for estimate in estimates:
            name = estimate.name
            i = _ANGLE_PLACE.get(name)
            if i is None:
                continue
            self.cameras[i] = estimate.cameras
            if estimate.HasField("value_deg"):
                self.deg[i] = estimate.value_deg
                self.std_deg[i] = estimate.std_deg
                if estimate.HasField("velocity_deg_s"):
                    self.velocity_deg_s[i] = estimate.velocity_deg_s
            else:
                self.withheld[name] = estimate.withheld

    @property
    def rad(self) -> Floats:
        """deg in radians, (11,)."""
        return np.radians(self.deg)

    def __getitem__(self, name: str) -> float:
        place = _ANGLE_PLACE.get(name)
        if place is not None:
            return float(self.deg[place])
        if name in _COORDINATE_PLACE:
            return self._coordinates[name]
        raise _no_such("angle", name, ANGLE_NAMES + COORDINATE_NAMES)

    def __contains__(self, name: object) -> bool:
        return name in _ANGLE_PLACE or name in _COORDINATE_PLACE

    def __iter__(self) -> Iterator[str]:
        return iter(ANGLE_NAMES)

    def __len__(self) -> int:
        return len(ANGLE_NAMES)


class Segments:
    """Orientations of the body's segments. At identity a segment's x is forward, y left, z up.

    world_from_segment, parent_from_segment: (15, 4) unit quaternions w x y z in the order of SEGMENT_NAMES; NaN where
    there is no pose. The pelvis' parent is the world.

    """

    def __init__(self, orientations: Any) -> None:
        none = (NAN, NAN, NAN, NAN)
        world, parent = [none] * len(SEGMENT_NAMES), [none] * len(SEGMENT_NAMES)
        for orientation in orientations:
            i = _SEGMENT_PLACE.get(orientation.name)
            if i is not None:
                w, p = orientation.world_from_segment, orientation.parent_from_segment
                world[i] = (w.w, w.x, w.y, w.z)
                parent[i] = (p.w, p.x, p.y, p.z)
        self.world_from_segment: Floats = np.array(world)
        self.parent_from_segment: Floats = np.array(parent)


class _Parts:
    """What others are computed from, made when it is first asked for."""

    def __init__(self, pose: Any) -> None:
        self._pose = pose

    @cached_property
    def joints(self) -> Joints:
        """Positions."""
        return Joints(self._pose.joints)

    @cached_property
    def segments(self) -> Segments:
        """Orientations."""
        return Segments(self._pose.segments)

    def hinge(self, name: str) -> float | None:
        """A knee's, ankle's, elbow's or wrist's coordinate alone, degrees; None: take them all."""
        place, axis, far = HINGE_OF[name]
        segments, joints = self._pose.segments, self._pose.joints
        if len(segments) != len(SEGMENT_NAMES) or len(joints) != len(JOINT_NAMES):
            return None
        segment, joint = segments[place], joints[_JOINT_PLACE[far]]
        if segment.name != SEGMENT_NAMES[place] or joint.name != far:
            return None
        q = segment.parent_from_segment
        return hinge_deg(axis, q.w, q.x, q.y, q.z) if joint.HasField("position_in_world") else NAN


class Coordinates(Mapping[str, float]):
    """The body model's 29 turns by OpenSim's names, degrees, signs as in its full-body models; NaN where withheld. They
    are those of coordinates.csv: see kinevox.coordinates."""

    def __init__(self, parts: _Parts) -> None:
        self._parts = parts

    @cached_property
    def deg(self) -> Floats:
        """(29,) in the order of COORDINATE_NAMES; computed when the first is asked for."""
        return coordinates_deg(self._parts.segments.parent_from_segment, self._parts.joints.positions_m, JOINT_NAMES)

    def __getitem__(self, name: str) -> float:
        place = _COORDINATE_PLACE.get(name)
        if place is None:
            raise _no_such("coordinate", name, COORDINATE_NAMES)
        if name in HINGE_OF and "deg" not in self.__dict__:
            alone = self._parts.hinge(name)
            if alone is not None:
                return alone
        return float(self.deg[place])

    def __iter__(self) -> Iterator[str]:
        return iter(COORDINATE_NAMES)

    def __len__(self) -> int:
        return len(COORDINATE_NAMES)


class Pose:
    """What was measured of the body in one frame set.

    header: number and time of the frame set (Header), also as sequence, time_ns, missed and subject_id. found: whether
    there is a pose; else every value is NaN. The parts are made when they are first asked for. message: the
    daemon's own, kinevox.v1.stream_service_pb2.StreamPosesResponse.

    """

    def __init__(self, message: Any, server: str = "") -> None:
        self.message = message
        self.found: bool = message.HasField("pose")
        self._parts = _Parts(message.pose)

    @cached_property
    def header(self) -> Header:
        """Number and time of the frame set and what was missed before it."""
        return Header.of(self.message.header)

    @property
    def sequence(self) -> int:
        """Number of the frame set, rising; gaps are frame sets lost before the pipeline, or missed."""
        return int(self.message.header.sequence)

    @property
    def time_ns(self) -> int:
        """When it was captured, ns since 1970 UTC; of a recording, when that was started plus its own time."""
        return int(self.message.header.capture_time_ns)

    @property
    def missed(self) -> int:
        """Results since the message before that this stream did not get; always 0 with delivery "all"."""
        return int(self.message.header.missed)

    @property
    def subject_id(self) -> int:
        """0: nobody is tracked."""
        return int(self.message.header.subject_id)

    @property
    def recorded_frame(self) -> int | None:
        """Of a recording that is replayed: the frame's number in it, from 0. None: live."""
        header = self.message.header
        return int(header.recorded_frame) if header.HasField("recorded_frame") else None

    @property
    def joints(self) -> Joints:
        """Positions by name, m, world frame."""
        return self._parts.joints

    @cached_property
    def angles(self) -> Angles:
        """Angles by name, degrees."""
        return Angles(self.message.pose.angles, self.coordinates)

    @property
    def segments(self) -> Segments:
        """Orientations as quaternions."""
        return self._parts.segments

    @cached_property
    def coordinates(self) -> Coordinates:
        """The body model's turns by OpenSim's names, degrees."""
        return Coordinates(self._parts)

    @cached_property
    def ratios(self) -> dict[str, float]:
        """By RATIO_NAMES: left over right of segments' lengths, 1 for a symmetric body, and knee flexion over hip
        flexion of a side; NaN where the hip is flexed too little to tell, or without a pose."""
        ratios = self.message.pose.ratios
        if not self.found:
            return dict.fromkeys(RATIO_NAMES, NAN)
        out = {name: float(getattr(ratios, name)) for name in RATIO_NAMES[:4]}
        out.update({name: float(getattr(ratios, name)) if ratios.HasField(name) else NAN for name in RATIO_NAMES[4:]})
        return out

    @property
    def contour_rms_m(self) -> float:
        """Root mean square distance of the silhouettes' contours from the fitted body's outline, m; NaN without a
        pose."""
        return float(self.message.pose.contour_rms_m) if self.found else NAN

    @property
    def filtered(self) -> bool:
        """Smoothed over time, causally."""
        return bool(self.message.pose.filtered)

    def __repr__(self) -> str:
        if not self.found:
            return f"<Pose {self.sequence}: nobody>"
        left, right = self.angles["knee_flexion_l"], self.angles["knee_flexion_r"]
        return f"<Pose {self.sequence}: knees {left:.1f} {right:.1f} deg>"
