#!/usr/bin/env python3
"""The daemon's live path against ground truth, every result: joints, silent errors and stated standard deviations.

usage: live.py [--sequences NAME,... | --scene NAME | --folders FOLDER,...] [--body fitted|default|automatic] [--pacing as_fast_as_possible|real_time]
               [--spans S,...] [--repeat N] [--option LINE] [--daemon PROGRAM] [--client PROGRAM] [--process PROGRAM] [--studio PROGRAM]
               [--work FOLDER] [--tables FOLDER] [--max-ratio N] [--max-silent N]

The daemon captures each sequence as fast as it can and records its poses, which are causal; `kinevox process` reads the same
session. Columns as in rates.py, "x" is the error over that of `process`. --body: fitted as `kinevox process` found it, the
default of an average adult, or fitted by the daemon to its first seconds, which takes time: use --pacing real_time.
--spans 2,5: further rows for the time before 2 s, from there to 5 s, and after. --repeat 3: of three captures, the one with the
median error (--work keeps the last); in real time results depend on what else the machine does. --scene renders scenes/NAME.toml and captures
that instead; --folders are others with session.toml and truth/, such as the trials that `sweep.py --keep` leaves (their
results/ are those of `kinevox process`). --tables has the results of `kinevox process`, of sequences.py with the same option. Exit status 77 without the
shared test data."""
import argparse
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from rates import SEQUENCES, heading, mean_row, measure, text
from session_data import REPOSITORY, Session, data_folder

sys.path.insert(0, str(REPOSITORY / "tests/bench"))
from recording_daemon import Daemon, add_arguments, frames_of  # noqa: E402

RECORDING = "max_queue_mb = 2000\nmin_free_disk_mb = 0\n"  # no frame set is dropped on machines that encode slowly


def rendered(arguments, work):
    """The folder of the scene's session."""
    folder = work / arguments.scene / "session"
    if not (folder / "session.toml").exists():
        scene = Path(__file__).parent / "scenes" / f"{arguments.scene}.toml"
        subprocess.run([arguments.studio, "--scene", scene, "--out", folder], check=True, stdout=subprocess.DEVNULL)
    return folder


def capture(arguments, name, sequence, folder, body, out, recording=RECORDING):
    """Copies the recorded poses of one capture to `out`; returns the sequence's frame of each of theirs."""
    arguments.sequence = sequence.resolve()
    pose = f'auto_fit_body = {str(arguments.body == "automatic").lower()}\n'
    if body:
        pose += f'body_file = "{body}"\n'
    pose += "".join(f"{line}\n" for line in arguments.option)
    daemon = Daemon(arguments, folder, arguments.pacing, recording, loop=False, autostart=False, pose=pose)
    try:
        daemon.client("record", "start", name)
        daemon.client("start")
        latest = daemon.wait_until_idle()["latest"]
        dropped = latest["dropped_frame_set_count"] or latest["lost_frame_set_count"]
        if dropped and arguments.pacing != "real_time":
            raise SystemExit(f"{name}: frame sets were dropped; run again on a machine with less load")
        shutil.copytree(daemon.recordings / name / "poses", out, dirs_exist_ok=True)
        return np.array([sequence for _, sequence, *_ in frames_of(daemon.recordings / name)])
    finally:
        daemon.stop()


def median_capture(arguments, folder, work):
    """The rows of the capture with the median error."""
    captures = sorted(
        (one(arguments, folder, work) for _ in range(arguments.repeat)), key=lambda rows: rows[0]["mean_mm"]
    )
    return captures[len(captures) // 2]


def one(arguments, folder, work):
    name = arguments.scene or folder.name
    session, processed = folder / "session.toml", work / name / "processed"
    if arguments.tables:
        processed = arguments.tables / name
    elif (folder / "results/run.toml").exists():
        processed = folder / "results"
    elif not (processed / "run.toml").exists():
        subprocess.run([arguments.process, session, "--out", processed, "--quiet", "--overwrite"], check=True)
    fps = Session(session).fps
    offline = measure(folder / "truth", fps, processed)
    with tempfile.TemporaryDirectory() as scratch:
        body = processed / "body.toml" if arguments.body == "fitted" else None
        sequence_frames = capture(arguments, name, folder, Path(scratch), body, work / name / "live")
    limits = [0, *arguments.spans, np.inf]
    parts = list(zip(limits, limits[1:])) if arguments.spans else []
    rows = []
    for span in [(0, np.inf), *parts]:
        if not ((sequence_frames >= span[0] * fps) & (sequence_frames < span[1] * fps)).any():
            continue  # the sequence ends before
        row = measure(folder / "truth", fps, work / name / "live", span, sequence_frames)
        row["ratio"] = row["mean_mm"] / offline["mean_mm"]
        row["span"] = span
        rows.append(row)
    return rows


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--sequences", default=",".join(SEQUENCES))
    parser.add_argument("--scene")
    parser.add_argument("--folders", type=lambda text: [Path(f) for f in text.split(",")])
    parser.add_argument("--studio", type=Path, default=REPOSITORY / "build/release/server/tools/kinevox-studio")
    parser.add_argument("--body", choices=("fitted", "default", "automatic"), default="fitted")
    parser.add_argument("--pacing", choices=("as_fast_as_possible", "real_time"), default="as_fast_as_possible")
    parser.add_argument("--spans", type=lambda text: [float(s) for s in text.split(",")], default=[])
    parser.add_argument("--repeat", type=int, default=1)
    parser.add_argument("--option", action="append", default=[], help="Line of the configuration's [pose], repeatable")
    parser.add_argument("--work", type=Path, help="Keep the results there, and reuse those of `kinevox process`")
    parser.add_argument("--tables", type=Path)
    parser.add_argument("--max-ratio", type=float, default=np.inf)
    parser.add_argument("--max-silent", type=float, default=np.inf)
    arguments = parser.parse_args()
    if not (arguments.scene or arguments.folders or (data_folder() / "studio").is_dir()):
        print(f"skipped: no test data at {data_folder()}")
        return 77
    failed = []
    with tempfile.TemporaryDirectory() as scratch:
        work = arguments.work or Path(scratch)
        print(heading(), flush=True)
        rows = []
        folders = arguments.folders or [data_folder() / "studio" / name for name in arguments.sequences.split(",")]
        for folder in [rendered(arguments, work)] if arguments.scene else folders:
            name = arguments.scene or folder.name
            row, *spans = median_capture(arguments, folder, work)
            print(text(name, 1, row, None), flush=True)
            for span in spans:
                print(text(f" {span['span'][0]:g}-{span['span'][1]:g} s", 1, span, None), flush=True)
            if row["ratio"] > arguments.max_ratio or row["silent"] > arguments.max_silent:
                failed.append(f"{name}: {row['ratio']:.2f} times `process`, silent {row['silent']:.2f} %")
            rows.append(row)
    print(mean_row("all", rows))
    for line in failed:
        print(f"FAILED {line}; at most {arguments.max_ratio} times and {arguments.max_silent} %")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
