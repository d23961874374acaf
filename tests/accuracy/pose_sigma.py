#!/usr/bin/env python3
"""Calibration of the standard deviations of `kinevox-process`: the fractions of errors within one and two of them.

usage: pose_sigma.py [--sequence FOLDER=RESULTS ...] [--kinevox-process PROGRAM] [--kinevox-studio PROGRAM] [--work FOLDER]

A joint's sigma is per axis, so each of its axes is one value. Calibrated normal errors have 68 % within one sigma and 95 %
within two. Sequences are the shared test data's and those that pose_held_out.py renders, unless named: FOLDER with
truth/, RESULTS from `kinevox process`. Fails where, over all sequences, fewer than 55 % or 85 % lie within, or where sigma is
too wide: more than 90 % within one. Exit status 77 without any sequence."""
import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

from pose import DATA, JOINTS, run_process
from pose_held_out import SEQUENCES, render
from session_data import GEOMETRIC_ANGLE_NAMES, process_program, read_table

ANGLES = list(GEOMETRIC_ANGLE_NAMES)


def ratios(truth, results):
    """{name: (values, |error| / sigma)} of joints (each axis a value) and angles; and {name: median sigma, mm or deg}."""
    joints, angles = read_table(truth / "joints.csv"), read_table(truth / "angles.csv")
    measured, found = read_table(results / "joints.csv"), read_table(results / "angles.csv")
    sigma = read_table(results / "uncertainty.csv")
    frames = joints["frame"].astype(int)
    frames = frames[frames < len(measured["frame"])]
    ratio, width = {}, {}
    for name in JOINTS:
        std = sigma[f"{name}_std_m"][frames]
        error = np.stack(
            [np.abs(measured[f"{name}_{a}"][frames] - joints[f"{name}_{a}"][: len(frames)]) for a in "xyz"]
        )
        ratio[name], width[name] = (error / std).ravel(), 1000 * np.nanmedian(std)
    for name in ANGLES:
        std = sigma[f"{name}_std_deg"][frames]
        ratio[name] = np.abs(found[f"{name}_deg"][frames] - angles[f"{name}_deg"][: len(frames)]) / std
        width[name] = np.nanmedian(std)
    return ratio, width


def within(values, sigmas):
    values = values[np.isfinite(values)]
    return 100 * np.mean(values < sigmas) if len(values) else np.nan


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--sequence", action="append", default=[])
    parser.add_argument("--kinevox-process", type=Path)
    parser.add_argument("--kinevox-studio", type=Path)
    parser.add_argument("--work", type=Path, help="Keep renderings and results there")
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        return judge(arguments, arguments.work or Path(scratch))


def judge(arguments, work):
    pairs = [tuple(map(Path, s.split("=", 1))) for s in arguments.sequence]
    if not pairs:
        process = arguments.kinevox_process or process_program()
        folders = [DATA / "studio" / s for s in ("walk", "gesture", "signal", "ring8", "sprint")]
        folders = [f for f in folders if f.is_dir()]
        studio = arguments.kinevox_studio or process.parent / "kinevox-studio"
        folders += [render(studio, work, sequence) for sequence in SEQUENCES]
        for folder in folders:
            run_process(process, folder, work / "results" / folder.name)
            pairs.append((folder, work / "results" / folder.name))
    if not pairs:
        return 77
    measured = {folder.name: ratios(folder / "truth", results) for folder, results in pairs}
    print("fraction of the values within one / two standard deviations, %; the last column: median sigma, mm or deg")
    print(f"{'':32s}" + " ".join(f"{name[:9]:>9s}" for name in measured) + "       all   sigma")
    for name in [*JOINTS, *ANGLES, "joints", "angles"]:
        members = {"joints": JOINTS, "angles": ANGLES}.get(name, [name])
        row, everything = [], []
        for ratio, _ in measured.values():
            values = np.concatenate([ratio[m] for m in members])
            everything.append(values)
            row.append(f"{within(values, 1):3.0f} / {within(values, 2):3.0f}")
        values = np.concatenate(everything)
        width = np.median([np.median([w[m] for m in members]) for _, w in measured.values()])
        print(f"{name:32s}" + " ".join(row) + f" {within(values, 1):4.0f} / {within(values, 2):3.0f} {width:6.1f}")
    problems = []
    for kind, members in (("joints", JOINTS), ("angles", ANGLES)):
        values = np.concatenate([ratio[m] for ratio, _ in measured.values() for m in members])
        one, two = within(values, 1), within(values, 2)
        if one < 55 or two < 85 or one > 90:
            problems.append(f"{kind}: {one:.0f} % within one sigma, {two:.0f} % within two; expected 68 and 95")
    for problem in problems:
        print("FAILED", problem)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
