#!/usr/bin/python3
"""Kills a recording daemon at random moments and opens what it leaves.

usage: sigkill_recording.py [--kills 20] [--daemon kinevoxd] [--client kinevox] [--process kinevox-process]
                            [--sequence walk] [--codec utvideo] [--seed 1] [--keep FOLDER]

Each time kinevoxd runs a studio sequence as fast as it can, records, and gets SIGKILL 1.2 to 5 s after the recording began.
Then: the session opens, it holds whatever had been measured one second before the kill, its tables end together, it is
marked as recovered, and `kinevox process` runs on it. Prints a line a kill; exit status 1 if one fails."""
import argparse
import random
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "bench"))
from process_runs import data_folder  # noqa: E402
from recording_daemon import Daemon, add_arguments, frames_of  # noqa: E402

MOST_LOST_S = 1.0
QUEUE_MB = 64   # 17 frame sets


def kill_once(arguments, folder, number, wait_s):
    # As fast as it goes, so that it works on a machine that is busy; a queue of less than a second of it.
    daemon = Daemon(arguments, folder, pacing="as_fast_as_possible",
                    recording=f'codec = "{arguments.codec}"\nqueue_mb = {QUEUE_MB}\n')
    name = f"kill{number}"
    seen = []   # (when it was asked, the newest frame set that the daemon had measured by then)
    try:
        daemon.wait_for_results()
        daemon.client("record", "start", "--name", name)
        end = time.monotonic() + wait_s
        while time.monotonic() < end:
            asked = time.monotonic()
            seen.append((asked, daemon.json("status")["sequence"]))
        killed = time.monotonic()
    finally:
        daemon.process.send_signal(signal.SIGKILL)
        daemon.process.wait()
    session = Path(folder) / "recordings" / name / "session.toml"
    out = Path(folder) / f"out{number}"
    run = subprocess.run([arguments.process, str(session), "--out", str(out), "--quiet", "--frames", "6", "--no-pose"],
                         capture_output=True, text=True)
    if run.returncode != 0:
        return None, None, f"process: {run.stderr.strip()}"
    frames = frames_of(session.parent)
    # What it lacks was measured after the last look that it does hold.
    held = [asked for asked, sequence in seen if sequence <= frames[-1][1]]
    lacking_s = killed - (held[-1] if held else seen[0][0])
    text = session.read_text()
    if not re.search(r"^closed = true$", text, re.M) or not re.search(r"^recovered = true$", text, re.M):
        return len(frames), lacking_s, "session.toml does not say that it was recovered"
    if int(re.search(r"^frames = (\d+)$", text, re.M)[1]) != len(frames):
        return len(frames), lacking_s, "session.toml counts other frames than frames.csv"
    rows = {table: (session.parent / "poses" / table).read_text().count("\n") for table in
            ("joints.csv", "angles.csv", "coordinates.csv", "uncertainty.csv")}
    if len(set(rows.values())) != 1:
        return len(frames), lacking_s, f"the tables end apart: {rows}"
    if lacking_s > MOST_LOST_S:
        return len(frames), lacking_s, f"lacks more than {MOST_LOST_S:g} s"
    return len(frames), lacking_s, None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--codec", default="utvideo")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", help="leave the sessions in this folder")
    arguments = parser.parse_args()
    if not (data_folder() / "studio").exists():
        print("skipped: the studio's sequences are not here")
        return 77
    random.seed(arguments.seed)
    failures, worst_s = 0, 0.0
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or temporary
        for number in range(arguments.kills):
            wait_s = random.uniform(1.2, 5)
            frames, lacking_s, problem = kill_once(arguments, folder, number, wait_s)
            worst_s = max(worst_s, lacking_s or 0)
            failures += problem is not None
            told = "" if frames is None else f"{frames:4} frame sets, lacks {lacking_s:.2f} s"
            print(f"kill {number + 1:2} after {wait_s:.2f} s: {told}{'  FAILED: ' + problem if problem else ''}", flush=True)
    print(f"{arguments.kills - failures} of {arguments.kills} open and hold all but the last second; most lacking {worst_s:.2f} s")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
