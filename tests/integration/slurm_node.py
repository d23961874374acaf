"""A Slurm cluster of one node, this machine, in a separate folder, for the test of the array script."""
import os
import shutil
import socket
import subprocess
import time
from pathlib import Path

PROGRAMS = ("munged", "slurmctld", "slurmd", "sbatch", "sinfo")
CONFIG = """ClusterName=one
SlurmctldHost={host}(127.0.0.1)
SlurmUser=root
SlurmdUser=root
AuthType=auth/munge
AuthInfo=socket={folder}/munge/socket
SlurmctldPort={ports[0]}
SlurmdPort={ports[1]}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdLogFile={folder}/slurmd.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_CPU
MailProg=/bin/true
JobAcctGatherType=jobacct_gather/none
ReturnToService=2
KillWait=2
NodeName={host} NodeAddr=127.0.0.1 CPUs=2 RealMemory=4000 State=UNKNOWN
PartitionName=all Nodes=ALL Default=YES MaxTime=INFINITE State=UP
"""


def problem():
    """Why it is unavailable here; empty: available."""
    missing = [name for name in PROGRAMS if not shutil.which(name, path=os.environ["PATH"] + ":/usr/sbin")]
    if missing:
        return f"{', '.join(missing)} not installed (Debian package slurm-wlm)"
    return "" if os.geteuid() == 0 else "Slurm's daemons require root"


def free_ports(count):
    probes = [socket.socket() for _ in range(count)]
    for probe in probes:
        probe.bind(("127.0.0.1", 0))
    ports = [probe.getsockname()[1] for probe in probes]
    for probe in probes:
        probe.close()
    return ports


class SlurmNode:
    """Between start() and stop(), call() runs one of Slurm's programs."""

    def __init__(self, folder):
        self.folder = Path(folder)
        for name in ("spool", "state", "munge"):
            (self.folder / name).mkdir(parents=True)
        for part in (self.folder, *self.folder.parents):  # munged requires folders that others cannot write
            if part.stat().st_uid == os.geteuid() and part != Path("/tmp"):
                part.chmod(0o755)
        key = self.folder / "munge/key"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o600)
        host = socket.gethostname().split(".")[0]
        (self.folder / "slurm.conf").write_text(CONFIG.format(folder=self.folder, host=host, ports=free_ports(2)))
        self.environment = dict(
            os.environ, SLURM_CONF=str(self.folder / "slurm.conf"), PATH=os.environ["PATH"] + ":/usr/sbin"
        )

    def start(self):
        """RuntimeError or CalledProcessError if it does not start."""
        try:
            munge = self.folder / "munge"
            self.call(
                "munged",
                f"--key-file={munge}/key",
                f"--socket={munge}/socket",
                f"--pid-file={munge}/pid",
                f"--log-file={munge}/log",
                f"--seed-file={munge}/seed",
                "--force",
            )
            self.call("slurmctld", "-f", self.folder / "slurm.conf")
            self.call("slurmd", "-f", self.folder / "slurm.conf")
            end = time.monotonic() + 30
            while "idle" not in self.call("sinfo", "-h", "-o", "%T", check=False).stdout:
                if time.monotonic() > end:
                    raise RuntimeError("no idle node: " + (self.folder / "slurmctld.log").read_text()[-2000:])
                time.sleep(0.2)
        except BaseException:
            self.stop()
            raise

    def stop(self):
        for pid_file in ("slurmd.pid", "slurmctld.pid", "munge/pid"):
            try:
                pid = int((self.folder / pid_file).read_text())
                os.kill(pid, 15)
                end = time.monotonic() + 10
                while Path(f"/proc/{pid}").exists() and time.monotonic() < end:
                    time.sleep(0.05)
            except (OSError, ValueError):
                pass

    def call(self, program, *arguments, check=True, **more):
        return subprocess.run(
            [program, *map(str, arguments)],
            env=self.environment | more,
            capture_output=True,
            text=True,
            check=check,
            timeout=120,
        )
