#!/usr/bin/env python3
"""How far measured joint angles are from the truth, frame by frame of the same number.

usage: angle_error.py MEASURED_angles.csv TRUTH_angles.csv

Prints, for each angle, the mean absolute error and the 95th percentile in degrees and how many frames were compared;
cells that the measurement withheld are left out and counted."""
import csv
import sys

import numpy as np


def read_angles(path):
    """{frame: row} of an angles.csv, cells as text, and the names of the angles."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    names = [name for name in (rows[0] if rows else {}) if name not in ("frame", "time_s")]
    return {int(row["frame"]): row for row in rows}, names


def main():
    if len(sys.argv) != 3:
        print(__doc__.split("\n\n")[1], file=sys.stderr)
        return 2
    measured, names = read_angles(sys.argv[1])
    truth, _ = read_angles(sys.argv[2])
    frames = sorted(measured.keys() & truth.keys())
    if not frames:
        print(f"{sys.argv[1]} and {sys.argv[2]} have no frame in common")
        return 1
    print(f"{'angle':<24}{'mean error':>12}{'p95':>8}{'frames':>8}{'withheld':>10}")
    everything = []
    for name in names:
        pairs = [(measured[f][name], truth[f][name]) for f in frames if name in truth[f]]
        errors = np.array([abs((float(a) - float(b) + 180) % 360 - 180) for a, b in pairs if a and b])
        withheld = sum(not a for a, _ in pairs)
        everything.append(errors)
        shown = f"{errors.mean():>8.1f} deg{np.quantile(errors, 0.95):>8.1f}" if len(errors) else f"{'-':>12}{'-':>8}"
        print(f"{name.removesuffix('_deg'):<24}{shown}{len(errors):>8}{withheld:>10}")
    errors = np.concatenate(everything)
    if len(errors):
        print(f"{'all':<24}{errors.mean():>8.1f} deg{np.quantile(errors, 0.95):>8.1f}{len(errors):>8}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
