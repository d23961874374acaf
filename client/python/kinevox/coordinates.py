"""The body model's coordinates by OpenSim's names, from the orientations of its segments.

Names and signs as in OpenSim's full-body models (Rajagopal et al. 2016). Ball joints: flexion about the parent's axis,
then adduction or bending, then rotation about the segment's own long axis; the pelvis turns in the other order,
rotation about the world's vertical, then list, then tilt. These are the angles of coordinates.csv; the MOT export's
pelvis is in OpenSim's own axes and order.
"""
from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SEGMENT_NAMES = (
    "pelvis", "thorax", "head", "thigh_l", "shank_l", "foot_l", "upper_arm_l", "forearm_l", "hand_l", "thigh_r",
    "shank_r",
    "foot_r", "upper_arm_r", "forearm_r", "hand_r")

# Of each segment in this order: its coordinates, three of a ball joint or one of a hinge.
_OF_SEGMENT = (
    ("pelvis_tilt", "pelvis_list", "pelvis_rotation"),
    ("lumbar_extension", "lumbar_bending", "lumbar_rotation"),
    ("neck_extension", "neck_bending", "neck_rotation"),
    ("hip_flexion_l", "hip_adduction_l", "hip_rotation_l"), ("knee_angle_l",), ("ankle_angle_l",),
    ("arm_flex_l", "arm_add_l", "arm_rot_l"), ("elbow_flex_l",), ("wrist_flex_l",),
    ("hip_flexion_r", "hip_adduction_r", "hip_rotation_r"), ("knee_angle_r",), ("ankle_angle_r",),
    ("arm_flex_r", "arm_add_r", "arm_rot_r"), ("elbow_flex_r",), ("wrist_flex_r",))
COORDINATE_NAMES = tuple(name for names in _OF_SEGMENT for name in names)

# A coordinate is withheld with the joint at its segment's far end.
_FAR_JOINT = ("root", "skullbase", "head_top", "knee_l", "ankle_l", "toe_l", "elbow_l", "wrist_l", "hand_l", "knee_r",
              "ankle_r", "toe_r", "elbow_r", "wrist_r", "hand_r")

# Axis of a hinge in the parent's frame about which its coordinate is positive.
_HINGE_AXIS = {"shank_l": (0, 1, 0), "shank_r": (0, 1, 0), "foot_l": (0, -1, 0), "foot_r": (0, -1, 0),
               "forearm_l": (0, -1, 0), "forearm_r": (0, -1, 0), "hand_l": (-1, 0, 0), "hand_r": (1, 0, 0)}

_SEGMENT_OF = np.array([i for i, names in enumerate(_OF_SEGMENT) for _ in names])
_FIRST = {segment: COORDINATE_NAMES.index(names[0]) for segment, names in zip(SEGMENT_NAMES, _OF_SEGMENT)}
_HINGES = [segment for segment in SEGMENT_NAMES if segment in _HINGE_AXIS]
_BALLS = [segment for segment in SEGMENT_NAMES[1:] if segment not in _HINGE_AXIS]
_HINGE_AT = np.array([SEGMENT_NAMES.index(segment) for segment in _HINGES])
_BALL_AT = np.array([SEGMENT_NAMES.index(segment) for segment in _BALLS])
_HINGE_OUT = np.array([_FIRST[segment] for segment in _HINGES])
_BALL_OUT = np.array([_FIRST[segment] for segment in _BALLS])
_HINGE_AXES = np.array([_HINGE_AXIS[segment] for segment in _HINGES], dtype=float)
_MIRROR = np.array([-1.0 if segment.endswith("_l") else 1.0 for segment in _BALLS])   # adduction, internal rotation

# A hinge's coordinate: its segment's place, its axis, the joint that it is withheld with.
HINGE_OF = {COORDINATE_NAMES[_FIRST[segment]]: (SEGMENT_NAMES.index(segment), _HINGE_AXIS[segment],
                                                _FAR_JOINT[SEGMENT_NAMES.index(segment)]) for segment in _HINGES}


def hinge_deg(axis: tuple[int, int, int], w: float, x: float, y: float, z: float) -> float:
    """One hinge's coordinate from its unit quaternion, degrees: what coordinates_deg() gives, twenty times as fast."""
    along = axis[0] * x + axis[1] * y + axis[2] * z
    return math.degrees(math.atan2(4 * w * along, 4 * w * w - 2))   # twice the sine, twice the cosine


def coordinates_deg(parent_from_segment: Floats, joints_m: Floats, joint_names: tuple[str, ...]) -> Floats:
    """The 29 coordinates (..., 29), degrees, in the order of COORDINATE_NAMES.

    parent_from_segment: (..., 15, 4) quaternions w x y z in the order of SEGMENT_NAMES. joints_m: (..., J, 3)
    positions in the order of joint_names; where the joint at a segment's far end is NaN, its coordinates are. At a
    singular pose (adduction of 90 degrees) flexion and rotation are not told apart.
    """
    w, x, y, z = np.moveaxis(parent_from_segment, -1, 0)
    # Entries of the rotation matrices, row and column from 1: R = Ry(-flexion) Rx(mirror adduction)
    # Rz(mirror rotation), the pelvis' R = Rz(rotation) Rx(list) Ry(-tilt).
    r33, r22 = 1 - 2 * (x * x + y * y), 1 - 2 * (x * x + z * z)
    wx, wy, wz = w * x, w * y, w * z
    xy, xz, yz = x * y, x * z, y * z
    out: Floats = np.empty((*w.shape[:-1], len(COORDINATE_NAMES)))
    b, p = _BALL_AT, 0
    out[..., _BALL_OUT] = -np.arctan2(2 * (xz + wy)[..., b], r33[..., b])
    out[..., _BALL_OUT + 1] = _MIRROR * np.arcsin(np.clip(2 * (wx - yz)[..., b], -1, 1))
    out[..., _BALL_OUT + 2] = _MIRROR * np.arctan2(2 * (xy + wz)[..., b], r22[..., b])
    out[..., 0] = -np.arctan2(2 * (wy - xz)[..., p], r33[..., p])
    out[..., 1] = np.arcsin(np.clip(2 * (yz + wx)[..., p], -1, 1))
    out[..., 2] = np.arctan2(2 * (wz - xy)[..., p], r22[..., p])
    # Twice the sine about the axis, twice the cosine.
    along = (parent_from_segment[..., _HINGE_AT, 1:] * _HINGE_AXES).sum(axis=-1)
    turn = w[..., _HINGE_AT]
    out[..., _HINGE_OUT] = np.arctan2(4 * turn * along, 4 * turn * turn - 2)
    far = [joint_names.index(name) for name in _FAR_JOINT]
    out[np.isnan(joints_m[..., far, 0])[..., _SEGMENT_OF]] = np.nan
    return np.degrees(out)
