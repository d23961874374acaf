#!/usr/bin/python3
"""kinevox-bridge against a real daemon on the virtual studio: its examples receive the poses.

usage: bridge_test.py BUILD-FOLDER"""
import importlib.util
import signal
import socket
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from studio_daemon import StudioDaemon  # noqa: E402

BUILD = Path(sys.argv.pop(1))
EXAMPLES = Path(__file__).resolve().parents[2] / "client/bridge/examples"


def example(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as s:
        s.bind(("127.0.0.1", 0))
        return s.getsockname()[1]


class BridgeTest(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.daemon = StudioDaemon(BUILD / "server/daemon/kinevoxd", cls.folder.name, size=(240, 180), fps=8)
        cls.address = cls.daemon.address

    @classmethod
    def tearDownClass(cls):
        cls.daemon.stop()
        cls.folder.cleanup()

    def bridge(self, kind, port, *more):
        return subprocess.Popen(
            [
                BUILD / "client/bridge/kinevox-bridge",
                kind,
                "--server",
                self.address,
                "--to",
                f"127.0.0.1:{port}",
                *more,
            ],
            stdout=subprocess.PIPE,
            text=True,
        )

    def stop(self, bridge):
        bridge.send_signal(signal.SIGTERM)
        output = bridge.communicate(timeout=20)[0]
        self.assertEqual(bridge.returncode, 0, output)
        self.assertIn("datagrams sent", output)

    def test_vmc(self):
        port = free_port()
        bridge = self.bridge("vmc", port)
        poses = []
        for at_s, bones in example("receive_vmc").receive(port, seconds=60):
            poses.append((at_s, bones))
            if len(poses) == 5:
                break
        self.stop(bridge)
        self.assertEqual(len(poses), 5, "no poses within a minute")
        for at_s, bones in poses:
            self.assertEqual(len(bones), 15)
            self.assertTrue(0.5 < bones["Hips"][0][1] < 1.3, bones["Hips"])  # m above the floor
            for _, rotation in bones.values():
                self.assertAlmostEqual(sum(v * v for v in rotation), 1, places=4)
        times = [at_s for at_s, _ in poses]
        self.assertEqual(times, sorted(times))

    def test_csv(self):
        port = free_port()
        bridge = self.bridge("csv", port)
        rows = []
        for row in example("receive_csv").receive(port, seconds=60):
            rows.append(row)
            if sum(r["knee_flexion_geometric_l_deg"] is not None for r in rows) >= 5:
                break
        self.stop(bridge)
        knees = [r["knee_flexion_geometric_l_deg"] for r in rows if r["knee_flexion_geometric_l_deg"] is not None]
        self.assertGreaterEqual(len(knees), 5)
        self.assertTrue(all(-20 < k < 160 for k in knees), knees)

    def test_bad_address(self):
        ran = subprocess.run(
            [BUILD / "client/bridge/kinevox-bridge", "vmc", "--to", "nowhere"], capture_output=True, text=True
        )
        self.assertEqual(ran.returncode, 1)
        self.assertIn("is not HOST:PORT", ran.stderr)
        self.assertEqual(ran.stderr.count("\n"), 1)


if __name__ == "__main__":
    unittest.main()
