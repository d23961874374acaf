#!/usr/bin/env python3
"""The tracked centre G against the subject's true centre on the studio sequences; fails beyond the requirement.

usage: tracking.py [--program kinevox-process] [--sequences walk,...] [--results FOLDER]

The true centre is the centroid of the body's volume. The meshes give it exactly, but for five frames per sequence only; for
every frame it is that of the hull carved from the perfect masks on a 30 mm grid, corrected by this hull's error at the mesh
frames, interpolated between them (the column "hull error" shows how small it is). Requirement: 60 mm in 95 % of all frames of
each sequence; a frame without G counts as missed. sequences.py is the regression test.

The whole pipeline runs: the coloured volume's centre corrects G (TrackerOptions::shape_offset_gain); a hull that is not
carved by colours is bottom-heavy by up to 5 cm.

--results FOLDER reads FOLDER/SEQUENCE/track.csv of an earlier run."""
import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from session_data import Session, carve, data_folder, mesh_centre, process_program, read_table

SEQUENCES = ["walk", "gesture", "signal", "ring8", "sprint"]
BOUND_M = 0.060
VOXEL_M = 0.03


def hull_centres(session, rough):
    """Centres of the perfect masks' hulls, frame by frame; `rough` (n, 3) is the centre of the search (NaN: as before)."""
    half_size_m = np.array([1.1, 1.1, 1.3])
    axes = [np.arange(-r, r, VOXEL_M) for r in half_size_m]
    box = np.stack(np.meshgrid(*axes, indexing="ij"), -1).reshape(-1, 3)
    centres, at = [], None
    for frame, masks in enumerate(zip(*(session.true_masks(c) for c in session.cameras))):
        if frame >= len(rough):
            break
        at = rough[frame] if np.isfinite(rough[frame]).all() else at
        points = box + at
        kept, views = carve(session.cameras, masks, points)
        points = points[kept[views >= len(session.cameras) - 1]]  # with fewer views the hull is unbounded
        centres.append(points.mean(0) if len(points) else np.full(3, np.nan))
    return np.array(centres)


def true_centres(session, rough):
    """(n, 3) centres of every frame, and the errors of the hull's at the mesh frames (m, 3)."""
    centres = hull_centres(session, rough)
    frames, off = [], []
    for frame, vertices, triangles in session.true_meshes():
        if frame < len(centres):
            frames.append(frame)
            off.append(centres[frame] - mesh_centre(vertices, triangles)[0])
    off = np.array(off)
    every = np.arange(len(centres))
    return centres - np.stack([np.interp(every, frames, off[:, k]) for k in range(3)], 1), off


def errors_of(session, out):
    """(n,) distances and (n, 3) differences of G to the true centre, m, NaN without G; the hull's errors."""
    track = read_table(out / "track.csv")
    g = np.stack([track[f"centre_{axis}_m"] for axis in "xyz"], 1)
    truth, off = true_centres(session, g)
    difference = g[: len(truth)] - truth
    return np.linalg.norm(difference, axis=1), difference, off


def judge(session, out):
    error, _, _ = errors_of(session, out)
    return {
        "within_60mm_fraction": float(np.mean(error < BOUND_M)),
        "median_mm": 1e3 * float(np.nanmedian(error)),
        "p95_mm": 1e3 * float(np.nanquantile(error, 0.95)),
    }


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=Path)
    parser.add_argument("--sequences", default=",".join(SEQUENCES))
    parser.add_argument("--results", type=Path)
    arguments = parser.parse_args()
    if not (data_folder() / "studio").exists():
        print(f"skipped: {data_folder()}/studio is not here; set KINEVOX_TEST_DATA")
        return 77
    failed = []
    print(
        f"{'G - centre, mm':<16}{'frames':>7}{'median':>8}{'p95':>7}{'worst':>7}{'x':>7}{'y':>7}{'z':>7}"
        f"{'within 60 mm':>14}{'hull error':>13}"
    )
    with tempfile.TemporaryDirectory() as folder:
        for name in arguments.sequences.split(","):
            session = Session(data_folder() / "studio" / name / "session.toml")
            out = arguments.results / name if arguments.results else Path(folder) / name
            if not arguments.results:
                subprocess.run(
                    [str(arguments.program or process_program()), str(session.file), "--out", str(out), "--quiet"],
                    check=True,
                )
            error, difference, off = errors_of(session, out)
            within = np.mean(error < BOUND_M)  # NaN is not
            bias = 1e3 * np.nanmean(difference, axis=0)
            print(
                f"{name:<16}{len(error):>7}{1e3 * np.nanmedian(error):>8.0f}{1e3 * np.nanquantile(error, 0.95):>7.0f}"
                f"{1e3 * np.nanmax(error):>7.0f}{bias[0]:>7.0f}{bias[1]:>7.0f}{bias[2]:>7.0f}{100 * within:>12.1f} %"
                f"{1e3 * np.linalg.norm(off, axis=1).mean():>10.0f} mm"
            )
            if within < 0.95:
                failed.append(name)
    if failed:
        print("requirement missed:", ", ".join(failed))
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
