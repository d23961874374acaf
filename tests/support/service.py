"""kinevoxd as a service without systemd: a service manager that receives notifications, supervises and restarts it."""
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
UNIT = REPOSITORY / "deploy/systemd/kinevoxd.service"


def unit_nice():
    """The unit's priority if this process may set it, else None."""
    nice = int(re.search(r"^Nice=(-?\d+)$", UNIT.read_text(), re.M)[1])
    return nice if subprocess.run(["nice", "-n", str(nice), "true"], capture_output=True).stderr == b"" else None


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Service:
    """Starts at once and restarts after failures, like Restart=on-failure. If it reports a hang or sends nothing for
    `watchdog_s`, it gets SIGABRT, and SIGKILL five seconds later. `ends` has (exit status, reason) of each ended run.
    """

    def __init__(self, program, folder, config, watchdog_s=20.0, nice=None, environment=None):
        self.folder = Path(folder)
        self.folder.mkdir(parents=True, exist_ok=True)
        self.port = free_port()
        self.address = f"127.0.0.1:{self.port}"
        file = self.folder / "kinevoxd.toml"
        file.write_text(f'[server]\nlisten = "{self.address}"\n{config}')
        self.command = (["nice", "-n", str(nice)] if nice is not None else []) + [str(program), "--config", str(file)]
        self.watchdog_s = watchdog_s
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.socket.bind(str(self.folder / "notify"))
        self.socket.settimeout(0.05)
        self.environment = dict(
            os.environ,
            XDG_STATE_HOME=str(folder),
            NOTIFY_SOCKET=str(self.folder / "notify"),
            WATCHDOG_USEC=str(int(watchdog_s * 1e6)),
            **(environment or {}),
        )
        self.ends, self.hangs, self.ready_lives, self.status, self.why = [], 0, 0, "", None
        self.log = open(self.folder / "log", "a+")
        self.stopping = False
        self._start()
        self.thread = threading.Thread(target=self._watch, daemon=True)
        self.thread.start()

    def _start(self):
        self.heard, self.aborted = time.monotonic(), None
        self.process = subprocess.Popen(self.command, stdout=subprocess.DEVNULL, stderr=self.log, env=self.environment)

    def _watch(self):
        while True:
            self._hear()
            now = time.monotonic()
            if self.aborted is None and now - self.heard > self.watchdog_s and not self.stopping:
                self._abort()
            if self.aborted is not None and now - self.aborted > 5:
                self.process.kill()
            if self.process.poll() is None:
                continue
            self.ends.append((self.process.returncode, "stop" if self.stopping else self.why))
            self.why = None
            if self.stopping:
                return
            time.sleep(0.5)  # RestartSec
            self._start()

    def _hear(self):
        try:
            said = self.socket.recv(4096).decode()
        except TimeoutError:
            return
        for line in said.splitlines():
            if line == "READY=1":
                self.ready_lives = len(self.ends) + 1
            if line in ("READY=1", "WATCHDOG=1"):
                self.heard = time.monotonic()
            if line == "WATCHDOG=trigger" and self.aborted is None:
                self._abort()
            if line.startswith("STATUS="):
                self.status = line.removeprefix("STATUS=")

    def _abort(self):
        self.hangs += 1
        self.why = self.why or "hang"
        self.aborted = time.monotonic()
        self.process.send_signal(signal.SIGABRT)
        self.process.send_signal(signal.SIGCONT)  # like systemd, so that a stopped process receives it

    def kill(self):
        self.why = "kill"
        self.process.kill()

    def wait_ready(self, life=1, limit_s=60):
        """Waits until run number `life`, from 1, is ready."""
        end = time.monotonic() + limit_s
        while self.ready_lives < life:
            if time.monotonic() > end:
                raise RuntimeError(f"the daemon is not ready after {limit_s} s; see {self.log.name}")
            time.sleep(0.01)

    def stop(self):
        """The exit status, or the negative signal number, as in `ends`."""
        self.stopping = True
        self.process.terminate()
        self.thread.join(timeout=40)
        if self.thread.is_alive():
            self.process.kill()
            self.thread.join()
        self.socket.close()
        self.log.close()
        return self.ends[-1][0]


# A separate process: the tracer must exist until the thread ends.
_HOLD = r"""
import ctypes, os, sys
pid, name = int(sys.argv[1]), sys.argv[2]
libc = ctypes.CDLL(None, use_errno=True)
libc.ptrace.argtypes = [ctypes.c_long, ctypes.c_long, ctypes.c_void_p, ctypes.c_void_p]
tasks = [int(task) for task in os.listdir(f"/proc/{pid}/task") if open(f"/proc/{pid}/task/{task}/comm").read().strip() == name]
SEIZE, INTERRUPT, WALL = 0x4206, 0x4207, 0x40000000
if not tasks or libc.ptrace(SEIZE, tasks[0], None, None) or libc.ptrace(INTERRUPT, tasks[0], None, None):
    sys.exit(f"cannot hold {name}: {os.strerror(ctypes.get_errno())}")
os.waitpid(tasks[0], WALL)
print("held", flush=True)
os.waitpid(tasks[0], WALL)
"""


class HeldThread:
    """Stops a thread of the daemon until release() or the daemon's end."""

    def __init__(self, pid, name):
        self.holder = subprocess.Popen(
            [sys.executable, "-c", _HOLD, str(pid), name], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        self.held = self.holder.stdout.readline() == "held\n"

    def release(self):
        self.holder.kill()  # the kernel then releases the thread
        self.holder.communicate()
