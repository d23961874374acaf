#!/usr/bin/env python3
"""The Debian packages: contents, dependencies, lintian, the service's exposure, and a run of their programs.
deploy/test-packages installs them in a fresh Debian.
usage: packages_test.py BUILD"""
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

BUILD = Path(sys.argv.pop(1)).resolve()
SOURCE = Path(__file__).resolve().parents[2]


def run(*command, **more):
    done = subprocess.run([str(part) for part in command], capture_output=True, text=True, **more)
    if done.returncode:
        raise AssertionError(f"{' '.join(map(str, command))}: {done.returncode}\n{done.stdout}{done.stderr}")
    return done.stdout


class Packages(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        out = Path(cls.folder.name)
        run(
            "cpack",
            "-G",
            "DEB",
            "-D",
            f"CPACK_PACKAGE_DIRECTORY={out}",
            "-D",
            f"CPACK_OUTPUT_FILE_PREFIX={out}",
            "-D",
            "CPACK_PACKAGE_VERSION=9.8.7",
            cwd=BUILD,
        )
        cls.packages = {file.name.split("_")[0]: file for file in out.glob("*.deb")}
        cls.root = out / "root"
        for file in cls.packages.values():
            run("dpkg-deb", "-x", file, cls.root)

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def field(self, package, name):
        return run("dpkg-deb", "-f", self.packages[package], name).strip()

    def files(self, package):
        listing = run("dpkg-deb", "-c", self.packages[package]).splitlines()
        return {line.split(maxsplit=5)[5][1:]: line.split()[0:2] for line in listing}

    def test_hold_what_belongs_to_them(self):
        self.assertLessEqual({"kinevox-server", "kinevox-client", "python3-kinevox"}, set(self.packages))
        server = self.files("kinevox-server")
        for file in [
            "/etc/kinevox/kinevoxd.toml",
            "/usr/bin/kinevoxd",
            "/lib/systemd/system/kinevoxd.service",
            "/lib/systemd/system/kinevox.slice",
            "/lib/udev/rules.d/60-kinevox.rules",
            "/usr/lib/kinevox/kinevox-doctor",
            "/usr/lib/kinevox/kinevox-process",
            "/usr/lib/kinevox/kinevox-tls",
            "/usr/lib/kinevox/kinevox-token",
        ]:
            self.assertIn(file, server)
        self.assertIn("/usr/bin/kinevox", self.files("kinevox-client"))
        self.assertIn("/usr/lib/python3/dist-packages/kinevox/v1/types_pb2.py", self.files("python3-kinevox"))
        for package in self.packages:
            for file, (mode, owner) in self.files(package).items():
                self.assertEqual(owner, "root/root", f"{package}: {file}")
                self.assertNotRegex(mode, "^-....w|^.......w|s", f"{package}: {file}")
                self.assertNotIn("__pycache__", file)
        self.assertEqual(self.field("kinevox-server", "Version"), "9.8.7")

    def test_depend_on_what_they_need(self):
        server, client = self.field("kinevox-server", "Depends"), self.field("kinevox-client", "Depends")
        for library in [
            "libgrpc++",
            "libopencv-core",
            "libaravis",
            "libtbb",
            "libsystemd0",
            "adduser",
            "kinevox-client",
        ]:
            self.assertIn(library, server)
        self.assertNotRegex(server, "qt6|libgtk")
        self.assertIn("libgrpc++", client)
        self.assertNotRegex(client, "opencv|aravis|tbb|qt6")
        for module in ["grpcio", "numpy", "protobuf", "zstandard"]:
            self.assertIn(f"python3-{module}", self.field("python3-kinevox", "Depends"))
        self.assertEqual(self.field("python3-kinevox", "Architecture"), "all")

    def test_the_configuration_is_the_users(self):
        conffiles = run("dpkg-deb", "-I", self.packages["kinevox-server"], "conffiles").split()
        self.assertEqual(conffiles, ["/etc/kinevox/kinevoxd.toml"])
        self.assertEqual(
            (self.root / "etc/kinevox/kinevoxd.toml").read_text(), (SOURCE / "deploy/kinevoxd.toml").read_text()
        )

    def test_lintian_finds_no_error(self):
        if not shutil.which("lintian"):
            self.skipTest("lintian is not installed")
        done = subprocess.run(
            ["lintian", "--fail-on", "error", *map(str, self.packages.values())], capture_output=True, text=True
        )
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        self.assertNotRegex(done.stdout, "(?m)^E: ")

    def test_the_service_is_closed_to_the_rest(self):
        if not shutil.which("systemd-analyze"):
            self.skipTest("systemd is not installed")
        unit = self.root / "lib/systemd/system/kinevoxd.service"
        said = run("systemd-analyze", "security", "--offline=true", unit)
        exposure = float(re.search(r"Overall exposure level for .*: ([0-9.]+)", said).group(1))
        self.assertLessEqual(exposure, 2.0, said)
        print(f"exposure {exposure}")

    def test_what_they_hold_runs(self):
        """Without the build folder: the daemon streams the studio's subject to the client."""
        state = Path(self.folder.name) / "state"
        state.mkdir()
        environment = {"PATH": f"{self.root}/usr/bin:/usr/bin:/bin", "XDG_STATE_HOME": str(state), "LC_ALL": "C.UTF-8"}
        config = (self.root / "etc/kinevox/kinevoxd.toml").read_text().replace("127.0.0.1:50770", "127.0.0.1:0")
        for full, small in [
            ("width_px = 640", "width_px = 240"),
            ("height_px = 480", "height_px = 180"),
            ("fps = 30.0", "fps = 10.0"),
            ("voxel_mm = 10.0", "voxel_mm = 20.0"),
            ('# database_file = "poses.kvxposes"', 'database_file = ""'),
        ]:
            self.assertIn(full, config)
            config = config.replace(full, small, 1)
        file = Path(self.folder.name) / "kinevoxd.toml"
        file.write_text(config + "\n")
        log = open(Path(self.folder.name) / "log", "w+")
        daemon = subprocess.Popen(
            [self.root / "usr/bin/kinevoxd", "--config", file],
            env=environment,
            text=True,
            stdout=subprocess.PIPE,
            stderr=log,
        )
        try:
            ready = daemon.stdout.readline()
            log.seek(0)
            self.assertRegex(ready, "^ready on ", log.read())
            self.assertEqual(Path(f"/proc/{daemon.pid}/comm").read_text(), "kinevoxd\n")
            environment["KINEVOX_SERVER"] = ready.split()[-1]
            angles = run(
                "kinevox", "stream", "angles", "--format", "csv", "--frames", "30", env=environment, timeout=200
            ).splitlines()
            self.assertEqual(len(angles), 31)
            posed = [line for line in angles[1:] if re.search(r"(,-?[0-9.]+){10}", line)]
            self.assertGreater(len(posed), 5)
            self.assertIn("doctor", run("kinevox", "--help", env=environment))
            self.assertIn("cameras", run("kinevox", "doctor", "--help", env=environment))
            doctor = subprocess.run(
                ["kinevox", "doctor", "--config", file, "--json", "--no-discovery"],
                env=environment,
                capture_output=True,
                text=True,
            )
            self.assertIn(doctor.returncode, (0, 1), doctor.stderr)
            checks = {finding["check"] for finding in json.loads(doctor.stdout)["findings"]}
            self.assertLessEqual(
                {
                    "configuration",
                    "port",
                    "cameras",
                    "receive buffers",
                    "GPU driver",
                    "huge pages",
                    "open files",
                    "clock",
                    "state",
                    "disk space",
                },
                checks,
            )
        finally:
            daemon.terminate()
            daemon.wait()
            daemon.stdout.close()
            log.close()

    def test_the_containers_copy_packages_that_there_are(self):
        text = (SOURCE / "deploy/container/Containerfile").read_text()
        wanted = set(re.findall(r"/([a-z0-9-]+)_\*\.deb", text))
        self.assertTrue(wanted)
        self.assertLessEqual(wanted, set(self.packages))
        self.assertTrue((SOURCE / "deploy/container/ignore").is_file())

    def test_the_maintainers_scripts_are_shell(self):
        for script in (SOURCE / "deploy/debian").glob("*/p*"):
            run("sh", "-n", script)


if __name__ == "__main__":
    if not shutil.which("dpkg-deb") or not shutil.which("dpkg-shlibdeps") or not shutil.which("cpack"):
        print("skipped: the tools for Debian packages are not installed")
        sys.exit(77)
    os.umask(0o022)
    unittest.main(verbosity=2)
