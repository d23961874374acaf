#!/usr/bin/env python3
"""Errors of measured joint angles against the truth, by frame number.

usage: angle_error.py MEASURED_angles.csv TRUTH_angles.csv

Prints, for each angle, the mean absolute error and the 95th percentile in degrees and how many frames were compared;
withheld cells are excluded and counted."""
import sys

import numpy as np

from session_data import read_table


def main():
    if len(sys.argv) != 3:
        print(__doc__.split("\n\n")[1], file=sys.stderr)
        return 2
    measured, truth = read_table(sys.argv[1]), read_table(sys.argv[2])
    names = [name for name in measured if name not in ("frame", "time_s", "subject")]
    # Frames that both have; withheld cells are NaN.
    frames, of_measured, of_truth = np.intersect1d(
        measured.get("frame", []), truth.get("frame", []), return_indices=True
    )
    if not len(frames):
        print(f"{sys.argv[1]} and {sys.argv[2]} have no frame in common")
        return 1
    print(f"{'angle':<32}{'mean error':>12}{'p95':>8}{'frames':>8}{'withheld':>10}")
    everything = []
    for name in names:
        if name not in truth:
            continue
        ours, true = measured[name][of_measured], truth[name][of_truth]
        errors = np.abs((ours - true + 180) % 360 - 180)
        errors = errors[np.isfinite(errors)]
        withheld = int(np.isnan(ours).sum())
        everything.append(errors)
        shown = f"{errors.mean():>8.1f} deg{np.quantile(errors, 0.95):>8.1f}" if len(errors) else f"{'-':>12}{'-':>8}"
        print(f"{name.removesuffix('_deg'):<32}{shown}{len(errors):>8}{withheld:>10}")
    errors = np.concatenate(everything)
    if len(errors):
        print(f"{'all':<32}{errors.mean():>8.1f} deg{np.quantile(errors, 0.95):>8.1f}{len(errors):>8}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
