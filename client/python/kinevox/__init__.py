"""The Python client of Kinevox, markerless motion capture.

    from kinevox import Client
    for frame in Client("host:50770").poses():
        print(frame.coordinates["knee_angle_r"], frame.joints["toe_r"])

Lengths are in metres in the world frame (right-handed, z up, origin on the floor), angles in degrees, times in
nanoseconds since 1970 UTC. A withheld value is NaN. docs/python.md is the guide.
"""
from kinevox.aio import AsyncClient
from kinevox.body_table import COORDINATE_NAMES, JOINT_NAMES, SEGMENT_NAMES, TRANSLATION_NAMES
from kinevox.body_table import GEOMETRIC_ANGLE_NAMES as ANGLE_NAMES
from kinevox.client import Client
from kinevox.errors import (
    Aborted,
    AlreadyExists,
    Cancelled,
    DataLoss,
    DeadlineExceeded,
    FailedPrecondition,
    InvalidArgument,
    KinevoxError,
    NotFound,
    OutOfRange,
    PermissionDenied,
    ResourceExhausted,
    Unauthenticated,
    Unavailable,
    Unimplemented,
)
from kinevox.poses import RATIO_NAMES, Pose, PoseFrame
from kinevox.streams import Stream
from kinevox.tables import PoseTable
from kinevox.volumes import SubjectVolume, Volume, VolumeFrame

__version__ = "0.1.0"
__all__ = [
    "ANGLE_NAMES",
    "COORDINATE_NAMES",
    "JOINT_NAMES",
    "RATIO_NAMES",
    "SEGMENT_NAMES",
    "TRANSLATION_NAMES",
    "Aborted",
    "AlreadyExists",
    "AsyncClient",
    "Cancelled",
    "Client",
    "DataLoss",
    "DeadlineExceeded",
    "FailedPrecondition",
    "InvalidArgument",
    "KinevoxError",
    "NotFound",
    "OutOfRange",
    "PermissionDenied",
    "Pose",
    "PoseFrame",
    "PoseTable",
    "ResourceExhausted",
    "Stream",
    "SubjectVolume",
    "Unauthenticated",
    "Unavailable",
    "Unimplemented",
    "Volume",
    "VolumeFrame",
]
