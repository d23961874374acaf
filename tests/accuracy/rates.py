#!/usr/bin/env python3
"""Joints, silent errors, stated standard deviations and body of `kinevox process` at several rates: one row per run.

usage: rates.py [--kinevox-process PROGRAM] [--sequences NAME,...] [--every 1,2,3] [--true-masks] [--work FOLDER]
                [--tables FOLDER] [--save FILE] [--compare FILE] [--max-mm N] [--max-ratio N] [--max-silent N] [--jobs N]
                [-- OPTION ...]

Columns: mean joint error (mm); times the error of the first rate; silent errors (a joint reported more than 100 mm off and
more than 3 standard deviations, %); values within 1, 2 and 3 standard deviations (%, each axis one value); withheld joints (%);
error of the stature and largest error of thigh, shank, upper arm and forearm (%). A sequence's truth has no stature: it is
1.041 times the length of the chain from ankle to head top, which holds for the shared bodies within 0.6 %. --true-masks replaces
the images by the exact silhouettes, so that segmentation has no part in the errors. --tables has the results of --every 1 from
images and without options, of sequences.py with the same option. --save and --compare keep and compare two runs of this script.
Options after -- go to kinevox-process. Exit status 77 without the shared test data."""
import argparse
import json
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np

from mask_session import write_mask_session
from pose import DATA, JOINTS, points
from session_data import Session, process_program, read_table, tomllib

SEQUENCES = ("walk", "gesture", "signal", "boxing", "exercise", "ring8", "floor", "sprint", "martial")
LENGTHS = {
    "thigh": ("hip", "knee"),
    "shank": ("knee", "ankle"),
    "upper_arm": ("shoulder", "elbow"),
    "forearm": ("elbow", "wrist"),
}
STATURE_PER_CHAIN = 1.041
SILENT_M, SILENT_STD = 0.1, 3
COLUMNS = ("mean_mm", "ratio", "silent", "within_1", "within_2", "within_3", "withheld", "stature", "length")
HEADINGS = ("mean mm", "x", "silent %", "1 std", "2 std", "3 std", "none %", "stature", "length")


def mask_session(name, work):
    """The session with the exact silhouettes instead of images; rendered once."""
    return write_mask_session(DATA / "studio" / name / "session.toml", work / "masks" / name)


def body_errors(truth, body_file):
    """Relative errors of the stature and of the worst length, %."""
    body = tomllib.loads(body_file.read_text())
    at = {j: points(truth, [j])[:, 0] for j in JOINTS}
    length = lambda a, b: float(np.mean(np.linalg.norm(at[a] - at[b], axis=1)))
    sides = lambda a, b: (length(f"{a}_l", f"{b}_l") + length(f"{a}_r", f"{b}_r")) / 2
    hips = float(np.mean(np.linalg.norm(at["sacroiliac"] - (at["hip_l"] + at["hip_r"]) / 2, axis=1)))
    chain = length("head_top", "skullbase") + length("skullbase", "sacroiliac") + hips
    chain += sides("hip", "knee") + sides("knee", "ankle")
    lengths = {name: 100 * (body[f"{name}_m"] / sides(*ends) - 1) for name, ends in LENGTHS.items()}
    return 100 * (body["stature_m"] / (STATURE_PER_CHAIN * chain) - 1), lengths


def measure(truth_folder, fps, results, span_s=(0, np.inf), sequence_frames=None):
    """The row of one run; `span_s` limits the frame sets by their time. `sequence_frames`: for each frame of the tables that of
    the sequence, where frame sets were lost; else it follows from its time."""
    truth = read_table(truth_folder / "joints.csv")
    found, stated = read_table(results / "joints.csv"), read_table(results / "uncertainty.csv")
    frames = np.rint(found["time_s"] * fps).astype(int)
    if sequence_frames is not None:
        frames = sequence_frames[found["frame"].astype(int)]
    rows = (frames < len(truth["frame"])) & (frames >= span_s[0] * fps) & (frames < span_s[1] * fps)
    exact, measured = points(truth, JOINTS)[frames[rows]], points(found, JOINTS)[rows]
    std = np.stack([stated[f"{j}_std_m"] for j in JOINTS], 1)[rows]
    offset = measured - exact
    error = np.linalg.norm(offset, axis=2)
    known = np.isfinite(error)
    silent = known & (error > SILENT_M) & (error > SILENT_STD * std)
    ratio = (np.abs(offset) / std[..., None])[known]
    result = {
        "mean_mm": 1000 * float(np.mean(error[known])) if known.any() else float("nan"),
        "silent": 100 * float(silent.sum()) / error.size,
        **{f"within_{k}": 100 * float(np.mean(ratio < k)) for k in (1, 2, 3)},
        "withheld": 100 * float(np.mean(~known)),
    }
    if (results / "body.toml").exists():
        result["stature"], lengths = body_errors(truth, results / "body.toml")
        result["length"] = max(lengths.values(), key=abs)
        result["lengths"] = lengths
    worst = np.argsort(-silent.sum(0))[:3]
    result["silent_joints"] = {JOINTS[j]: int(silent[:, j].sum()) for j in worst if silent[:, j].any()}
    return result


def run(program, name, every, options, work, masks, tables):
    source = DATA / "studio" / name
    if tables and every == 1:
        return measure(source / "truth", Session(source / "session.toml").fps, tables / name)
    session = mask_session(name, work) if masks else source / "session.toml"
    out = work / "results" / f"{name}_{every}{'_masks' if masks else ''}"
    subprocess.run(
        [program, session, "--out", out, "--overwrite", "--quiet", "--every", str(every), *options], check=True
    )
    return measure(source / "truth", Session(source / "session.toml").fps, out)


def text(name, every, row, before):
    cells = []
    for column in COLUMNS:
        value = row.get(column, float("nan"))
        cell = f"{value:.2f}" if column in ("ratio", "silent") else f"{value:.1f}"
        if before and column in ("mean_mm", "silent"):
            cell += f" ({before.get(column, float('nan')):.1f})"
        cells.append(f"{cell:>{14 if column in ('mean_mm', 'silent') else 8}s}")
    joints = " ".join(f"{j}:{n}" for j, n in row["silent_joints"].items())
    return f"{name:10s}{every:2d} " + "".join(cells) + "  " + joints


def heading():
    return " " * 13 + "".join(f"{h:>{14 if h in ('mean mm', 'silent %') else 8}s}" for h in HEADINGS)


def mean_row(label, rows):
    means = {c: np.nanmean([r.get(c, np.nan) for r in rows]) for c in COLUMNS[:7]}
    return f"{label:13s}" + "".join(f"{m:{14 if c in ('mean_mm', 'silent') else 8}.2f}" for c, m in means.items())


def main():
    argv = sys.argv[1:]
    options = argv[argv.index("--") + 1 :] if "--" in argv else []
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinevox-process", type=Path)
    parser.add_argument("--sequences", default=",".join(SEQUENCES))
    parser.add_argument("--every", default="1,2,3")
    parser.add_argument("--true-masks", action="store_true")
    parser.add_argument("--work", type=Path, help="Keep rendered masks and results there")
    parser.add_argument("--tables", type=Path)
    parser.add_argument("--save", type=Path)
    parser.add_argument("--compare", type=Path)
    for bound in ("mm", "ratio", "silent"):
        parser.add_argument(f"--max-{bound}", type=float, default=np.inf)
    parser.add_argument("--jobs", type=int, default=1)
    arguments = parser.parse_args(argv[: argv.index("--")] if "--" in argv else argv)
    if arguments.tables and (arguments.true_masks or options):
        parser.error(
            "--tables has results from images and without options; omit it with --true-masks or options after --"
        )
    if not (DATA / "studio").is_dir():
        print(f"skipped: no test data at {DATA}")
        return 77
    program = arguments.kinevox_process or process_program()
    names, rates = arguments.sequences.split(","), [int(e) for e in arguments.every.split(",")]
    before = json.loads(arguments.compare.read_text()) if arguments.compare else {}
    table = {}
    with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(arguments.jobs) as pool:
        work = arguments.work or Path(scratch)
        if arguments.true_masks:
            for name in names:
                mask_session(name, work)
        started = {
            (name, every): pool.submit(run, program, name, every, options, work, arguments.true_masks, arguments.tables)
            for name in names
            for every in rates
        }
        print(heading(), flush=True)
        for (name, every), job in started.items():
            row = job.result()
            row["ratio"] = row["mean_mm"] / table.get(f"{name} {rates[0]}", row)["mean_mm"]
            table[f"{name} {every}"] = row
            print(text(name, every, row, before.get(f"{name} {every}")), flush=True)
    for every in rates:
        print(mean_row(f"all {every:8d} ", [table[f"{name} {every}"] for name in names]))
    if arguments.save:
        arguments.save.write_text(json.dumps(table, indent=1) + "\n")
    bounds = {"mean_mm": arguments.max_mm, "ratio": arguments.max_ratio, "silent": arguments.max_silent}
    beyond = [(label, c) for label, row in table.items() for c, most in bounds.items() if not row[c] <= most]
    for label, column in beyond:
        print(f"FAILED {label}: {column} {table[label][column]:.2f}, at most {bounds[column]}")
    return 1 if beyond else 0


if __name__ == "__main__":
    sys.exit(main())
