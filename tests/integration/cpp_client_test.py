#!/usr/bin/python3
"""The C++ client as others use it: installed, found by pkg-config, and its examples against a daemon.

usage: cpp_client_test.py BUILD_FOLDER"""
import os
import re
import shlex
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
BUILD = Path(sys.argv.pop(1)).resolve()
EXAMPLES = REPOSITORY / "client/lib/examples"
sys.path.insert(0, str(REPOSITORY / "tests/support"))
from studio_daemon import StudioDaemon  # noqa: E402


class CppClient(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.temporary = tempfile.TemporaryDirectory(prefix="kinevox-cpp-")
        cls.folder = Path(cls.temporary.name)
        subprocess.run(
            ["cmake", "--install", BUILD, "--component", "dev", "--prefix", cls.folder / "opt"],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        environment = {**os.environ, "PKG_CONFIG_PATH": str(cls.folder / "opt/lib/pkgconfig")}
        flags = subprocess.run(
            ["pkg-config", "--cflags", "--libs", "kinevox-client"],
            check=True,
            capture_output=True,
            text=True,
            env=environment,
        ).stdout
        for example in ("knee_angle", "save_volume"):
            # In a folder of its own: nothing of the source tree is found.
            subprocess.run(
                ["g++", EXAMPLES / f"{example}.cc", *shlex.split(flags), "-o", cls.folder / example],
                check=True,
                cwd=cls.folder,
            )
        cls.daemon = StudioDaemon(str(BUILD / "server/daemon/kinevoxd"), cls.folder / "opt")

    @classmethod
    def tearDownClass(cls):
        cls.daemon.stop()
        cls.temporary.cleanup()

    def test_knee_angle_prints_poses(self):
        process = subprocess.Popen(
            [self.folder / "knee_angle", self.daemon.address], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        try:
            lines = [line for line, _ in zip(process.stdout, range(3))]
        finally:
            process.kill()
            error = process.communicate()[1]
        self.assertEqual(len(lines), 3, error)
        for line in lines:
            self.assertRegex(line, r"^\d{9,}\.\d{3} s  subject \d+  -?\d+\.\d \+- \d+\.\d deg$")

    def test_save_volume_writes_a_ply(self):
        file = self.folder / "volume.ply"
        done = subprocess.run(
            [self.folder / "save_volume", file, self.daemon.address], capture_output=True, text=True, timeout=60
        )
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        litres = float(re.search(r"([\d.]+) litres", done.stdout)[1])
        self.assertTrue(20 < litres < 200, litres)
        self.assertTrue(file.read_bytes().startswith(b"ply\n"))

    def test_errors_name_the_daemon(self):
        done = subprocess.run(
            [self.folder / "save_volume", self.folder / "none.ply", "127.0.0.1:1"],
            capture_output=True,
            text=True,
            timeout=60,
        )
        self.assertEqual(done.returncode, 1)
        self.assertIn("127.0.0.1:1", done.stderr)


if __name__ == "__main__":
    unittest.main()
