#!/usr/bin/env python3
"""Times `kinevox process` on the studio sequences and prints the stages, the published system's times and those
of OpenCV's background subtractors on the same images.

usage: speed.py --kinevox-process PROGRAM [--data FOLDER] [--sequences walk,...] [--repeat N] [--markdown FILE]

Stage times are medians over all frames of all repeats, milliseconds per frame set of four 640 x 480 images, without
decoding; the sum is that of the stages up to the coloured volume. Published: Pentium 4 with a GeForce 8200, four 640 x 480
cameras (paper, table 1)."""
import argparse, csv, os, subprocess, sys, tempfile, time
from pathlib import Path

import cv2
import numpy as np

STAGES = ["segmentation_ms", "tracking_ms", "hull_ms", "colouring_ms"]
PUBLISHED = {"segmentation_ms": 38, "tracking_ms": 15, "hull_ms": 136, "colouring_ms": 0}  # hull and colouring as one
BOUND_MS = 12.0


def read_timing(path):
    rows = list(csv.DictReader(open(path)))
    return {name: np.array([float(row[name]) for row in rows]) for name in [*STAGES, "pose_ms"]}


def time_process(program, session, repeat):
    """All frames' stage times, joined over the repeats."""
    joined = {name: [] for name in [*STAGES, "pose_ms"]}
    for _ in range(repeat):
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "out"
            subprocess.run([program, str(session), "--out", str(out)], check=True, stdout=subprocess.DEVNULL)
            for name, values in read_timing(out / "timing.csv").items():
                joined[name].append(values)
    return {name: np.concatenate(values) for name, values in joined.items()}


def time_opencv(folder, cameras, frames=40):
    """Milliseconds per frame set for MOG2 and KNN, both learned on the empty scene, with OpenCV's threads."""
    medians = {}
    for label, make in (("MOG2", cv2.createBackgroundSubtractorMOG2), ("KNN", cv2.createBackgroundSubtractorKNN)):
        total = 0.0
        for camera in cameras:
            model = make(detectShadows=True)
            clip = cv2.VideoCapture(str(folder / "background" / f"{camera}.mp4"))
            while (read := clip.read())[0]:
                model.apply(read[1])
            video, spent = cv2.VideoCapture(str(folder / f"{camera}.mp4")), []
            while len(spent) < frames and (read := video.read())[0]:
                start = time.perf_counter()
                model.apply(read[1])
                spent.append(1e3 * (time.perf_counter() - start))
            total += float(np.median(spent))
        medians[label] = total
    return medians


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinevox-process", required=True)
    parser.add_argument("--data", default=os.environ.get("KINEVOX_TEST_DATA", "../shared/data"))
    parser.add_argument("--sequences", default="walk,gesture,signal,sprint")
    parser.add_argument("--repeat", type=int, default=3)
    parser.add_argument("--markdown", help="also write the table there")
    options = parser.parse_args()
    studio = Path(options.data) / "studio"
    if not studio.is_dir():
        print(f"speed.py: no test data at {studio}; give --data or set KINEVOX_TEST_DATA")
        return 77

    lines = [
        "| sequence | segmentation | tracking | hull | colouring | sum, median | sum, p99 | pose | MOG2 | KNN |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |",
        "| published (2009 hardware) | 38 | 15 | 136 | (in hull) | 189 | | 36 | | |",
    ]
    slow = []
    for name in options.sequences.split(","):
        times = time_process(options.kinevox_process, studio / name / "session.toml", options.repeat)
        total = sum(times[stage] for stage in STAGES)
        opencv = time_opencv(studio / name, [f"cam{i}" for i in (1, 2, 3, 4)])
        cells = [f"{np.median(times[stage]):.2f}" for stage in STAGES]
        lines.append(
            f"| {name} | " + " | ".join(cells) + f" | {np.median(total):.2f} | {np.percentile(total, 99):.2f}"
            f" | {np.median(times['pose_ms']):.2f} | {opencv['MOG2']:.1f} | {opencv['KNN']:.1f} |"
        )
        if np.median(total) > BOUND_MS:
            slow.append(name)
    print("milliseconds per frame set, 4 x 640x480, 10 mm, N = 32")
    print("\n".join(lines))
    if options.markdown:
        Path(options.markdown).write_text("\n".join(lines) + "\n")
    if slow:
        print(f"over {BOUND_MS} ms: {', '.join(slow)}")
    return 1 if slow else 0


if __name__ == "__main__":
    sys.exit(main())
