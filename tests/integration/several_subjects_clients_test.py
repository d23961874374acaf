#!/usr/bin/python3
"""The clients with two people: Python, command line and bridges. usage: several_subjects_clients_test.py BUILD_FOLDER

The daemon replays a rendered session of two people; skipped without the test data."""
import csv
import importlib.util
import io
import json
import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import unittest
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent.parent
BUILD = Path(sys.argv.pop(1) if len(sys.argv) > 1 else REPOSITORY / "build/release").resolve()
sys.path[:0] = [str(BUILD / "client/python"), str(REPOSITORY / "tests/support"), str(REPOSITORY / "tests/accuracy")]
import numpy as np  # noqa: E402
from session_data import data_folder  # noqa: E402
from studio_daemon import StudioDaemon  # noqa: E402

import kinevox  # noqa: E402

folder = daemon = None


def setUpModule():
    global folder, daemon
    session = data_folder() / "studio/pair/session.toml"
    if not session.exists():
        raise unittest.SkipTest(f"{session} is not here")
    folder = tempfile.TemporaryDirectory()
    unittest.addModuleCleanup(folder.cleanup)
    daemon = StudioDaemon(
        str(BUILD / "server/daemon/kinevoxd"), folder.name, "[tracking]\nmax_subjects = 2\n", session=session
    )
    unittest.addModuleCleanup(daemon.stop)
    with kinevox.Client(daemon.address) as client:
        next(frame for frame in client.poses() if [pose.found for pose in frame.subjects] == [True, True])


def run(program, *words, check=True):
    environment = {**os.environ, "KINEVOX_SERVER": daemon.address, "PYTHONPATH": str(BUILD / "client/python")}
    return subprocess.run(
        [str(program), *map(str, words)], capture_output=True, text=True, check=check, env=environment, timeout=60
    )


def cli(*words, check=True):
    return run(BUILD / "client/cli/kinevox", *words, check=check)


def table_of(text):
    return list(csv.DictReader(io.StringIO(text)))


class Python(unittest.TestCase):
    def setUp(self):
        self.client = kinevox.Client(daemon.address)
        self.addCleanup(self.client.close)

    def test_poses_of_each(self):
        frames = []
        for frame in self.client.poses(idle_timeout_s=30):
            frames.append(frame)
            if sum(len(frame.subjects) == 2 for frame in frames) == 10:
                break
        pair = next(
            frame for frame in frames if all(pose.found for pose in frame.subjects) and len(frame.subjects) == 2
        )
        first, second = pair.subjects
        self.assertLess(first.subject_id, second.subject_id)
        self.assertIs(pair.subject(second.subject_id), second)
        apart_m = np.linalg.norm(first.translations.m[:2] - second.translations.m[:2])
        self.assertTrue(0.3 < apart_m < 3, apart_m)
        with self.assertRaisesRegex(kinevox.FailedPrecondition, "several subjects are tracked"):
            pair.joints
        table = kinevox.PoseTable.of(frames)
        self.assertTrue(table.has_several)
        parts = table.by_subject(every_frame=True)
        self.assertEqual({len(part) for part in parts.values()}, {len(frames)})
        self.assertGreater(sum(np.isfinite(part.angles_deg).any(axis=1).sum() for part in parts.values()), 10)

    def test_volumes_of_each(self):
        frame = next(  # a subject that a frame set does not show has no volume in it
            frame
            for frame in self.client.volumes(idle_timeout_s=30)
            if sum(subject.volume is not None for subject in frame.subjects) == 2
        )
        points = [subject.volume.surface_points_m for subject in frame.subjects]
        for subject, own in zip(frame.subjects, points):
            self.assertIs(frame.subject(subject.subject_id), subject)
            self.assertTrue(40 < subject.volume_litres < 130, subject.volume_litres)
            self.assertLess(np.linalg.norm(own.mean(axis=0)[:2] - subject.centre_m[:2]), 0.3)
        self.assertIsNone(frame.subject(10_000).volume)

    def test_subjects_are_listed_named_and_selected(self):
        for _ in range(20):  # ids are new where the session begins again
            present = [subject for subject in self.client.subjects() if subject.absent_s == 0]
            try:
                self.client.name_subject(present[0].subject_id, "Ann")
                named = {subject.name: subject for subject in self.client.subjects()}["Ann"]
                break
            except (IndexError, KeyError, kinevox.NotFound):
                time.sleep(0.2)
        self.assertEqual((named.subject_id, named.following), (present[0].subject_id, "followed"))
        self.assertGreater(named.height_m, 1)
        self.assertEqual(named.centre_m.shape, (3,))
        self.client.select_subjects()
        with self.assertRaisesRegex(kinevox.NotFound, "999"):
            self.client.select_subjects(follow=[999])
        with self.assertRaises(kinevox.InvalidArgument):
            self.client.select_subjects(follow=[1], ignore=[2])

    def test_examples(self):
        out = Path(folder.name) / "poses.csv"
        run(REPOSITORY / "client/python/examples/stream_to_csv.py", "--duration", 1, "--out", out)
        rows = table_of(out.read_text())
        self.assertGreater(len({row["subject"] for row in rows if row["knee_angle_r_deg"]}), 1)


class CommandLine(unittest.TestCase):
    def test_streams(self):
        rows = table_of(cli("stream", "coordinates", "--format", "csv", "--frames", 12).stdout)
        ids = {row["subject"] for row in rows} - {""}
        self.assertGreaterEqual(len(ids), 2)
        self.assertGreater(len(rows), 12)
        for command in (["coordinates"], ["volumes", "--level", 2]):
            chosen = self.latest_ids()[-1]
            rows = table_of(cli("stream", *command, "--format", "csv", "--frames", 5, "--subject", chosen).stdout)
            self.assertEqual(len(rows), 5, command)
            self.assertLessEqual({row["subject"] for row in rows}, {str(chosen), ""}, command)
        line = cli("stream", "angles", "--frames", 1, "--subject", 10_000).stdout
        self.assertEqual(json.loads(line)["subjects"], [])
        wrong = cli("stream", "angles", "--subject", 0, check=False)
        self.assertEqual(wrong.returncode, 1)
        self.assertIn("--subject", wrong.stderr)

    def latest_ids(self):
        with kinevox.Client(daemon.address) as client:
            frame = next(frame for frame in client.poses("latest") if len(frame.subjects) == 2)
        return [pose.subject_id for pose in frame.subjects]

    def test_snapshot(self):
        out = Path(folder.name) / "both"
        for _ in range(5):  # the session may begin again, with one of them for some frames
            written = json.loads(cli("--json", "snapshot", "--out", out, "--overwrite").stdout)
            if len(written["subjects"]) == 2:
                break
        plys = [Path(subject["ply"]) for subject in written["subjects"]]
        self.assertEqual(plys, [out / "volume.ply", out / f"volume_s{written['subjects'][1]['subject_id']}.ply"])
        self.assertEqual(written["ply"], str(plys[0]))
        self.assertTrue(all(ply.stat().st_size > 10_000 for ply in plys))
        self.assertGreater((out / "snapshot.png").stat().st_size, 10_000)
        none = cli("snapshot", "--out", Path(folder.name) / "none", "--subject", 10_000, "--wait", 0.5, check=False)
        self.assertEqual(none.returncode, 1)
        self.assertEqual(none.stderr, "kinevox: no subject 10000 within 0.5 s; see `kinevox status`, or raise --wait\n")
        self.assertFalse((Path(folder.name) / "none").exists())

    def test_watch(self):
        lines = cli("watch", "--count", 3, "--interval", 0.2).stdout
        self.assertRegex(lines, r"subject \d+: \d+ voxels .* subject \d+: \d+ voxels")


class Bridges(unittest.TestCase):
    def example(self, name):
        spec = importlib.util.spec_from_file_location(name, REPOSITORY / f"client/bridge/examples/{name}.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        return module

    def ports(self):
        """Two free ports that follow each other."""
        while True:
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as a, socket.socket(
                socket.AF_INET, socket.SOCK_DGRAM
            ) as b:
                a.bind(("127.0.0.1", 0))
                port = a.getsockname()[1]
                try:
                    b.bind(("127.0.0.1", port + 1))
                    return port
                except (OSError, OverflowError):
                    continue

    def start(self, kind, port, *more):
        words = [kind, "--server", daemon.address, "--to", f"127.0.0.1:{port}", *map(str, more)]
        bridge = subprocess.Popen([BUILD / "client/bridge/kinevox-bridge", *words], stdout=subprocess.PIPE, text=True)
        self.addCleanup(self.stop, bridge)

    def stop(self, bridge):
        bridge.send_signal(signal.SIGTERM)
        output = bridge.communicate(timeout=20)[0]
        self.assertEqual(bridge.returncode, 0, output)

    def test_csv_has_a_line_per_subject(self):
        port = self.ports()
        self.start("csv", port)
        frames = {}
        for row in self.example("receive_csv").receive(port, seconds=30):
            frames.setdefault(row["frame"], []).append(row["subject"])
            if sum(len(subjects) == 2 for subjects in frames.values()) >= 3:
                break
        self.assertIn(2, [len(set(subjects)) for subjects in frames.values()])

    def test_vmc_has_a_port_per_subject(self):
        port = self.ports()
        self.start("vmc", port, "--max-subjects", 2)
        hips = {}

        def receive(offset):
            at = []
            for _, bones in self.example("receive_vmc").receive(port + offset, seconds=30):
                at.append(bones["Hips"][0])
                if len(at) == 10:
                    break
            hips[offset] = np.median(at, axis=0)

        threads = [threading.Thread(target=receive, args=(offset,)) for offset in (0, 1)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        apart_m = np.linalg.norm(hips[0] - hips[1])
        self.assertTrue(0.3 < apart_m < 3, hips)


if __name__ == "__main__":
    unittest.main()
