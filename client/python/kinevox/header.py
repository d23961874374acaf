"""What stands first in every message of a stream."""
from __future__ import annotations

from dataclasses import dataclass
from typing import Any

STAGES = ("decode_ms", "segmentation_ms", "tracking_ms", "hull_ms", "colouring_ms", "pose_ms", "total_ms")


@dataclass(frozen=True)
class Header:
    """sequence: number of the frame set, rising. time_ns: its capture, ns since 1970 UTC. missed: results since the
    message before that this stream did not get. subject_id: 0, nobody is tracked. recorded_frame: of a recording that
    is replayed, from 0; None: live. published_time_ns: when the daemon had the result ready, as time_ns. times_ms: how long it spent in each stage, by STAGES, ms."""

    sequence: int
    time_ns: int
    missed: int
    subject_id: int
    recorded_frame: int | None
    times_ms: dict[str, float]
    published_time_ns: int = 0

    @staticmethod
    def of(header: Any) -> "Header":
        """From the daemon's message."""
        return Header(header.sequence, header.capture_time_ns, header.missed, header.subject_id,
                      header.recorded_frame if header.HasField("recorded_frame") else None,
                      {stage: getattr(header.times, stage) for stage in STAGES},
                      header.published_time_ns)
