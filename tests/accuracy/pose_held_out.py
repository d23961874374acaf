#!/usr/bin/env python3
"""Joints and angles on held-out sequences: the project's virtual studio with other motions, bodies and camera rings.

usage: pose_held_out.py [--kinevox-process PROGRAM] [--kinevox-studio PROGRAM] [--work FOLDER] [--sequences NAME,...]

Renders missing sequences into FOLDER (kept if given), processes them and prints the table of pose.py. The studio's bodies are
an implicit surface of another shape than the body model's, so the bound is wider than for the shared data. Fails beyond it or where left and right are exchanged."""
import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from pose import heading, row, run_process
from session_data import process_program

# Name: motion, seed, cameras, frame sets. The seed draws person, clothes, room and the ring of cameras.
SEQUENCES = {
    "walk_11": ("walk", 11, 4, 100),
    "arm_raise_12": ("arm_raise", 12, 4, 80),
    "run_13": ("run", 13, 4, 70),
    "squat_14": ("squat", 14, 5, 80),
    "jumping_jack_15": ("jumping_jack", 15, 6, 70),
    "sprint_start_16": ("sprint_start", 16, 4, 70),
    "walk_17": ("walk", 17, 3, 90),
    "arm_raise_18": ("arm_raise", 18, 4, 80),
}
BOUND_MM = 60


def render(studio, work, name):
    """The folder of a sequence, rendered if it is not there."""
    motion, seed, cameras, frames = SEQUENCES[name]
    folder = Path(work) / name
    if not folder.is_dir():
        folder.parent.mkdir(parents=True, exist_ok=True)
        subprocess.run(
            [
                studio,
                "--motion",
                motion,
                "--seed",
                str(seed),
                "--cameras",
                str(cameras),
                "--frames",
                str(frames),
                "--no-masks",
                "--out",
                folder,
            ],
            check=True,
            stdout=subprocess.DEVNULL,
        )
    return folder


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--kinevox-process", type=Path)
    parser.add_argument("--kinevox-studio", type=Path)
    parser.add_argument("--work", type=Path)
    parser.add_argument("--sequences", default=",".join(SEQUENCES))
    arguments = parser.parse_args()
    process = arguments.kinevox_process or process_program()
    studio = arguments.kinevox_studio or process.parent / "kinevox-studio"
    problems = []
    with tempfile.TemporaryDirectory() as scratch:
        work = arguments.work or Path(scratch)
        print(heading(), flush=True)
        for name in arguments.sequences.split(","):
            folder = render(studio, work, name)
            joints, angles = run_process(process, folder, work / "results" / name)
            measured = row(joints, angles, folder / "truth")
            print(measured.text(name), flush=True)
            if not measured.mean_mm <= BOUND_MM:
                problems.append(f"{name}: joints {measured.mean_mm:.1f} mm, at most {BOUND_MM}")
            if measured.swaps:
                problems.append(f"{name}: left and right are exchanged in {measured.swaps} frames")
    for problem in problems:
        print("FAILED", problem)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
