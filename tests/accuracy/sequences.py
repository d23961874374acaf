#!/usr/bin/env python3
"""Silhouettes, volume, tracking and pose of the shared sequences against ground truth, each processed once.

usage: sequences.py --kinevox-process PROGRAM [--sequences walk,...] [--results FOLDER] [--tables FOLDER] [--update]

Every value may be 15 % worse than in bounds.toml; --update writes the measured values there. No sequence may be given a cause
of bad results. --results keeps the output of `kinevox process` in FOLDER and reuses what is complete there. --tables writes
only the tables to FOLDER/SEQUENCE, for rates.py. Exit status 77 without the shared test data."""
import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

try:
    import cv2
    import numpy as np
except ImportError as missing:
    print(f"skipped: this needs numpy and OpenCV for Python ({missing})")
    sys.exit(77)

import pose
import silhouettes
import tracking
import volume
from bounds import Judgement
from session_data import Session, data_folder, process_program, read_table
from spoiled_sessions import accusations

STUDIO = ("walk", "gesture", "signal", "ring8", "sprint", "boxing", "exercise", "floor", "martial")
REAL = "balancing"
REAL_FRAMES, REAL_LITRES = 100, (50, 150)
# Requirements of the first five sequences.
JOINTS_MM = {"walk": 35, "gesture": 35, "signal": 35, "ring8": 25, "sprint": 60}
ANGLE_DEG = {"sprint": 8}
SILHOUETTE_IOU = {"sprint": 0.80}


def process(program, session, out, *options):
    if (out / "run.toml").exists():
        return
    done = subprocess.run([program, session, "--out", out, "--quiet", *options], stderr=subprocess.PIPE, text=True)
    if done.returncode != 0:
        sys.exit(f"kinevox process {session}: {done.stderr.strip()}")


def judge_quality(name, out, judgement):
    """A good sequence is not accused; spoiled_sessions.py has the others."""
    accused = accusations(json.loads((out / "quality.json").read_text()))
    if accused:
        print(f"{name}: accused of {', '.join(accused)}")
    judgement.require(name, "quality.accusations", len(accused), 0)


def judge_studio(name, program, results, judgement, pool):
    folder = data_folder() / "studio" / name
    session, out = Session(folder / "session.toml"), results / name
    process(program, session.file, out, "--save", "silhouettes,volumes,hulls")

    judge_quality(name, out, judgement)
    cameras = silhouettes.judge(folder, out, pool)
    mean_iou = float(np.mean(list(cameras.values())))
    judgement.measure(name, {"mean_iou": mean_iou, "min_camera_iou": min(cameras.values())}, "silhouettes")
    found = volume.judge(session, out)
    judgement.measure(
        name, {k: found[k] for k in ("hull_coverage", "hull_iou", "coloured_coverage", "coloured_iou")}, "volume"
    )
    judgement.measure(name, tracking.judge(session, out), "tracking")
    row = pose.row(read_table(out / "joints.csv"), read_table(out / "angles.csv"), folder / "truth")
    judgement.measure(
        name,
        {
            "joints_mean_mm": row.mean_mm,
            "joints_p95_mm": row.p95_mm,
            "withheld_joints": row.missing,
            "swaps": row.swaps,
            **{f"{a}_deg": e for a, e in row.angles_deg.items()},
        },
        "pose",
    )
    print(
        f"{name:10s} silhouettes {mean_iou:.3f}  hull {found['hull_iou']:.3f} (perfect {found['perfect_hull_iou']:.3f})  "
        f"coloured {found['coloured_iou']:.3f}\n{pose.heading()}\n{row.text(name)}",
        flush=True,
    )

    if name not in JOINTS_MM:
        return
    for camera, value in cameras.items():
        judgement.require(name, f"silhouettes.{camera}_iou", value, SILHOUETTE_IOU.get(name, 0.85))
    judgement.require(name, "volume.hull_coverage", found["hull_coverage"], 0.97)
    if name != "ring8":
        judgement.require(name, "volume.coloured_iou", found["coloured_iou"], found["perfect_hull_iou"])
    judgement.require(
        name, "tracking.within_60mm_fraction", judgement.values[name]["tracking"]["within_60mm_fraction"], 0.95
    )
    judgement.require(name, "pose.joints_mean_mm", row.mean_mm, JOINTS_MM[name])
    judgement.require(name, "pose.withheld_joints", row.missing, 0.02)
    judgement.require(name, "pose.swaps", row.swaps, 0)
    for angle, error in row.angles_deg.items():
        judgement.require(name, f"pose.{angle}_deg", error, ANGLE_DEG.get(name, 5))


def keep_tables(results, folder):
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for file in (*results.glob("*.csv"), *results.glob("*.toml")):
        shutil.copy(file, folder)


def judge_real(program, results, judgement):
    folder = data_folder() / REAL
    out = results / REAL
    process(program, folder / "session.toml", out, "--tpose", folder / "session_tpose.toml")
    judge_quality(REAL, out, judgement)
    table = read_table(out / "volume.csv")
    litres = table["volume_litres"]
    outside = int(np.sum(~((litres >= REAL_LITRES[0]) & (litres <= REAL_LITRES[1]))))
    print(
        f"{REAL}: {len(litres)} frame sets, {np.nanmin(litres):.1f} to {np.nanmax(litres):.1f} litres, "
        f"top {np.nanmin(table['max_z']):.2f} to {np.nanmax(table['max_z']):.2f} m"
    )
    judgement.require(REAL, "volume.missing_frames", REAL_FRAMES - len(litres), 0)
    judgement.require(REAL, "volume.frames_outside_50_to_150_litres", outside, 0)
    judgement.require(
        REAL, "volume.top_below_1.5_m", max(0, 1.5 - np.nanmin(table["max_z"])), 0
    )  # the head at 1.75 m, on a beam
    judgement.require(REAL, "volume.top_above_2.1_m", max(0, np.nanmax(table["max_z"]) - 2.1), 0)
    distance_mm, withheld = pose.distance_to_reference(read_table(out / "joints.csv"))
    print(f"{REAL}: joints {distance_mm:.1f} mm from the reference, {100 * withheld:.1f} % withheld")
    judgement.measure(REAL, {"joints_to_reference_mm": distance_mm, "withheld_joints": withheld}, "pose")
    judgement.require(REAL, "pose.joints_to_reference_mm", distance_mm, 70)
    judgement.require(REAL, "pose.withheld_joints", withheld, 0.05)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinevox-process", type=Path)
    parser.add_argument("--sequences", default=",".join([*STUDIO, REAL]))
    parser.add_argument("--results", type=Path)
    parser.add_argument("--tables", type=Path)
    parser.add_argument("--update", action="store_true")
    arguments = parser.parse_args()
    names = arguments.sequences.split(",")
    for name in names:
        needed = data_folder() / ("" if name == REAL else "studio") / name / "session.toml"
        if not needed.exists():
            print(f"skipped: {needed} does not exist; set KINEVOX_TEST_DATA")
            return 77
    cv2.setNumThreads(1)
    program = arguments.kinevox_process or process_program()
    judgement = Judgement()
    with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(os.cpu_count()) as pool:
        for name in names:
            results = arguments.results or Path(scratch)
            if name == REAL:
                judge_real(program, results, judgement)
            else:
                judge_studio(name, program, results, judgement, pool)
            if arguments.tables:
                keep_tables(results / name, arguments.tables / name)
    if arguments.update:
        judgement.update()
        return 0
    return judgement.finish()


if __name__ == "__main__":
    sys.exit(main())
