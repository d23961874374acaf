#!/usr/bin/env python3
"""The published method alone (retrieval without refinement), ours alone, and with refinement: error and time, one table.

usage: pose_methods.py [--kinevox-process PROGRAM] [--retrieval PROGRAM] [--step FRAMES] [--write FILE]

Silhouettes and body are those that `kinevox-process` finds. Retrieval and refinement take each frame set alone; "tracked" is
the whole of `process` (poses followed over time, smoothed). Errors: mean joint distance, median over the frames, mm; times:
median ms per frame set of this run, so nothing else should run meanwhile. --write replaces FILE (tests/bench/results/
pose_methods.md). Exit status 77 without the shared test data."""
import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from pose import DATA, JOINTS, points, run_process
from session_data import process_program, read_table

SEQUENCES = ("walk", "gesture", "signal", "ring8", "sprint")
RULES = {"published": "published, n = 1000", "all": "all entries"}
HEADER = (
    "| | published alone | ours alone | published, refined | ours, refined | tracked | "
    "published: ms | ours: ms | refinement: ms | tracked: ms |\n" + "| --- " + "| ---: " * 9 + "|"
)


def retrieval_rows(program, session, results, step):
    """{rule: cells} of its table."""
    text = subprocess.run(
        [program, session, results / "silhouettes", "--body", results / "body.toml", "--step", str(step)],
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    cells = [[c.strip() for c in line.strip("| ").split("|")] for line in text.splitlines() if line.startswith("| ")]
    names = cells[0]
    return {key: dict(zip(names, next(c for c in cells if c[0] == name))) for key, name in RULES.items()}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--kinevox-process", type=Path)
    parser.add_argument("--retrieval", type=Path)
    parser.add_argument("--step", type=int, default=5)
    parser.add_argument("--write", type=Path)
    arguments = parser.parse_args()
    if not (DATA / "studio").is_dir():
        print(f"skipped: no test data at {DATA}")
        return 77
    process = arguments.kinevox_process or process_program()
    retrieval = arguments.retrieval or process.parents[2] / "tests" / "accuracy" / "retrieval"
    lines = [HEADER]
    for sequence in SEQUENCES:
        folder = DATA / "studio" / sequence
        with tempfile.TemporaryDirectory() as scratch:
            out = Path(scratch) / sequence
            joints, _ = run_process(process, folder, out, "--save", "silhouettes")
            rows = retrieval_rows(retrieval, folder / "session.toml", out, arguments.step)
            truth = read_table(folder / "truth" / "joints.csv")
            frames = truth["frame"].astype(int)
            distance = np.linalg.norm(points(joints, JOINTS)[frames] - points(truth, JOINTS), axis=2)
            tracked = np.nanmedian(1000 * np.nanmean(distance, axis=1))
            tracked_ms = np.nanmedian(read_table(out / "timing.csv")["pose_ms"])
        published, ours = rows["published"], rows["all"]
        lines.append(
            f"| {sequence} | {published['error, mm']} | {ours['error, mm']} | {published['refined, mm']} | "
            f"{ours['refined, mm']} | {tracked:.0f} | {published['retrieval, ms']} | {ours['retrieval, ms']} | "
            f"{ours['refinement, ms']} | {tracked_ms:.1f} |"
        )
        print("\n".join(lines[-2:] if len(lines) == 2 else lines[-1:]), flush=True)
    if arguments.write:
        arguments.write.write_text(
            "# Pose methods\n\nThe published method alone is retrieval by its neighbourhood rule (n = 1000 of the nearest by the first\n"
            "Zernike moment); ours alone the exact nearest of all entries. Refined: the best fit among the eight nearest, each frame set alone.\n"
            "Tracked: `kinevox process`. Mean joint error, mm (median over the frames), and median ms per frame set; eight fits per frame\n"
            'set in "refinement", one to three in "tracked". `tests/accuracy/pose_methods.py --write tests/bench/results/pose_methods.md`\n\n'
            + "\n".join(lines)
            + "\n"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
