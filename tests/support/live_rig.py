"""Fake GigE Vision cameras and a daemon that captures them, in a separate network namespace.

For tests and benchmarks: call in_a_namespace() first; it restarts the script in a namespace with loopback
only, because cameras are discovered by broadcast."""
import json
import os
import signal
import subprocess
import sys
import time
from datetime import datetime, timezone
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
BUILD = REPOSITORY / "build/release"
SKIP = 77


def in_a_namespace(cameras=8, mounts=False):
    """Returns inside a network namespace, with `mounts` also a mount namespace. Exits with 77 if the kernel permits none."""
    if os.environ.get("KINEVOX_OWN_NETWORK") == "1":
        subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
        for n in range(2, cameras + 1):
            subprocess.run(["ip", "address", "add", f"127.0.0.{n}/8", "dev", "lo"], check=True)
        return
    kinds = ["--net", "--mount"] if mounts else ["--net"]
    for way in (["unshare", *kinds], ["unshare", *kinds, "--map-root-user"]):
        try:
            if subprocess.run([*way, "true"], stderr=subprocess.DEVNULL).returncode == 0:
                os.execvpe(way[0], [*way, sys.executable, *sys.argv], dict(os.environ, KINEVOX_OWN_NETWORK="1"))
        except FileNotFoundError:
            break
    print("skipped: network namespaces are not permitted here")
    sys.exit(SKIP)


class FakeCamera:
    """kinevox-fake-gige at 127.0.0.N with serial number F<N>."""

    def __init__(self, program, number, options=()):
        self.command = [
            str(program),
            "--address",
            f"127.0.0.{number}",
            "--serial",
            f"F{number}",
            "--seed",
            str(number),
            "--name",
            f"eye{number}",
            "--clock-offset-s",
            str(100 * number),
            "--clock-drift-ppm",
            str(20 * number),
            *map(str, options),
        ]
        self.process = None
        self.counts = []  # per run of the program
        self.start()

    def start(self):
        self.process = subprocess.Popen(self.command, stdout=subprocess.PIPE, text=True)
        line = self.process.stdout.readline()
        if not line.startswith("ready"):
            raise RuntimeError(f"{' '.join(self.command)}: {line or 'did not start'}")

    def vanish(self):
        """Simulates unplugging; returns the counts of this run."""
        self.process.send_signal(signal.SIGTERM)
        out, _ = self.process.communicate(timeout=10)
        self.counts.append(json.loads(out.splitlines()[-1]))
        self.process = None
        return self.counts[-1]

    def total(self, what):
        return sum(counts[what] for counts in self.counts)


def cameras_toml(names, calibration, more=""):
    text = f'[source]\nkind = "cameras"\n[source.cameras]\ncalibration_file = "{calibration}"\n{more}\n'
    for n, name in enumerate(names, 1):
        text += f'[[source.cameras.camera]]\nname = "{name}"\ndevice = "F{n}"\n'
    return text


class Daemon:
    def __init__(self, folder, text, daemon=BUILD / "server/daemon/kinevoxd", client=BUILD / "client/cli/kinevox"):
        self.client = str(client)
        self.events_file = Path(folder) / "events.jsonl"
        config = Path(folder) / "kinevoxd.toml"
        config.write_text('[server]\nlisten = "127.0.0.1:0"\n[log]\nlevel = "warning"\n' + text)
        environment = dict(os.environ, XDG_STATE_HOME=str(folder))
        self.process = subprocess.Popen(
            [str(daemon), "--config", str(config)], stdout=subprocess.PIPE, text=True, env=environment
        )
        line = self.process.stdout.readline()
        if not line.startswith("ready on "):
            raise RuntimeError(f"the daemon did not start: {line}")
        self.address = line.split()[-1]
        with open(self.events_file, "w") as events:
            self.events_process = subprocess.Popen(
                [self.client, "events", "--json", "--history", "100", "--server", self.address],
                stdout=events,
                stderr=subprocess.DEVNULL,
            )

    def kinevox(self, *arguments):
        run = subprocess.run(
            [self.client, *arguments, "--server", self.address, "--timeout", "30"], capture_output=True, text=True
        )
        if run.returncode:
            raise RuntimeError(f"kinevox {' '.join(arguments)}: {run.stderr.strip()}")
        return run.stdout

    def status(self):
        return json.loads(self.kinevox("status", "--json"))

    def connections(self):
        return [camera["connection"] for camera in self.status()["cameras"]]

    def events(self, *kinds):
        lines = self.events_file.read_text().splitlines()
        events = [json.loads(line) for line in lines if line.endswith("}")]
        return [event for event in events if not kinds or event["kind"] in kinds]

    def resident_mb(self):
        return resident_mb(self.process.pid)

    def end(self):
        """Ends remaining processes, however the test ends."""
        for process in (self.process, self.events_process):
            process.kill()
            process.wait()
        self.process.stdout.close()

    def stop(self):
        """Returns the elapsed seconds."""
        begin = time.monotonic()
        self.process.terminate()
        self.process.wait(timeout=20)
        self.events_process.wait(timeout=10)
        return time.monotonic() - begin


def event_time_ns(event):
    """UTC, of an event as `kinevox events --json` prints it."""
    whole, _, fraction = event["event_time"].rstrip("Z").partition(".")
    seconds = int(datetime.fromisoformat(whole).replace(tzinfo=timezone.utc).timestamp())
    return seconds * 10**9 + int(fraction.ljust(9, "0"))


def resident_mb(pid):
    """0 if the process has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    except OSError:
        return 0.0
    return next((int(line.split()[1]) / 1024 for line in lines if line.startswith("VmRSS:")), 0.0)


def wait_until(what, condition, seconds=30):
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        if condition():
            return
        time.sleep(0.05)
    raise AssertionError(f"{what}: not within {seconds} s")
