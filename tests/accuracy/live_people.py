#!/usr/bin/env python3
"""Several people live: joints, silent errors, stated standard deviations and identities of each, against `kinevox process`.

usage: live_people.py [--folders FOLDER,...] [--body default|automatic] [--pacing as_fast_as_possible|real_time] [--max-subjects N]
                      [--option LINE] [--daemon PROGRAM] [--client PROGRAM] [--process PROGRAM] [--no-process] [--max-ratio N]
                      [--max-mm N] [--max-silent N] [--max-swaps N]

The daemon captures each session and records its poses, which are causal; columns as in people.py, "x" is the error over that of
`kinevox process`, which --no-process omits. Folders have session.toml and the truth of each person (default: shared/data/studio/pair), such as the trials
of people_sweep.py, whose results/ are used. --body: of an average adult, or fitted by the daemon to each person's first
seconds, with --pacing real_time. Exit status 77 without the shared test data."""
import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from live import RECORDING, add_arguments, capture
from people import People, text
from session_data import data_folder


def processed(arguments, folder, work):
    if (folder / "results/run.toml").exists():
        return folder / "results"
    out, limit = work / "processed", ["--max-subjects", str(arguments.max_subjects)]
    subprocess.run([arguments.process, folder / "session.toml", "--out", out, "--quiet", *limit], check=True)
    return out


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    pair = data_folder() / "studio" / "pair"
    parser.add_argument("--folders", type=lambda text: [Path(f) for f in text.split(",")], default=[pair])
    parser.add_argument("--body", choices=("default", "automatic"), default="default")
    parser.add_argument("--pacing", choices=("as_fast_as_possible", "real_time"), default="as_fast_as_possible")
    parser.add_argument("--max-subjects", type=int, default=4)
    parser.add_argument("--no-process", action="store_true", help="Skip the comparison with `kinevox process`")
    parser.add_argument("--option", action="append", default=[], help="Line of the configuration's [pose], repeatable")
    for bound in ("ratio", "mm", "silent", "swaps"):
        parser.add_argument(f"--max-{bound}", type=float, default=np.inf)
    arguments = parser.parse_args()
    if not arguments.folders[0].exists():
        print(f"skipped: no test data at {arguments.folders[0]}")
        return 77
    print(f"{'':14s}{'mean mm':>9s}{'silent %':>10s}{'1 std':>8s}{'2 std':>8s}{'3 std':>8s}{'none %':>9s}{'x':>6s}")
    failed, rows = [], []
    recording = f"{RECORDING}[tracking]\nmax_subjects = {arguments.max_subjects}\n"
    for folder in arguments.folders:
        with tempfile.TemporaryDirectory() as scratch:
            work = Path(scratch)
            offline_mm = np.nan
            if not arguments.no_process:
                offline = People(folder / "session.toml", processed(arguments, folder, work))
                offline_mm = offline.row(slice(None))["mean_mm"]
            (work / "daemon").mkdir()
            frames = capture(arguments, folder.name, folder, work / "daemon", None, work / "live", recording)
            people = People(folder / "session.toml", work / "live", sequence_frames=frames)
        for person, name in enumerate(people.names):
            print(text(f"person {name}", people.row(slice(None), person)))
        row = people.row(slice(None))
        ratio, (missing_s, invented_s) = row["mean_mm"] / offline_mm, people.absent_s()
        print(
            f"{text(folder.name, row)}{ratio:6.2f}  identity swaps {people.swaps()}, missing {missing_s:.2f} s, "
            f"invented {invented_s:.2f} s at a time",
            flush=True,
        )
        for line, value, bound in (
            ("mean, mm", row["mean_mm"], arguments.max_mm),
            ("silent errors, %", row["silent"], arguments.max_silent),
            ("identity swaps", people.swaps(), arguments.max_swaps),
        ):
            if not value <= bound:
                failed.append(f"{folder.name}: {line} {value:.2f}, at most {bound}")
        if ratio > arguments.max_ratio:  # not if NaN
            failed.append(f"{folder.name}: {ratio:.2f} times `process`, at most {arguments.max_ratio}")
        rows.append(row)
    print(text("mean", {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}))
    for line in failed:
        print(f"FAILED {line}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
