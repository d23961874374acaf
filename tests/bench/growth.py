#!/usr/bin/env python3
"""How the pipeline's time grows with finer voxels and with more cameras; a table and a plot.

usage: growth.py [--program kinevox-process] [--studio kinevox-studio] [--repeats 3] [--results FOLDER]

Voxels of 20, 10 and 5 mm on studio/walk (4 cameras); 2, 4 and 8 cameras of studio/ring8 and 16 of a session that
kinevox-studio renders, at 10 mm. Medians over the frame sets of the fastest repeat, without decoding.
Fails if halving the voxel's edge multiplies the time by 5 or more. Writes growth.md and growth.png."""
import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402

from process_runs import RESULTS, REPOSITORY, STAGES, data_folder, process_program, quietest, with_cameras  # noqa: E402

MOST_GROWTH = 5.0


def studio_session(program, folder):
    """16 cameras around a walking person."""
    out = Path(folder) / "ring16"
    subprocess.run(
        [str(program), "--motion", "walk", "--frames", "60", "--cameras", "16", "--out", str(out), "--no-masks"],
        check=True,
        stdout=subprocess.DEVNULL,
    )
    return out / "session.toml"


def table(title, unit, rows):
    lines = [
        f"| {title} | " + " | ".join(s.removesuffix("_ms") for s in STAGES) + " | relative to the row above |",
        "| --- |" + " ---: |" * (len(STAGES) + 1),
    ]
    before = None
    for value, times in rows:
        medians = [float(np.median(times[stage])) for stage in STAGES]
        growth = f"{medians[-1] / before:.2f}" if before else ""
        before = medians[-1]
        lines.append(f"| {value} {unit} | " + " | ".join(f"{m:.2f}" for m in medians) + f" | {growth} |")
    return "\n".join(lines)


def plot(panels, file):
    figure, axes = plt.subplots(1, len(panels), figsize=(11, 4))
    for axis, (title, label, rows, reverse) in zip(axes, panels):
        for stage in STAGES:
            if stage != "tracking_ms":
                axis.plot(
                    [v for v, _ in rows],
                    [np.median(t[stage]) for _, t in rows],
                    "o-",
                    label=stage.removesuffix("_ms"),
                    linewidth=2.5 if stage == "total_ms" else 1.2,
                )
        axis.set_xscale("log", base=2), axis.set_yscale("log")
        axis.set_xticks([v for v, _ in rows], [str(v) for v, _ in rows])
        if reverse:
            axis.invert_xaxis()
        axis.set_xlabel(label), axis.set_ylabel("ms per frame set, median"), axis.set_title(title)
        axis.grid(True, which="both", alpha=0.3), axis.legend()
    figure.tight_layout()
    figure.savefig(file, dpi=120)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=Path)
    parser.add_argument("--studio", type=Path)
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--results", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    program = arguments.program or process_program()
    studio = arguments.studio or program.parent / "kinevox-studio"
    data = data_folder() / "studio"
    walk, ring = data / "walk" / "session.toml", data / "ring8" / "session.toml"
    by_voxel = [(mm, quietest(program, walk, arguments.repeats, "--voxel-mm", mm)) for mm in (20, 10, 5)]
    by_cameras = []
    with tempfile.TemporaryDirectory() as folder:
        for keep in ((0, 2), (0, 2, 4, 6), tuple(range(8))):
            session = with_cameras(ring, keep, folder)
            by_cameras.append((len(keep), quietest(program, session, arguments.repeats)))
        by_cameras.append((16, quietest(program, studio_session(studio, folder), arguments.repeats)))
    text = "\n\n".join(
        [
            f"Milliseconds per frame set, medians, without decoding. `tests/bench/{Path(__file__).name} --repeats {arguments.repeats}`",
            table("voxel edge, 4 cameras (walk)", "mm", by_voxel),
            table("cameras, 10 mm (ring8; 16: kinevox-studio walk)", "", by_cameras),
        ]
    )
    print(text)
    arguments.results.mkdir(parents=True, exist_ok=True)
    (arguments.results / "growth.md").write_text("# Growth\n\n" + text + "\n\n![growth](growth.png)\n")
    plot(
        [("finer voxels", "voxel edge, mm", by_voxel, True), ("more cameras", "cameras", by_cameras, False)],
        arguments.results / "growth.png",
    )
    totals = [float(np.median(times["total_ms"])) for _, times in by_voxel]
    worst = max(b / a for a, b in zip(totals, totals[1:]))
    if worst >= MOST_GROWTH:
        print(f"FAILED: halving the voxel's edge multiplies the time by {worst:.1f}")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
