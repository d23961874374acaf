"""The body model's coordinates by OpenSim's names, from the orientations of its segments.

Names and signs as in OpenSim's full-body models (Rajagopal et al. 2016). Ball joints: flexion about the parent's axis,
then adduction or bending, then rotation about the segment's own long axis; the pelvis turns in the other order, rotation
about the world's vertical, then list, then tilt. These are the angles of coordinates.csv; the MOT export's pelvis
is in OpenSim's own axes and order.
"""
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

SEGMENT_NAMES = (
    "pelvis", "thorax", "head", "thigh_l", "shank_l", "foot_l", "upper_arm_l", "forearm_l", "hand_l", "thigh_r", "shank_r",
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


def matrices(quaternions: Floats) -> Floats:
    """Rotation matrices (..., 3, 3) of unit quaternions w x y z (..., 4)."""
    w, x, y, z = np.moveaxis(quaternions, -1, 0)
    rows = [[1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _pelvis(r: Floats) -> list[Floats]:
    """Tilt, list, rotation of R = Rz(rotation) Rx(list) Ry(-tilt)."""
    lean = np.clip(r[..., 2, 1], -1, 1)
    return [-np.arctan2(-r[..., 2, 0], r[..., 2, 2]), np.arcsin(lean), np.arctan2(-r[..., 0, 1], r[..., 1, 1])]


def _ball(r: Floats, mirror: float) -> list[Floats]:
    """Flexion, adduction, rotation of R = Ry(-flexion) Rx(mirror adduction) Rz(mirror rotation)."""
    side = np.clip(-r[..., 1, 2], -1, 1)
    return [-np.arctan2(r[..., 0, 2], r[..., 2, 2]), mirror * np.arcsin(side),
            mirror * np.arctan2(r[..., 1, 0], r[..., 1, 1])]


def coordinates_deg(parent_from_segment: Floats, joints_m: Floats, joint_names: tuple[str, ...]) -> Floats:
    """The 29 coordinates (..., 29), degrees, in the order of COORDINATE_NAMES.

    parent_from_segment: (..., 15, 4) quaternions w x y z in the order of SEGMENT_NAMES. joints_m: (..., J, 3) positions in
    the order of joint_names; where the joint at a segment's far end is NaN, its coordinates are. At a singular pose
    (adduction of 90 degrees) flexion and rotation are not told apart.
    """
    rotations = matrices(parent_from_segment)
    columns: list[Floats] = []
    for i, segment in enumerate(SEGMENT_NAMES):
        r = rotations[..., i, :, :]
        if segment in _HINGE_AXIS:
            axis = np.array(_HINGE_AXIS[segment], dtype=float)
            twice_sine = np.stack([r[..., 2, 1] - r[..., 1, 2], r[..., 0, 2] - r[..., 2, 0], r[..., 1, 0] - r[..., 0, 1]], axis=-1)
            angles = [np.arctan2(twice_sine @ axis, np.trace(r, axis1=-2, axis2=-1) - 1)]
        elif segment == "pelvis":
            angles = _pelvis(r)
        else:
            angles = _ball(r, -1.0 if segment.endswith("_l") else 1.0)
        withheld = np.isnan(joints_m[..., joint_names.index(_FAR_JOINT[i]), 0])
        columns += [np.where(withheld, np.nan, angle) for angle in angles]
    return np.degrees(np.stack(columns, axis=-1))
