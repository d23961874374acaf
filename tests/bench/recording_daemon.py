"""A daemon on a studio sequence, for scripts that check its recordings."""
import json
import subprocess
import time
from pathlib import Path

from process_runs import REPOSITORY, data_folder


def add_arguments(parser):
    build = REPOSITORY / "build/release"
    parser.add_argument("--daemon", default=str(build / "server/daemon/kinevoxd"))
    parser.add_argument("--client", default=str(build / "client/cli/kinevox"))
    parser.add_argument("--process", default=str(build / "server/tools/kinevox-process"))
    parser.add_argument("--sequence", default="walk", help="of shared/data/studio")


def frames_of(folder):
    """Rows of a recording's frames.csv: frame, sequence, time_ns, capture_time_utc_ns."""
    lines = (Path(folder) / "frames.csv").read_text().splitlines()[1:]
    return [tuple(int(cell) for cell in line.split(",")) for line in lines]


class Daemon:
    def __init__(
        self,
        arguments,
        folder,
        pacing,
        recording="",
        loop=True,
        autostart=True,
        recordings=None,
        pose="auto_fit_body = false\n",
    ):
        self.program = arguments.client
        session = data_folder() / "studio" / arguments.sequence / "session.toml"
        config = Path(folder) / "kinevoxd.toml"
        self.recordings = Path(recordings or Path(folder) / "recordings")
        config.write_text(
            f'[server]\nlisten = "127.0.0.1:0"\n[source]\nkind = "session"\nsession_file = "{session}"\n'
            f'pacing = "{pacing}"\nloop = {str(loop).lower()}\nautostart = {str(autostart).lower()}\n'
            f'[pose]\ndatabase_file = ""\n{pose}[calibration]\nfolder = ""\n'
            f'[recording]\nfolder = "{self.recordings}"\n{recording}[log]\nlevel = "warning"\n'
        )
        self.process = subprocess.Popen([arguments.daemon, "--config", str(config)], stdout=subprocess.PIPE, text=True)
        ready = self.process.stdout.readline().split()
        if not ready:
            raise RuntimeError("kinevoxd did not start")
        self.address = ready[-1]

    def client(self, *words, check=True):
        return subprocess.run(
            [self.program, *words, "--server", self.address, "--timeout", "60"],
            capture_output=True,
            text=True,
            check=check,
        )

    def json(self, *words):
        return json.loads(self.client(*words, "--json").stdout)

    def wait_for_results(self, count=5, limit_s=60):
        end = time.monotonic() + limit_s
        while int(self.json("status").get("result_count", 0)) < count:
            if time.monotonic() > end:
                raise RuntimeError("the daemon has no results")
            time.sleep(0.1)

    def wait_until_idle(self, limit_s=600):
        """The recorder's status after the current recording has ended by itself."""
        end = time.monotonic() + limit_s
        while (status := self.json("record", "status"))["state"] != "idle":
            if time.monotonic() > end:
                raise RuntimeError("the recording does not end")
            time.sleep(0.5)  # each question starts a process, beside the capture
        return status

    def stop(self):
        self.process.terminate()
        return self.process.wait()
