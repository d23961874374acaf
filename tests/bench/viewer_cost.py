#!/usr/bin/python3
"""CPU time, memory and latency of the viewer with software OpenGL.

usage: viewer_cost.py [--daemon kinevoxd] [--client kinevox] [--viewer kinevox-viewer] [--sequence walk] [--seconds 60]
                      [--size 1280x800] [--results FOLDER]

Starts kinevoxd on a studio sequence (4 x 640 x 480, 30 frame sets per second, in a loop) and kinevox-viewer in its own
Xvfb with the default view: volume, skeleton, curves, camera images. CPU time is that of the viewer's process, after a
warm-up. Bounds: 60 % of a core; a median of 120 ms from capture to painting; constant memory, best checked with --seconds
1800. Writes viewer.md. Exits with 1 if a bound is not met."""
import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from process_runs import REPOSITORY, RESULTS
from recording_daemon import Daemon, add_arguments

WARM_UP_S = 8
MOST_CORE, MOST_DELAY_MS, MOST_GROWTH_MB = 0.60, 120.0, 10.0


def processor_s(pid):
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_mb(pid):
    return int(re.search(r"VmRSS:\s+(\d+)", Path(f"/proc/{pid}/status").read_text())[1]) / 1024


def child_of(pid, name, limit_s=20):
    """The process of that name below `pid`."""
    end = time.monotonic() + limit_s
    while time.monotonic() < end:
        for folder in Path("/proc").iterdir():
            try:
                fields = (folder / "stat").read_text().rsplit(")", 1)[1].split()
                if int(fields[1]) == pid and (folder / "comm").read_text().strip() == name[:15]:
                    return int(folder.name)
            except (OSError, ValueError, IndexError):
                continue
        time.sleep(0.1)
    raise RuntimeError(f"{name} did not start")


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--viewer", default=str(REPOSITORY / "build/release/client/viewer/kinevox-viewer"))
    parser.add_argument("--seconds", type=float, default=60)
    parser.add_argument("--size", default="1280x800")
    parser.add_argument("--results", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    if not shutil.which("xvfb-run"):
        sys.exit("viewer_cost: xvfb-run is not installed; deploy/install-deps installs it")
    with tempfile.TemporaryDirectory() as folder:
        daemon = Daemon(arguments, folder, pacing="real_time")
        try:
            daemon.wait_for_results()
            image = Path(folder) / "viewer.png"
            window = subprocess.Popen(
                [
                    "xvfb-run",
                    "-a",
                    "-s",
                    f"-screen 0 {arguments.size}x24",
                    arguments.viewer,
                    "--server",
                    daemon.address,
                    "--screenshot",
                    str(image),
                    "--screenshot-delay",
                    str(WARM_UP_S + arguments.seconds + 2),
                ],
                env={**os.environ, "XDG_CONFIG_HOME": folder},
                stdout=subprocess.PIPE,
                text=True,
            )
            viewer = child_of(window.pid, "kinevox-viewer")
            time.sleep(WARM_UP_S)
            used, begin, first_mb = processor_s(viewer), time.monotonic(), resident_mb(viewer)
            time.sleep(arguments.seconds)
            core = (processor_s(viewer) - used) / (time.monotonic() - begin)
            growth = resident_mb(viewer) - first_mb
            said = window.communicate(timeout=60)[0]
            rate, delay = (
                float(re.search(pattern, said)[1]) for pattern in (r"([\d.]+) volumes per second", r"([\d.]+) ms")
            )
            if window.returncode != 0:
                sys.exit("viewer_cost: the viewer failed")
        finally:
            daemon.stop()
    rows = [
        ("CPU, % of a core", f"{100 * core:.0f}", f"< {100 * MOST_CORE:.0f}", core < MOST_CORE),
        ("volumes painted per second", f"{rate:.0f}", ">= 25", rate >= 25),
        (
            "latency from capture to painting, ms, median",
            f"{delay:.0f}",
            f"< {MOST_DELAY_MS:.0f}",
            delay < MOST_DELAY_MS,
        ),
        (
            f"memory growth in {arguments.seconds:.0f} s, MB, of {first_mb:.0f}",
            f"{growth:.1f}",
            f"< {MOST_GROWTH_MB:.0f}",
            growth < MOST_GROWTH_MB,
        ),
    ]
    text = (
        f"Viewer: `tests/bench/viewer_cost.py --seconds {arguments.seconds:.0f}`, {arguments.size}, software OpenGL, "
        f"{os.cpu_count()} cores, with the daemon; load at the end {os.getloadavg()[0]:.1f}.\n\n| quantity | measured | bound | met |\n"
        "| --- | --- | --- | --- |\n"
    )
    text += "".join(
        f"| {what} | {seen} | {bound} | {'yes' if kept else '**no**'} |\n" for what, seen, bound, kept in rows
    )
    print(text)
    (arguments.results / "viewer.md").write_text(text)
    sys.exit(0 if all(row[3] for row in rows) else 1)


if __name__ == "__main__":
    main()
