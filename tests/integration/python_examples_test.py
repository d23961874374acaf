#!/usr/bin/python3
"""The Python package's examples. usage: python_examples_test.py BUILD_FOLDER

The sprint start is compared with the ground truth of the studio's sprint; skipped without the test data."""
import csv
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent.parent
BUILD = Path(sys.argv.pop(1) if len(sys.argv) > 1 else REPOSITORY / "build/release").resolve()
EXAMPLES = REPOSITORY / "client/python/examples"
sys.path[:0] = [
    str(BUILD / "client/python"),
    str(REPOSITORY / "tests/support"),
    str(EXAMPLES),
    str(REPOSITORY / "tests/accuracy"),
]
import numpy as np  # noqa: E402
import sprint_start  # noqa: E402
from matplotlib import image  # noqa: E402
from session_data import data_folder  # noqa: E402
from studio_daemon import StudioDaemon  # noqa: E402

import kinevox  # noqa: E402

DAEMON = str(BUILD / "server/daemon/kinevoxd")
PROCESS = str(BUILD / "server/tools/kinevox-process")


def example(name, *words, check=True):
    environment = {**os.environ, "PYTHONPATH": str(BUILD / "client/python"), "PYTHONDONTWRITEBYTECODE": "1"}
    return subprocess.run(
        ["/usr/bin/python3", str(EXAMPLES / name), *map(str, words)],
        capture_output=True,
        text=True,
        check=check,
        env=environment,
    )


def colours(file):
    """Number of pixels of an image that are neither grey nor white."""
    pixels = image.imread(file)[..., :3]
    return int((np.ptp(pixels, axis=2) > 0.3).sum())


def renamed_truth(truth, folder):
    """A copy of the joints and angles with today's column names: the rendered test data keep the former ones."""
    shutil.copy(truth / "joints.csv", folder)
    with open(truth / "angles.csv", newline="") as lines:
        header, *rows = csv.reader(lines)
    names = [
        re.sub(r"(_[lr])?_deg$", r"_geometric\1_deg", name) if "geometric" not in name else name for name in header
    ]
    with open(folder / "angles.csv", "w", newline="") as out:
        csv.writer(out).writerows([names, *rows])
    return folder


class Live(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        cls.daemon = StudioDaemon(DAEMON, cls.folder.name)
        with kinevox.Client(cls.daemon.address) as client:
            next(pose for pose in client.poses(idle_timeout_s=30) if pose.found)

    @classmethod
    def tearDownClass(cls):
        cls.daemon.stop()
        cls.folder.cleanup()

    def test_stream_to_csv(self):
        out = Path(self.folder.name) / "poses.csv"
        example("stream_to_csv.py", "--server", self.daemon.address, "--duration", 1.5, "--out", out)
        with open(out, newline="") as lines:
            rows = list(csv.DictReader(lines))
        self.assertGreater(len(rows), 3)
        self.assertTrue(any(row["knee_angle_r_deg"] for row in rows))
        self.assertTrue(all(-0.3 < float(row["toe_l_z_m"]) < 1 for row in rows if row["toe_l_z_m"]))
        self.assertTrue((np.diff([float(row["time_s"]) for row in rows]) > 0).all())

    def test_live_plot(self):
        out = Path(self.folder.name) / "live.png"
        example("live_plot.py", "--server", self.daemon.address, "--duration", 1.5, "--screenshot", out)
        self.assertEqual(image.imread(out).shape[:2], (400, 800))
        self.assertGreater(colours(out), 400)

    def test_no_daemon(self):
        run = example("stream_to_csv.py", "--server", "127.0.0.1:1", "--out", "/dev/null", check=False)
        self.assertEqual(run.returncode, 1)
        self.assertRegex(run.stderr, "^stream_to_csv: cannot connect to a daemon at 127.0.0.1:1 .*\n$")


class SprintStart(unittest.TestCase):
    def setUp(self):
        self.session = data_folder() / "studio/sprint/session.toml"
        if not self.session.exists():
            self.skipTest(f"{self.session} is not here")
        with tempfile.TemporaryDirectory() as folder:
            self.truth = kinevox.PoseTable.read(renamed_truth(self.session.parent / "truth", Path(folder)))

    def test_on_the_truth(self):
        start = sprint_start.analyse(self.truth)
        self.assertEqual([step.side for step in start.steps], ["right", "left"] * 3 + ["right"])
        np.testing.assert_allclose(start.direction, (1, 0), atol=0.02)  # the run is along +x
        # By hand from the table: the tips rise over 0.1 m between frames 17 and 18; the first foot stands from frame 28 on.
        self.assertTrue(17 / 30 < start.go_s < 18 / 30)
        self.assertTrue(28 / 30 < start.steps[0].touch_down_s < 29 / 30)
        toe = self.truth.joint("toe_r")[32, 0] - self.truth.joint("toe_l")[10, 0]
        self.assertAlmostEqual(start.steps[0].length_m, toe, delta=0.03)

    def test_missing_poses_are_reported(self):
        self.truth.joints_m[52:56] = np.nan  # around the third step's touch-down
        start = sprint_start.analyse(self.truth)
        self.assertEqual([step.complete for step in start.steps[:5]], [True, True, True, False, True])
        lines = sprint_start.report(self.truth, start).splitlines()
        self.assertEqual([line.split()[0] for line in lines if line.endswith("poses missing before it")], ["4"])

    def test_on_what_the_daemon_measures(self):
        with tempfile.TemporaryDirectory() as folder:
            # The runner is 6 % taller than the mean adult; the four seconds are over before the daemon has fitted the body.
            processed = Path(folder) / "processed"
            command = [PROCESS, self.session, "--out", processed, "--quiet", "--no-colouring", "--single-run"]
            subprocess.run(command, check=True)
            daemon = StudioDaemon(
                DAEMON,
                folder,
                autostart=False,
                more=f'[replay]\nfolders = ["{self.session.parent}"]\n',
                pose=f'body_file = "{processed / "body.toml"}"\n',
            )
            try:
                out = Path(folder) / "start"
                output = example("sprint_start.py", self.session, "--server", daemon.address, "--out", out).stdout
                with kinevox.Client(daemon.address) as client:
                    self.assertEqual(client.replay.status().state, "live")
                    self.assertEqual(client.status().operator_name, "")
            finally:
                daemon.stop()
            with open(f"{out}.csv", newline="") as lines:
                frames = [int(row["frame"]) for row in csv.DictReader(lines)]
            self.assertEqual(frames, list(range(len(self.truth))))
            self.assertGreater(colours(f"{out}.png"), 3000)
        rows = [line.split() for line in output.splitlines()]
        measured = [
            (row[1], *map(float, row[2:5]))
            for row in rows
            if len(row) > 4 and row[0].isdigit() and row[1] in ("left", "right")
        ]
        true = sprint_start.analyse(self.truth).steps
        self.assertGreaterEqual(len(measured), 6)
        for (side, down_s, length_m, _), step in zip(measured, true):
            self.assertEqual(side, step.side)
            self.assertAlmostEqual(down_s, step.touch_down_s, delta=0.08)  # two frames at 30 fps, and rounding
            self.assertAlmostEqual(length_m, step.length_m, delta=0.12)
        self.assertRegex(output, "hand leaves the ground at 0.5")


if __name__ == "__main__":
    unittest.main(verbosity=2)
