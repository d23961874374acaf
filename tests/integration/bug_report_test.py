#!/usr/bin/python3
"""kinevox bug-report: its contents, and what it must not contain. Also `kinevox discover` without cameras.

usage: bug_report_test.py BUILD_FOLDER [unittest options]"""
import json
import subprocess
import sys
import tarfile
import tempfile
import unittest
from pathlib import Path

BUILD = Path()
TOKEN = "kvx_" + "5ecre7" * 8
KEY = "-----BEGIN PRIVATE KEY-----\nMIIEvQIBADANBgkq\n-----END PRIVATE KEY-----\n"
CONFIG = """# administrator's note: the token is {token}
[server]
listen = "127.0.0.1:0"
[source.studio]
camera_count = 2
width_px = 160
height_px = 120
fps = 10.0
[pipeline]
voxel_mm = 40.0
[pose]
database_file = ""
auto_fit_body = false
[calibration]
folder = ""
[recording]
folder = ""
[log]
file = "{folder}/daemon.log"
"""


def report(*arguments):
    return subprocess.run(
        [BUILD / "client/cli/kinevox", "bug-report", *map(str, arguments)], capture_output=True, text=True, timeout=150
    )


def contents(archive):
    with tarfile.open(archive) as tar:
        return {Path(entry.name).name: tar.extractfile(entry).read() for entry in tar}


class BugReport(unittest.TestCase):
    def setUp(self):
        self.temporary = tempfile.TemporaryDirectory()
        self.addCleanup(self.temporary.cleanup)
        self.folder = Path(self.temporary.name)
        self.config = self.folder / "kinevoxd.toml"
        self.config.write_text(CONFIG.format(token=TOKEN, folder=self.folder))

    def test_contains_diagnostics_without_secrets_and_images(self):
        daemon = subprocess.Popen(
            [BUILD / "server/daemon/kinevoxd", "--config", self.config],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        try:
            address = daemon.stdout.readline().split()[-1]
            log = self.folder / "daemon.log"
            with open(log, "a") as more:
                more.write(f"authorization: Bearer {TOKEN}\n{KEY}")
            out = self.folder / "report.tar.gz"
            done = report("--out", out, "--server", address, "--config", self.config, "--log", log)
            self.assertEqual(done.returncode, 0, done.stderr)
        finally:
            daemon.terminate()
            daemon.wait()
            daemon.stdout.close()
        files = contents(out)
        self.assertEqual(
            set(files),
            {
                "about.json",
                "kinevoxd.toml",
                "status.json",
                "cameras.json",
                "events.jsonl",
                "calibrations.json",
                "doctor.json",
                "devices.json",
                "metrics.txt",
                "log.txt",
            },
        )
        about = json.loads(files["about.json"])
        self.assertRegex(about["client"], r"^kinevox \d")
        self.assertRegex(about["daemon"], r"^kinevoxd \d")
        self.assertIn("studio", json.loads(files["status.json"])["source"])
        self.assertEqual(len(json.loads(files["cameras.json"])), 2)
        self.assertIn("serves", files["log.txt"].decode())
        json.loads(files["doctor.json"])
        self.assertIn("recommended", json.loads(files["devices.json"]))
        everything = b"".join(files.values())
        self.assertNotIn(TOKEN[8:].encode(), everything)
        self.assertNotIn(b"MIIEvQ", everything)
        for name, data in files.items():
            for magic in (b"\xff\xd8\xff", b"\x89PNG", b"KVXV"):
                self.assertNotIn(magic, data, name)
        self.assertLess(out.stat().st_size, 1 << 20)
        self.assertEqual(
            sorted(p.name for p in self.folder.iterdir()), ["daemon.log", "kinevoxd.toml", "report.tar.gz"]
        )

    def test_works_without_a_daemon(self):
        out = self.folder / "report.tar.gz"
        self.config.unlink()
        done = report("--out", out, "--server", "127.0.0.1:1", "--config", self.config, "--log", "/dev/null/none")
        self.assertEqual(done.returncode, 1)
        self.assertEqual(done.stderr.count("\n"), 1)
        done = report("--out", out, "--server", "127.0.0.1:1", "--config", self.config)
        self.assertEqual(done.returncode, 0, done.stderr)
        files = contents(out)
        self.assertIn(b"127.0.0.1:1", files["status.json"])
        self.assertIn(b"does not exist", files["kinevoxd.toml"])

    def test_reports_an_unwritable_output(self):
        done = report(
            "--out", self.folder / "none" / "report.tar.gz", "--server", "127.0.0.1:1", "--config", self.config
        )
        self.assertEqual(done.returncode, 1)
        self.assertIn("--out", done.stderr)

    def test_discover_fails_without_cameras(self):
        done = subprocess.run(
            [BUILD / "client/cli/kinevox", "discover", "--json"], capture_output=True, text=True, timeout=60
        )
        found = json.loads(done.stdout)
        self.assertEqual(done.returncode, 0 if found else 1)
        if not found:
            self.assertIn("no camera answers", done.stderr)


if __name__ == "__main__":
    BUILD = Path(sys.argv.pop(1)).resolve()
    unittest.main()
