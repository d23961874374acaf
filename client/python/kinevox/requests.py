"""The streams that a client can ask for, as descriptions."""
from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from kinevox.calls import StreamCall
from kinevox.capture import Event
from kinevox.errors import KinevoxError
from kinevox.header import Header
from kinevox.poses import Pose
from kinevox.v1 import capture_service_pb2 as capture_pb
from kinevox.v1 import stream_service_pb2 as pb
from kinevox.volumes import VolumeFrame

Delivery = Literal["all", "latest"]
_DELIVERY = {"all": pb.DELIVERY_LOSSLESS, "latest": pb.DELIVERY_LATEST_ONLY}


@dataclass(frozen=True)
class Preview:
    """A small picture of one camera. jpeg: its bytes, empty where the camera delivered none. size_px: width, height."""

    header: Header
    camera: str
    jpeg: bytes
    size_px: tuple[int, int]

    def picture(self) -> NDArray[np.uint8]:
        """Height x width x 3 R G B; 0 x 0 x 3 where there is none. Needs Pillow (python3-pil)."""
        if not self.jpeg:
            return np.empty((0, 0, 3), dtype=np.uint8)
        try:
            from PIL import Image
        except ImportError:
            raise KinevoxError("pictures are decoded by Pillow, which is not installed; install python3-pil or take "
                               "jpeg, the bytes") from None
        return np.asarray(Image.open(io.BytesIO(self.jpeg)).convert("RGB"))

    @staticmethod
    def of(message: Any, _: str = "") -> "Preview":
        """From the daemon's message."""
        return Preview(Header.of(message.header), message.camera, message.jpeg, (message.width_px, message.height_px))


def _delivery(delivery: Delivery | None, max_rate_hz: float, default: Delivery) -> Any:
    wanted = delivery or ("latest" if max_rate_hz else default)
    if wanted not in _DELIVERY:
        raise ValueError(f"delivery is '{wanted}'; take 'all' or 'latest'")
    return _DELIVERY[wanted]


def poses(delivery: Delivery | None, max_rate_hz: float) -> StreamCall[Pose]:
    """See Client.poses."""
    request = pb.StreamPosesRequest(max_rate_hz=max_rate_hz, delivery=_delivery(delivery, max_rate_hz, "all"))
    return StreamCall("StreamService/StreamPoses", request, pb.StreamPosesResponse, Pose)


def volumes(delivery: Delivery | None, max_rate_hz: float, max_voxel_m: float | None, level: int | None,
            colours: bool) -> StreamCall[VolumeFrame]:
    """See Client.volumes."""
    if max_voxel_m is not None and level is not None:
        raise ValueError("max_voxel_m and level both say how fine the volume is; give one of them")
    request = pb.StreamVolumesRequest(without_colours=not colours, max_rate_hz=max_rate_hz,
                                      delivery=_delivery(delivery, max_rate_hz, "latest"))
    if max_voxel_m is not None:
        request.max_voxel_m = max_voxel_m
    if level is not None:
        request.level = level
    return StreamCall("StreamService/StreamVolumes", request, pb.StreamVolumesResponse, VolumeFrame.of)


def previews(camera: str, silhouette: bool, max_width_px: int, max_height_px: int, jpeg_quality: int,
             max_rate_hz: float) -> StreamCall[Preview]:
    """See Client.previews."""
    kinds = pb.StreamPreviewsRequest
    request = pb.StreamPreviewsRequest(
        camera=camera, kind=kinds.KIND_SILHOUETTE if silhouette else kinds.KIND_PICTURE, max_width_px=max_width_px,
        max_height_px=max_height_px, jpeg_quality=jpeg_quality, max_rate_hz=max_rate_hz)
    return StreamCall("StreamService/StreamPreviews", request, pb.StreamPreviewsResponse, Preview.of)


def events(past: int) -> StreamCall[Event]:
    """See Client.events."""
    return StreamCall("CaptureService/WatchEvents", capture_pb.WatchEventsRequest(past=past),
                      capture_pb.WatchEventsResponse, Event.of)
