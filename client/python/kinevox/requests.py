"""The streams of the API, as values."""
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
from kinevox.poses import PoseFrame
from kinevox.v1 import capture_service_pb2 as capture_pb
from kinevox.v1 import stream_service_pb2 as pb
from kinevox.volumes import VolumeFrame

Delivery = Literal["lossless", "latest"]
_DELIVERY = {"lossless": pb.DELIVERY_LOSSLESS, "latest": pb.DELIVERY_LATEST_ONLY}


@dataclass(frozen=True)
class Preview:
    """A scaled image of one camera. jpeg: encoded; empty if the camera delivered no image. size_px: width, height."""

    header: Header
    camera: str
    jpeg: bytes
    size_px: tuple[int, int]

    def image(self) -> NDArray[np.uint8]:
        """(height, width, 3) R G B; (0, 0, 3) without an image. Needs Pillow (python3-pil)."""
        if not self.jpeg:
            return np.empty((0, 0, 3), dtype=np.uint8)
        try:
            from PIL import Image
        except ImportError:
            raise KinevoxError("decoding images needs Pillow; install python3-pil, or use the bytes in .jpeg") from None
        return np.asarray(Image.open(io.BytesIO(self.jpeg)).convert("RGB"))

    @staticmethod
    def of(message: Any, _: str = "") -> "Preview":
        """From the daemon's message."""
        size_px = (message.width_px, message.height_px)
        return Preview(Header.of(message.header), message.camera, message.jpeg, size_px)


def _delivery(delivery: Delivery | None, max_rate_hz: float, default: Delivery) -> Any:
    wanted = delivery or ("latest" if max_rate_hz else default)
    if wanted not in _DELIVERY:
        raise ValueError(f"delivery is '{wanted}'; use 'lossless' or 'latest'")
    return _DELIVERY[wanted]


def poses(delivery: Delivery | None, max_rate_hz: float) -> StreamCall[PoseFrame]:
    """See Client.poses."""
    request = pb.StreamPosesRequest(max_rate_hz=max_rate_hz, delivery=_delivery(delivery, max_rate_hz, "lossless"))
    return StreamCall("StreamService/StreamPoses", request, pb.StreamPosesResponse, PoseFrame)


def volumes(
    delivery: Delivery | None,
    max_rate_hz: float,
    max_voxel_m: float | None,
    downsample_level: int | None,
    colours: bool,
) -> StreamCall[VolumeFrame]:
    """See Client.volumes."""
    if max_voxel_m is not None and downsample_level is not None:
        raise ValueError("max_voxel_m and downsample_level both set the resolution; give one of them")
    request = pb.StreamVolumesRequest(
        omit_colours=not colours,
        max_rate_hz=max_rate_hz,
        delivery=_delivery(delivery, max_rate_hz, "latest"),
        max_voxel_m=max_voxel_m,  # None leaves a field unset
        downsample_level=downsample_level,
    )
    return StreamCall("StreamService/StreamVolumes", request, pb.StreamVolumesResponse, VolumeFrame.of)


def previews(
    camera: str, silhouette: bool, max_width_px: int, max_height_px: int, jpeg_quality: int, max_rate_hz: float
) -> StreamCall[Preview]:
    """See Client.previews."""
    kinds = pb.StreamPreviewsRequest
    request = pb.StreamPreviewsRequest(
        camera=camera,
        kind=kinds.KIND_SILHOUETTE if silhouette else kinds.KIND_IMAGE,
        max_width_px=max_width_px,
        max_height_px=max_height_px,
        jpeg_quality=jpeg_quality,
        max_rate_hz=max_rate_hz,
    )
    return StreamCall("StreamService/StreamPreviews", request, pb.StreamPreviewsResponse, Preview.of)


def events(history: int) -> StreamCall[Event]:
    """See Client.events."""
    request = capture_pb.WatchEventsRequest(history_count=history)
    return StreamCall("CaptureService/WatchEvents", request, capture_pb.WatchEventsResponse, Event.of)
