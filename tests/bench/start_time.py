#!/usr/bin/python3
"""Time from the daemon's start to `ready`, and after a crash to the first pose with restored calibration, body and pose
database, on the studio; on fake GigE cameras with the restored background, too.

usage: start_time.py [--build build/release] [--runs 10] [--markdown FILE]"""
import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY / "tests/support"))


class Daemon:
    """The daemon with its state in `folder`; start() is the time to `ready`, in seconds."""

    def __init__(self, build, folder, config):
        self.build, self.folder = build, Path(folder)
        self.config = self.folder / "kinevoxd.toml"
        self.config.write_text(f'[server]\nlisten = "127.0.0.1:0"\n{config}')
        self.environment = dict(os.environ, XDG_STATE_HOME=str(folder))
        self.process = None

    def start(self):
        self.begun = time.monotonic()
        self.log = open(self.folder / "log", "a")
        self.process = subprocess.Popen(
            [self.build / "server/daemon/kinevoxd", "--config", self.config],
            text=True,
            stdout=subprocess.PIPE,
            stderr=self.log,
            env=self.environment,
        )
        line = self.process.stdout.readline()
        if not line.startswith("ready on"):
            sys.exit(f"the daemon did not start; see {self.log.name}")
        self.environment["KINEVOX_SERVER"] = line.split()[-1]
        return time.monotonic() - self.begun

    def kinevox(self, *arguments):
        return subprocess.run(
            [self.build / "client/cli/kinevox", *arguments],
            env=self.environment,
            capture_output=True,
            text=True,
            check=True,
        ).stdout

    def first_pose(self):
        """Seconds from the start to the first frame set with angles."""
        stream = subprocess.Popen(
            [self.build / "client/cli/kinevox", "stream", "angles", "--format", "csv"],
            env=self.environment,
            stdout=subprocess.PIPE,
            text=True,
        )
        stream.stdout.readline()
        for line in stream.stdout:
            if any(line.strip().split(",")[4:]):  # after frame, time, subject and sequence
                break
        seconds = time.monotonic() - self.begun
        stream.terminate()
        stream.communicate()
        return seconds

    def end(self, kill=False):
        if kill:
            self.process.kill()
        else:
            self.process.terminate()
        self.process.wait()
        self.process.stdout.close()
        self.log.close()


def until(what, condition, seconds=300):
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            sys.exit(f"{what}: not within {seconds} s")
        time.sleep(0.1)


def starts(build, runs):
    with tempfile.TemporaryDirectory() as folder:
        daemon = Daemon(build, folder, '[pose]\ndatabase_file = ""\n')
        times = []
        for _ in range(runs):
            times.append(daemon.start())
            daemon.end()
        return times


def restarts(build, runs):
    """SIGKILL in the middle of a capture, with a fitted body and a built database."""
    with tempfile.TemporaryDirectory() as folder:
        daemon = Daemon(build, folder, "[source.studio]\nfps = 15\n")
        daemon.start()
        daemon.first_pose()
        daemon.kinevox("body", "fit")
        state = Path(folder) / "kinevox"
        until("the body is stored", lambda: (state / "body.toml").exists())
        log = Path(folder) / "log"
        until("the database is built", lambda: "the pose database is ready" in log.read_text())
        # The fitted body needs another database, which the next start builds during the capture.
        daemon.end()
        daemon.start()
        until(
            "the database of the fitted body is built", lambda: log.read_text().count("the pose database is ready") == 2
        )
        ready, posed = [], []
        for _ in range(runs):
            daemon.end(kill=True)
            ready.append(daemon.start())
            posed.append(daemon.first_pose())
            until(
                "the database is read",
                lambda: log.read_text().count("the pose database is ready") == 2 + len(posed),
                10,
            )
        daemon.end()
        restored = log.read_text().count("using the fitted body") - 1, log.read_text().count("read from its file")
        return ready, posed, restored


def with_cameras(build, runs):
    from live_rig import FakeCamera, cameras_toml

    names = ["cam1", "cam2", "cam3", "cam4"]
    with tempfile.TemporaryDirectory() as folder:
        session = Path(folder) / "walk/session.toml"
        subprocess.run(
            [
                build / "server/tools/kinevox-studio",
                "--motion",
                "walk",
                "--frames",
                "60",
                "--background-frames",
                "8",
                "--no-masks",
                "--out",
                session.parent,
            ],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        empty = Path(folder) / "empty"
        empty.touch()
        cameras = [
            FakeCamera(
                build / "tests/support/fake_gige/kinevox-fake-gige",
                n,
                ["--session", session, "--camera", name, "--empty-while", empty],
            )
            for n, name in enumerate(names, 1)
        ]
        try:
            daemon = Daemon(
                build,
                folder,
                '[pose]\ndatabase_file = ""\n'
                + cameras_toml(
                    names,
                    session.parent / "calibration.toml",
                    'trigger = "external"\npixel_format = "BayerRG8"\nfps = 15\n',
                ),
            )
            daemon.start()
            until(
                "all deliver",
                lambda: all(
                    camera.get("connection", {}).get("connected")
                    for camera in json.loads(daemon.kinevox("status", "--json"))["cameras"]
                ),
            )
            daemon.kinevox("learn-background", "--frames", "32")
            until("the background is stored", lambda: (Path(folder) / "kinevox/background/cam4.index").exists())
            empty.unlink()
            ready, posed = [], []
            for _ in range(runs):
                daemon.end(kill=True)
                ready.append(daemon.start())
                posed.append(daemon.first_pose())
            daemon.end()
            return ready, posed
        finally:
            for camera in cameras:
                camera.process.kill()
                camera.process.communicate()


def row(what, times, bound):
    return f"| {what} | {statistics.median(times):.2f} | {max(times):.2f} | {bound} | {len(times)} |"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=Path, default=REPOSITORY / "build/release")
    parser.add_argument("--runs", type=int, default=10)
    parser.add_argument("--markdown", type=Path)
    arguments = parser.parse_args()
    if os.environ.get("KINEVOX_OWN_NETWORK") != "1":
        arguments.build = arguments.build.resolve()
    from live_rig import in_a_namespace

    in_a_namespace()
    begin = os.getloadavg()[0]
    lines = [
        "| | median, s | max, s | bound, s | runs |",
        "| --- | ---: | ---: | ---: | ---: |",
        row("start to `ready`, no database", starts(arguments.build, arguments.runs), 2),
    ]
    ready, posed, restored = restarts(arguments.build, arguments.runs)
    lines += [row("after SIGKILL to `ready`, studio", ready, ""), row("and to the first pose", posed, 5)]
    ready, live = with_cameras(arguments.build, arguments.runs)
    lines += [row("after SIGKILL to `ready`, four GigE cameras", ready, ""), row("and to the first pose", live, 5)]
    cpu = next(
        (line.split(":")[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")),
        platform.machine(),
    )
    lines += [
        "",
        f"The body was restored in {restored[0]} and the pose database in {restored[1]} of {arguments.runs} restarts of the studio.",
        f"{os.cpu_count()} cores of {cpu}; load average {begin:.1f} before, {os.getloadavg()[0]:.1f} after.",
    ]
    text = "\n".join(lines) + "\n"
    print(text)
    if arguments.markdown:
        arguments.markdown.write_text("# Time from start to first pose\n\n`tests/bench/start_time.py`:\n\n" + text)


if __name__ == "__main__":
    main()
