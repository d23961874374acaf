"""The Python client of Kinevox, markerless motion capture.

    from kinevox import Client
    for pose in Client("host:50770").poses():
        print(pose.angles["knee_angle_r"], pose.joints["toe_r"])

Metres in the world frame (right-handed, z up, origin on the floor), angles in degrees, times in nanoseconds since 1970
UTC; NaN where a value was withheld. docs/python.md is the guide.
"""
from kinevox.aio import AsyncClient
from kinevox.client import Client
from kinevox.coordinates import COORDINATE_NAMES, SEGMENT_NAMES
from kinevox.errors import (Aborted, AlreadyExists, Cancelled, DataLoss, DeadlineExceeded, FailedPrecondition,
                            InvalidArgument, KinevoxError, NotFound, OutOfRange, PermissionDenied, ResourceExhausted,
                            Unauthenticated, Unavailable, Unimplemented)
from kinevox.poses import ANGLE_NAMES, JOINT_NAMES, RATIO_NAMES, Pose
from kinevox.streams import Stream
from kinevox.tables import PoseTable
from kinevox.volumes import Volume, VolumeFrame

__version__ = "0.1.0"
__all__ = ["ANGLE_NAMES", "COORDINATE_NAMES", "JOINT_NAMES", "RATIO_NAMES", "SEGMENT_NAMES", "Aborted", "AlreadyExists",
           "AsyncClient", "Cancelled", "Client", "DataLoss", "DeadlineExceeded", "FailedPrecondition",
           "InvalidArgument",
           "KinevoxError", "NotFound", "OutOfRange", "PermissionDenied", "Pose", "PoseTable", "ResourceExhausted", "Stream",
           "Unauthenticated", "Unavailable", "Unimplemented", "Volume", "VolumeFrame"]
