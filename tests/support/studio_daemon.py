"""A daemon on a small virtual studio, for tests of clients, which needs no data; or on a session."""
import subprocess
from pathlib import Path


class StudioDaemon:
    """Four cameras of `size` px, or those of `session`; its recordings and calibrations in `folder`. port 0 takes a free
    one. `pose`: lines of the configuration's [pose]."""

    def __init__(
        self,
        program,
        folder,
        more="",
        port=0,
        motion="walk",
        size=(320, 240),
        fps=10,
        autostart=True,
        pose="",
        session=None,
        loop=True,
    ):
        self.folder = Path(folder)
        self.recordings = self.folder / "recordings"
        config = self.folder / "kinevoxd.toml"
        source = (
            f'kind = "studio"\n[source.studio]\nmotion = "{motion}"\n'
            f"width_px = {size[0]}\nheight_px = {size[1]}\nfps = {fps}\n"
        )
        if session is not None:
            source = f'kind = "session"\nsession_file = "{session}"\npacing = "real_time"\nloop = {str(loop).lower()}\n'
        config.write_text(
            f'[server]\nlisten = "127.0.0.1:{port}"\n[source]\nautostart = {str(autostart).lower()}\n{source}'
            f'[pose]\ndatabase_file = ""\nauto_fit_body = false\nfitted_body_file = ""\n{pose}[calibration]\nfolder = "{self.folder}/calibrations"\n'
            f'[recording]\nfolder = "{self.recordings}"\nmin_free_disk_mb = 0\nmax_queue_mb = 1000\n[log]\nlevel = "warning"\n{more}'
        )
        self.process = subprocess.Popen([program, "--config", str(config)], stdout=subprocess.PIPE, text=True)
        ready = self.process.stdout.readline().split()
        if not ready:
            raise RuntimeError("kinevoxd did not start")
        self.address = ready[-1]
        self.port = int(self.address.rsplit(":", 1)[1])

    def stop(self):
        """Returns the exit status."""
        self.process.terminate()
        status = self.process.wait()
        self.process.stdout.close()
        return status
