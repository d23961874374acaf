"""The header of every message of a stream."""
from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeVar

from kinevox.errors import FailedPrecondition

STAGES = ("decode_ms", "segmentation_ms", "tracking_ms", "hull_ms", "colouring_ms", "pose_ms", "total_ms")

T = TypeVar("T")


@dataclass(frozen=True)
class Header:
    """The frame set of a message.

    sequence: increasing number of the frame set; gaps are frame sets lost before the pipeline, or missed.
    capture_time_ns, publish_time_ns: capture of the frame set and publication of the result, ns since 1970 UTC.
    missed_count: results since the previous message that this stream did not receive. recorded_frame: frame number in
    the replayed recording, from 0; None for live capture. stage_times_ms: processing time by STAGES, ms.
    """

    sequence: int
    capture_time_ns: int
    missed_count: int
    recorded_frame: int | None
    stage_times_ms: dict[str, float]
    publish_time_ns: int = 0

    @staticmethod
    def of(header: Any) -> "Header":
        """From the daemon's message."""
        return Header(
            header.sequence,
            header.capture_time_ns,
            header.missed_count,
            header.recorded_frame if header.HasField("recorded_frame") else None,
            {stage: getattr(header.stage_times, stage) for stage in STAGES},
            header.publish_time_ns,
        )


def only_subject(subjects: Sequence[T], ids: Sequence[int], none: T) -> T:
    """The single element of subjects; `none` if it is empty. FailedPrecondition names the ids of several."""
    if len(subjects) > 1:
        listed = ", ".join(map(str, ids))
        raise FailedPrecondition(f"several subjects are tracked ({listed}); choose one from .subjects")
    return subjects[0] if subjects else none
