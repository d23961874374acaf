#!/usr/bin/python3
"""Kills a recording daemon at random times and opens the recording.

usage: sigkill_recording.py [--kills 20] [--daemon kinevoxd] [--client kinevox] [--process kinevox-process]
                            [--sequence walk] [--codec utvideo] [--seed 1] [--work FOLDER]

Each time kinevoxd runs a studio sequence as fast as possible, records, and gets SIGKILL 1.2 to 5 s after the recording
started. Then the session opens, contains everything measured until one second before the kill, its tables have the same
length, it is marked as recovered, and `kinevox process` runs on it. Prints one line per kill; exit status 1 if one fails."""
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

MAX_LOST_S = 1.0
QUEUE_MB = 64  # 17 frame sets


def kill_once(arguments, folder, number, wait_s):
    # As fast as possible, which works on a busy machine; the queue holds less than a second.
    daemon = Daemon(
        arguments,
        folder,
        pacing="as_fast_as_possible",
        recording=f'codec = "{arguments.codec}"\nmax_queue_mb = {QUEUE_MB}\n',
    )
    name = f"kill{number}"
    seen = []  # (time of the request, latest frame set that the daemon had processed)
    try:
        daemon.wait_for_results()
        daemon.client("record", "start", name)
        end = time.monotonic() + wait_s
        while time.monotonic() < end:
            asked = time.monotonic()
            seen.append((asked, daemon.json("status")["latest_sequence"]))
        killed = time.monotonic()
    finally:
        daemon.process.send_signal(signal.SIGKILL)
        daemon.process.wait()
    session = Path(folder) / "recordings" / name / "session.toml"
    out = Path(folder) / f"out{number}"
    run = subprocess.run(
        [arguments.process, str(session), "--out", str(out), "--quiet", "--frames", "6", "--no-pose"],
        capture_output=True,
        text=True,
    )
    if run.returncode != 0:
        return None, None, f"process: {run.stderr.strip()}"
    frames = frames_of(session.parent)
    # It lacks what was processed after the last request whose frame set it contains.
    held = [asked for asked, sequence in seen if sequence <= frames[-1][1]]
    lacking_s = killed - (held[-1] if held else seen[0][0])
    text = session.read_text()
    if not re.search(r"^closed = true$", text, re.M) or not re.search(r"^recovered = true$", text, re.M):
        return len(frames), lacking_s, "session.toml is not marked as recovered"
    if int(re.search(r"^frame_sets = (\d+)$", text, re.M)[1]) != len(frames):
        return len(frames), lacking_s, "session.toml and frames.csv have different counts"
    rows = {
        table: (session.parent / "poses" / table).read_text().count("\n")
        for table in ("joints.csv", "angles.csv", "coordinates.csv", "uncertainty.csv")
    }
    if len(set(rows.values())) != 1:
        return len(frames), lacking_s, f"the tables have different lengths: {rows}"
    if lacking_s > MAX_LOST_S:
        return len(frames), lacking_s, f"lacks more than {MAX_LOST_S:g} s"
    return len(frames), lacking_s, None


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--codec", default="utvideo")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--work", help="keep the sessions in this folder")
    arguments = parser.parse_args()
    if not (data_folder() / "studio").exists():
        print("skipped: the studio's sequences are missing")
        return 77
    random.seed(arguments.seed)
    failures, worst_s = 0, 0.0
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.work or temporary
        for number in range(arguments.kills):
            wait_s = random.uniform(1.2, 5)
            frames, lacking_s, problem = kill_once(arguments, folder, number, wait_s)
            worst_s = max(worst_s, lacking_s or 0)
            failures += problem is not None
            summary = "" if frames is None else f"{frames:4} frame sets, lacks {lacking_s:.2f} s"
            print(
                f"kill {number + 1:2} after {wait_s:.2f} s: {summary}{'  FAILED: ' + problem if problem else ''}",
                flush=True,
            )
    print(
        f"{arguments.kills - failures} of {arguments.kills} open and contain all but the last second; at most {worst_s:.2f} s"
    )
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
