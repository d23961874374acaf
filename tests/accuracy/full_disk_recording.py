#!/usr/bin/python3
"""Records onto a disk that fills up: a tmpfs of a few megabytes.

usage: full_disk_recording.py [--daemon kinevoxd] [--client kinevox] [--process kinevox-process] [--sequence walk]

Twice: with min_free_disk_mb, below which the recording ends, and without it, so that a write fails. The recording must end
with an event, the session open and `kinevox process` run on it; the daemon continues to measure, refuses the next recording
with the reason in one line, and records again once there is space. Needs the right to mount (root); exit status 77
without."""
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

DISK_MB = 160  # includes the background clip


def check(what, good, found=""):
    print(f"  {'ok' if good else 'FAILED'}: {what}{f' ({found})' if found else ''}", flush=True)
    if not good:
        raise SystemExit(1)


def run_once(arguments, folder, disk, min_free_mb):
    print(f"min_free_disk_mb = {min_free_mb}")
    daemon = Daemon(
        arguments,
        folder,
        pacing="as_fast_as_possible",
        recordings=disk / "recordings",
        recording=f"min_free_disk_mb = {min_free_mb}\nmax_queue_mb = 64\n",
    )
    try:
        daemon.wait_for_results()
        log = open(Path(folder) / f"events{min_free_mb}", "w+")
        events = subprocess.Popen([arguments.client, "events", "--server", daemon.address], stdout=log)
        daemon.client("record", "start", "full")
        last = daemon.wait_until_idle()["latest"]
        check("the recording ended by itself", last["closed"], last["end_reason"])
        check("with the reason", "free some space" in last["end_reason"])
        events.terminate()
        events.wait()
        log.seek(0)
        lines = [line.strip() for line in log if "free some space" in line]
        check("and with an event", len(lines) == 1, lines)
        daemon.wait_for_results(daemon.json("status")["result_count"] + 10)
        check("the capture continues", True)
        session = disk / "recordings/full/session.toml"
        check(
            "it reports the number of its frame sets",
            len(frames_of(session.parent)) == last["frame_set_count"],
            last["frame_set_count"],
        )
        out = Path(folder) / f"out{min_free_mb}"
        run = subprocess.run(
            [arguments.process, str(session), "--out", str(out), "--quiet", "--no-pose", "--frames", "20"],
            capture_output=True,
            text=True,
        )
        check("kinevox process runs on it", run.returncode == 0, run.stderr.strip())
        # Truncating the recording at its end may have freed more than min_free_disk_mb.
        filler = disk / "filler"
        filler.write_bytes(bytes(max(0, shutil.disk_usage(disk).free - max(min_free_mb - 5, 1) * 2**20)))
        refused = daemon.client("record", "start", "next", check=False)
        filler.unlink()
        if min_free_mb > 0:
            check(
                "the next one is refused",
                refused.returncode == 1 and "free some space" in refused.stderr,
                refused.stderr.strip(),
            )
        daemon.client("record", "stop", check=False)
        daemon.client("record", "delete", "next", "--yes", check=False)
        daemon.client("record", "delete", "full", "--yes")
        shutil.rmtree(disk / "recordings/deleted")  # empties the bin
        daemon.client("record", "start", "again")
        time.sleep(1.2)  # about 40 MB per second on an idle machine
        again = daemon.json("record", "stop")["recording"]
        check(
            "with free space it records again",
            again["frame_set_count"] > 5 and not again["end_reason"],
            again["frame_set_count"],
        )
        daemon.client("record", "delete", "again", "--yes")
    finally:
        check("the daemon exits with status 0", daemon.stop() == 0)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    arguments = parser.parse_args()
    if not (data_folder() / "studio").exists():
        print("skipped: the studio's sequences are missing")
        return 77
    with tempfile.TemporaryDirectory() as folder:
        disk = Path(folder) / "disk"
        disk.mkdir()
        mounted = subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m", "tmpfs", str(disk)], capture_output=True, text=True
        )
        if mounted.returncode != 0:
            print(f"skipped: cannot mount a tmpfs ({mounted.stderr.strip()})")
            return 77
        try:
            for min_free_mb in (20, 0):
                run_once(arguments, folder, disk, min_free_mb)
        finally:
            subprocess.run(["umount", str(disk)], check=False)
    return 0


if __name__ == "__main__":
    sys.exit(main())
