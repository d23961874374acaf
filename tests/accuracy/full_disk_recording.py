#!/usr/bin/python3
"""Records onto a disk that fills up: a tmpfs of a few megabytes.

usage: full_disk_recording.py [--daemon kinevoxd] [--client kinevox] [--process kinevox-process] [--sequence walk]

Twice: with a threshold, below which the recording ends, and without one, so that a write fails. The recording must end
by itself with an event, the session open and `kinevox process` run on it, the daemon go on measuring, refuse the next
recording with a line that says why, and record again once there is room. Needs the right to mount (root); exit status
77 without."""
import argparse
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "bench"))
from process_runs import data_folder  # noqa: E402
from recording_daemon import Daemon, add_arguments, frames_of  # noqa: E402

DISK_MB = 160   # with the clip of the empty scene, which lies there too


def check(what, good, found=""):
    print(f"  {'ok' if good else 'FAILED'}: {what}{f' ({found})' if found else ''}", flush=True)
    if not good:
        raise SystemExit(1)


def run_once(arguments, folder, disk, least_free_mb):
    print(f"least_free_mb = {least_free_mb}")
    daemon = Daemon(arguments, folder, pacing="as_fast_as_possible", recordings=disk / "recordings",
                    recording=f"least_free_mb = {least_free_mb}\nqueue_mb = 64\n")
    try:
        daemon.wait_for_results()
        told = open(Path(folder) / f"events{least_free_mb}", "w+")
        events = subprocess.Popen([arguments.client, "events", "--server", daemon.address], stdout=told)
        daemon.client("record", "start", "--name", "full")
        last = daemon.wait_until_idle()["last"]
        check("the recording ended by itself", last["closed"], last["end_reason"])
        check("it says why", "make room" in last["end_reason"])
        events.terminate()
        events.wait()
        told.seek(0)
        lines = [line.strip() for line in told if "make room" in line]
        check("an event says so", len(lines) == 1, lines)
        daemon.wait_for_results(daemon.json("status")["results"] + 10)
        check("the capture goes on", True)
        session = disk / "recordings/full/session.toml"
        check("as many frame sets as it says", len(frames_of(session.parent)) == last["frames"], last["frames"])
        out = Path(folder) / f"out{least_free_mb}"
        run = subprocess.run([arguments.process, str(session), "--out", str(out), "--quiet", "--no-pose", "--frames", "20"],
                             capture_output=True, text=True)
        check("kinevox process runs on it", run.returncode == 0, run.stderr.strip())
        # What the recording did not keep at its end may have left the disk with more than the least again.
        filler = disk / "filler"
        filler.write_bytes(bytes(max(0, shutil.disk_usage(disk).free - max(least_free_mb - 5, 1) * 2**20)))
        refused = daemon.client("record", "start", "--name", "next", check=False)
        filler.unlink()
        if least_free_mb > 0:
            check("the next one is refused", refused.returncode == 1 and "make room" in refused.stderr, refused.stderr.strip())
        daemon.client("record", "stop", check=False)
        daemon.client("record", "delete", "next", check=False)
        daemon.client("record", "delete", "full")
        daemon.client("record", "start", "--name", "again")
        time.sleep(1.2)   # of some 40 MB a second on a machine at rest
        again = daemon.json("record", "stop")["recording"]
        check("with room it records again", again["frames"] > 5 and not again["end_reason"], again["frames"])
        daemon.client("record", "delete", "again")
    finally:
        check("the daemon ends as it should", daemon.stop() == 0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    arguments = parser.parse_args()
    if not (data_folder() / "studio").exists():
        print("skipped: the studio's sequences are not here")
        return 77
    with tempfile.TemporaryDirectory() as folder:
        disk = Path(folder) / "disk"
        disk.mkdir()
        mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m", "tmpfs", str(disk)], capture_output=True,
                                 text=True)
        if mounted.returncode != 0:
            print(f"skipped: cannot mount a tmpfs ({mounted.stderr.strip()})")
            return 77
        try:
            for least_free_mb in (20, 0):
                run_once(arguments, folder, disk, least_free_mb)
        finally:
            subprocess.run(["umount", str(disk)], check=False)
    return 0


if __name__ == "__main__":
    sys.exit(main())
