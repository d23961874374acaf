#!/usr/bin/python3
"""Time from a seek to the frame set of all cameras, in a ten-minute session: the studio's walk, repeated.

usage: seek.py [--kinds utvideo,h264,mp4] [--minutes 10] [--seeks 300] [--temporary /tmp] [--results FOLDER]

Renders 250 frames of the virtual studio, four cameras of 640 x 480 px at 30 per second, encodes them once and repeats them: in
the recorder's codecs (utvideo, h264), and as MP4 with x264's defaults, a key frame every 250 frames and B frames. Seeks to
random frames and steps back by one, with the daemon's replay source. Bound: 200 ms.
Writes seek.md. utvideo takes 16 GB for ten minutes. The pipeline's time for the frame set is not included
(speed.md)."""
import argparse
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from process_runs import REPOSITORY, RESULTS

BOUND_MS = 200
GROUP = 250
FPS = 30
MEGABYTES = {"utvideo": 0.95, "ffv1": 0.7, "h264": 0.2, "mp4": 0.1}  # per frame set, about
NAMES = {
    "utvideo": "recorder, utvideo",
    "ffv1": "recorder, ffv1",
    "h264": "recorder, h264: a key frame every 15",
    "mp4": "MP4, x264's defaults: a key frame every 250",
}


def main():
    build = REPOSITORY / "build" / "release"
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seek-times", default=build / "tests/bench/seek_times")
    parser.add_argument("--long-session", default=build / "tests/bench/long_session")
    parser.add_argument("--studio", default=build / "server/tools/kinevox-studio")
    parser.add_argument("--kinds", default="utvideo,h264,mp4")
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--seeks", type=int, default=300)
    parser.add_argument("--temporary", default=None)
    parser.add_argument("--results", type=Path, default=RESULTS)
    options = parser.parse_args()
    frames = max(GROUP, round(options.minutes * 60 * FPS / GROUP) * GROUP)
    rows, slowest = [], 0
    with tempfile.TemporaryDirectory(prefix="kinevox-seek-", dir=options.temporary) as name:
        short = Path(name) / "short"
        subprocess.run(
            [
                options.studio,
                "--motion",
                "walk",
                "--frames",
                str(GROUP),
                "--background-frames",
                "3",
                "--no-masks",
                "--out",
                short,
            ],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        for kind in options.kinds.split(","):
            if shutil.disk_usage(name).free < 1.5e6 * MEGABYTES[kind] * frames:
                sys.exit(
                    f"{name}: no room for {frames} frame sets of {kind}; give another --temporary, or less --minutes"
                )
            folder = Path(name) / kind
            subprocess.run([options.long_session, short / "session.toml", kind, str(frames), folder], check=True)
            size = sum(file.stat().st_size for file in folder.rglob("*") if file.is_file())
            measured = subprocess.run(
                [options.seek_times, folder / "session.toml", str(options.seeks)],
                check=True,
                text=True,
                capture_output=True,
            ).stdout.split()
            shutil.rmtree(folder)
            rows.append(
                [
                    NAMES[kind],
                    f"{size / 1e9:.1f}",
                    measured[1],
                    measured[2],
                    *(f"{float(ms):.0f}" for ms in measured[3:]),
                ]
            )
            slowest = max(slowest, float(measured[5]), float(measured[8]))
    head = [
        "session",
        "GB",
        "opening, ms",
        "first frame set, ms",
        "seek, median ms",
        "99th percentile",
        "worst",
        "step back, median ms",
        "99th percentile",
        "worst",
    ]
    table = [head, ["---"] + ["---:"] * (len(head) - 1), *rows]
    text = (
        f"# Seeking\n\nTime from a request to the frame set of all cameras; `tests/bench/seek.py`, {os.cpu_count()} cores, load at the "
        f"end {os.getloadavg()[0]:.1f}, nice {os.nice(0)}. Bound: {BOUND_MS} ms.\n\n"
        f"Four cameras of 640 x 480 px at {FPS} per second, {frames} frame sets, {options.seeks} seeks to random frames "
        f"and as many steps back by one:\n\n" + "\n".join("| " + " | ".join(row) + " |" for row in table) + "\n"
    )
    options.results.mkdir(parents=True, exist_ok=True)
    (options.results / "seek.md").write_text(text)
    print(text, end="")
    return 0 if slowest <= BOUND_MS else 1


if __name__ == "__main__":
    sys.exit(main())
