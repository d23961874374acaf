"""Targets of the faults in tests/bench/fault_kinds.py: daemons with a service manager, a clock and a disk."""
import contextlib
import os
import re
import struct
import subprocess
import tempfile
import time
from pathlib import Path

from live_rig import resident_mb
from recording_daemon import frames_of
from service import Service

from kinevox import Client, KinevoxError


class Violated(Exception):
    pass


def demand(what, good, found=""):
    if not good:
        raise Violated(f"{what}{f': {found}' if found != '' else ''}")


class Watched:
    """A service, its client and the checks of its recordings."""

    def __init__(self, rig, folder, recordings, more="", watchdog_s=20.0, environment=None):
        self.rig = rig
        self.recordings = Path(recordings)
        self.service = Service(
            rig.build / "tests/kinevoxd_failing_gpu",
            folder,
            rig.studio
            + more.format(folder=folder)
            + f'[recording]\nfolder = "{recordings}"\nmin_free_disk_mb = 4\nmax_queue_mb = 64\n',
            watchdog_s * rig.times_slower,
            rig.nice,
            environment,
        )
        self.service.wait_ready()
        self.client = Client(self.service.address, timeout_s=30, operator="faults")

    def results(self):
        return int(self.client.status().message.result_count)

    def wait_measuring(self):
        """Seconds until the daemon answers and has a new result."""
        limit_s = 60 * self.rig.times_slower
        begin, first = time.monotonic(), None
        while time.monotonic() - begin < limit_s:
            with contextlib.suppress(KinevoxError):
                message = self.client.status().message
                if first is None:
                    first = int(message.latest_sequence)
                elif int(message.latest_sequence) > first + 2:
                    return time.monotonic() - begin
            time.sleep(0.02)
        raise Violated(f"no results within {limit_s} s; see {self.service.log.name}")

    def check_recording(self, name, closed_by_itself=False):
        """Checks that the recording opens and is complete; returns its rows of frames.csv."""
        folder = self.recordings / name
        with tempfile.TemporaryDirectory() as out:
            run = subprocess.run(
                [
                    self.rig.build / "server/tools/kinevox-process",
                    folder / "session.toml",
                    "--out",
                    f"{out}/out",
                    "--quiet",
                    "--frames",
                    "3",
                    "--no-pose",
                ],
                capture_output=True,
                text=True,
            )
        demand(f"recording {name} does not open", run.returncode == 0, run.stderr.strip())
        text, frames = (folder / "session.toml").read_text(), frames_of(folder)
        demand(f"recording {name} is not closed", re.search(r"^closed = true$", text, re.M))
        said = int(re.search(r"^frame_sets = (\d+)$", text, re.M)[1])
        demand(f"recording {name} states {said} frame sets", said == len(frames), f"has {len(frames)}")
        utc = [row[3] for row in frames]
        demand(f"recording {name}: time decreases", all(a < b for a, b in zip(utc, utc[1:])))
        rows = {table: (folder / "poses" / table).read_text().count("\n") for table in ("joints.csv", "angles.csv")}
        demand(f"recording {name}: its tables have different lengths", len(set(rows.values())) == 1, rows)
        return frames

    def forget(self, name):
        with contextlib.suppress(KinevoxError):
            self.client.recordings.delete(name)

    def close(self):
        self.client.close()
        return self.service.stop()


class Rig:
    """Shared by the faults: the main daemon, which survives all but three of them, its clock and its disk."""

    def __init__(self, build, folder, random, nice, size, fps, phase_s, times_slower):
        self.build, self.folder, self.random, self.nice = build, Path(folder), random, nice
        self.times_slower = times_slower
        self.session = self.folder / "scene/session.toml"
        subprocess.run(
            [
                build / "server/tools/kinevox-studio",
                "--motion",
                "walk",
                "--frames",
                "12",
                "--background-frames",
                "8",
                "--cameras",
                "3",
                "--size",
                "320x240",
                "--no-masks",
                "--out",
                self.session.parent,
            ],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        self.studio = (
            f'[source]\nkind = "studio"\n[source.studio]\nmotion = "walk"\ncamera_count = 3\n'
            f"width_px = {size[0]}\nheight_px = {size[1]}\n"
            f'fps = {fps}\n[pipeline]\nvoxel_mm = 30\ndevice = "cuda"\n[pose]\ndatabase_file = ""\nauto_fit_body = false\n'
            f'fitted_body_file = ""\n[calibration]\nfolder = ""\n[log]\nlevel = "warning"\n'
        )
        self.disk = self.folder / "disk"
        self.disk.mkdir()
        # One and a half phases of uncompressed recording; "full disk" fills it.
        phase_mb = 1e-6 * 3 * size[0] * size[1] * 3 * fps * phase_s
        subprocess.run(
            ["mount", "-t", "tmpfs", "-o", f"size={max(192, 1.5 * phase_mb):.0f}m", "tmpfs", str(self.disk)], check=True
        )
        self.clock = self.folder / "clock"
        self.step_clock(0)
        preload = f"{os.environ.get('LD_PRELOAD', '')} {build / 'tests/step_clock.so'}"
        self.main = Watched(
            self,
            self.folder / "main",
            self.disk / "recordings",
            environment={"LD_PRELOAD": preload, "KINEVOX_CLOCK_STEP": str(self.clock)},
        )
        self.main.wait_measuring()

    def step_clock(self, seconds):
        with open(self.clock, "r+b" if self.clock.exists() else "wb") as file:
            file.write(struct.pack("q", seconds))

    def repair(self):
        """Resets clock, disk and recordings after a failed fault."""
        self.step_clock(0)
        (self.disk / "filler").unlink(missing_ok=True)
        with contextlib.suppress(KinevoxError):
            self.main.client.recordings.stop()
        for each in list(self.disk.glob("recordings/*/session.toml")):
            self.main.forget(each.parent.name)

    def main_mb(self):
        return resident_mb(self.main.service.process.pid)

    def close(self):
        try:
            return self.main.close()
        finally:
            subprocess.run(["umount", str(self.disk)], check=False)
