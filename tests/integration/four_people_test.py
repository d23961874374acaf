#!/usr/bin/python3
"""Four people, who enter one after another and get names, through a real daemon and its clients: streams, recording, exports,
`kinevox process`, report, replay. The small scene is rendered. usage: four_people_test.py BUILD_FOLDER"""
import csv
import json
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
import unittest
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
BUILD = Path(sys.argv.pop(1) if len(sys.argv) > 1 else REPOSITORY / "build/release").resolve()
sys.path[:0] = [str(BUILD / "client/python"), str(REPOSITORY / "tests/support")]
import cv2  # noqa: E402
import numpy as np  # noqa: E402
from studio_daemon import StudioDaemon  # noqa: E402

import kinevox  # noqa: E402

SCENE = REPOSITORY / "tests/support/four_people.toml"


def positions():
    """[x, y] in metres of each person of the scene."""
    scene = tomllib.loads(SCENE.read_text())
    return [motion["shift_m"] for motion in (scene["motion"], *(person["motion"] for person in scene["person"]))]


STANDS_AT = dict(zip(("Anna B.", "", "Jörg/№ 3", "Cleo"), positions()))
WAIT_S = 120


def name_at(x, y):
    """of the person who stands nearest."""
    return min(STANDS_AT, key=lambda name: np.hypot(x - STANDS_AT[name][0], y - STANDS_AT[name][1]))


def roots_of(frames):
    """{id: the latest root that was measured}: it may be withheld in some frame sets."""
    roots = {}
    for frame in frames:
        for pose in frame.subjects:
            if pose.found and np.isfinite(pose.joints["root"]).all():
                roots[pose.subject_id] = pose.joints["root"]
    return roots


def table_of(file):
    with open(file, newline="", encoding="utf-8") as lines:
        return list(csv.DictReader(lines))


class Group:
    """A daemon that has captured the scene once, with everything that it sent."""

    def __init__(self, folder):
        self.folder = folder
        subprocess.run(
            [BUILD / "server/tools/kinevox-studio", "--scene", SCENE, "--out", folder / "session", "--no-masks"],
            check=True,
            capture_output=True,
        )
        self.daemon = StudioDaemon(
            BUILD / "server/daemon/kinevoxd",
            folder,
            "[tracking]\nmax_subjects = 4\n",
            session=folder / "session/session.toml",
            loop=False,
            autostart=False,
        )
        self.client = kinevox.Client(self.daemon.address)
        self.poses, self.volumes, self.silhouettes = [], [], []
        self.capture()

    def read(self, stream, into):
        def loop():
            try:
                for message in stream:
                    into.append(message)
            except kinevox.KinevoxError:
                pass  # the client is closed

        thread = threading.Thread(target=loop, daemon=True)
        thread.start()
        return thread

    def capture(self):
        with kinevox.Client(self.daemon.address) as watcher:
            silhouettes = watcher.previews(watcher.cameras()[0].name, silhouette=True, max_rate_hz=100)
            streams = [watcher.poses("lossless"), watcher.volumes("lossless"), silhouettes]
            threads = [self.read(s, into) for s, into in zip(streams, (self.poses, self.volumes, self.silhouettes))]
            while self.daemon_subscribers() < 3:
                time.sleep(0.02)
            self.client.recordings.start("group")
            self.client.start()
            self.name_everybody()
            self.wait_for_end()
            self.listed = self.client.subjects()
            self.status = self.client.status()
        for thread in threads:
            thread.join(10)

    def wait_for_end(self):
        """Under load the source may lose some frame sets: all results have come if there are no more for a second."""
        counts, end = [], time.monotonic() + WAIT_S
        while time.monotonic() < end:
            self.recorder = self.client.recordings.status()
            counts.append((len(self.poses), len(self.volumes)))
            if (
                self.recorder.state == "idle"
                and self.recorder.latest
                and len(set(counts[-11:])) == 1 < len(counts[10:])
            ):
                return
            time.sleep(0.1)

    def daemon_subscribers(self):
        done = self.kinevox("--json", "status")
        return sum(json.loads(done.stdout)[f"{kind}_subscriber_count"] > 0 for kind in ("pose", "volume", "preview"))

    def name_everybody(self):
        """Anna is named twice, with another name at first."""
        named, end = {}, time.monotonic() + WAIT_S
        while len(named) < 4 and time.monotonic() < end:
            for subject in self.client.subjects():
                name = name_at(*subject.centre_m[:2])
                if subject.absent_s == 0 and subject.subject_id not in named:
                    self.client.name_subject(subject.subject_id, "Newcomer" if name == "Anna B." else name)
                    named[subject.subject_id] = name
            time.sleep(0.05)
        for subject, name in named.items():
            if name == "Anna B.":
                done = self.kinevox("subjects", "name", subject, name)
                assert done.returncode == 0, done.stderr
        self.ids = {name: subject for subject, name in named.items()}

    def kinevox(self, *words):
        command = [BUILD / "client/cli/kinevox", *map(str, words), "--server", self.daemon.address]
        return subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S)

    def stop(self):
        self.client.close()
        if self.daemon.stop() != 0:
            raise RuntimeError("the daemon failed")


group = None


def setUpModule():
    global group
    folder = tempfile.TemporaryDirectory(prefix="kinevox-four-")
    unittest.addModuleCleanup(folder.cleanup)
    group = Group(Path(folder.name))
    unittest.addModuleCleanup(group.stop)


class Streams(unittest.TestCase):
    def test_everybody_is_streamed(self):
        posed = [[pose.subject_id for pose in frame.subjects] for frame in group.poses]
        self.assertEqual(posed, [[subject.subject_id for subject in frame.subjects] for frame in group.volumes])
        self.assertEqual({len(ids) for ids in posed} & {0, 1, 2, 4}, {0, 1, 2, 4}, posed)
        self.assertEqual(posed[-1], [1, 2, 3, 4])
        roots = roots_of(group.poses)
        self.assertEqual(sorted(roots), [1, 2, 3, 4])
        for shown in group.volumes[-1].subjects:
            self.assertTrue(30 < shown.volume_litres < 160, shown.volume_litres)
            self.assertLess(np.linalg.norm(roots[shown.subject_id][:2] - shown.centre_m[:2]), 0.4)

    def test_names_go_with_poses_and_volumes(self):
        self.assertEqual(sorted(group.ids), sorted(STANDS_AT))
        for pose, shown in zip(group.poses[-1].subjects, group.volumes[-1].subjects):
            self.assertEqual(pose.name, shown.name)
            self.assertEqual(group.ids[pose.name], pose.subject_id)
            self.assertEqual(pose.name, name_at(*shown.centre_m[:2]), "never another person's")
        anna = [frame.subject(group.ids["Anna B."]).name for frame in group.poses]
        changes = [name for n, name in enumerate(anna) if n == 0 or name != anna[n - 1]]
        self.assertEqual(changes[-2:], ["Newcomer", "Anna B."])
        self.assertEqual({s.subject_id: s.name for s in group.listed}, {i: name for name, i in group.ids.items()})
        self.assertEqual([s.name for s in group.status.subjects], [s.name for s in group.poses[-1].subjects])

    def test_silhouettes_show_everybody(self):
        def area(silhouette):
            image = cv2.imdecode(np.frombuffer(silhouette.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
            return np.count_nonzero(image > 200)

        areas = {silhouette.header.sequence: area(silhouette) for silhouette in group.silhouettes}
        four = [n for n, frame in enumerate(group.poses) if len(frame.subjects) == 4]
        one = [n for n, frame in enumerate(group.poses) if len(frame.subjects) == 1]
        areas_of = lambda frames: [areas[group.poses[n].sequence] for n in frames if group.poses[n].sequence in areas]
        self.assertGreater(np.median(areas_of(four)), 2 * np.median(areas_of(one)))

    def test_tables_of_the_stream_have_the_names(self):
        table = kinevox.PoseTable.of(group.poses)
        self.assertEqual(table.names, {i: name for name, i in group.ids.items() if name})
        self.assertTrue(table.has_several)


class Recording(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.recording = group.folder / "recordings/group"
        cls.results = group.folder / "results"
        cls.processed = subprocess.run(
            [BUILD / "server/tools/kinevox-process", cls.recording / "session.toml", "--out", cls.results]
            + ["--max-subjects", "4", "--single-run", "--every", "2", "--quiet"],
            capture_output=True,
            text=True,
        )

    def names_by_position(self, tables):
        """{name: its subject is where that person stands}, from joints.csv and subjects.csv."""
        table = kinevox.PoseTable.read(tables)
        at = {i: np.nanmedian(table.of_subject(i).joint("root"), axis=0) for i in table.names}
        return {name: name_at(*at[subject][:2]) == name for subject, name in table.names.items()}

    def test_it_has_the_names(self):
        self.assertEqual(group.recorder.latest.frame_set_count, len(group.poses))
        table = kinevox.PoseTable.read(self.recording / "poses")
        self.assertEqual(table.names, {i: name for name, i in group.ids.items() if name})
        self.assertEqual(self.names_by_position(self.recording / "poses"), {n: True for n in STANDS_AT if n})

    def test_processing_it_keeps_the_names(self):
        self.assertEqual((self.processed.returncode, self.processed.stderr), (0, ""))
        names = self.names_by_position(self.results)
        self.assertEqual(names, {name: True for name in STANDS_AT if name})
        quality = json.loads((self.results / "quality.json").read_text())["measurements"]
        self.assertEqual(quality["followed_subjects"], 4)
        own = kinevox.PoseTable.read(self.results).names.get(quality["subject"])
        self.assertEqual(quality.get("subject_name"), own)

    def test_exports_have_everybody(self):
        for form in ("c3d", "csv"):  # the others: people_files_test
            out = group.folder / f"each_{form}"
            done = self.export(self.recording, "--format", form, "--out", out, "--each-subject")
            self.assertEqual((done.returncode, done.stderr), (0, ""), form)
            expected = [
                f"s{i}" + {"": "", "Jörg/№ 3": "_Jörg_№_3", "Anna B.": "_Anna_B_"}.get(name, f"_{name}")
                for name, i in group.ids.items()
            ]
            self.assertEqual(sorted(file.name for file in out.iterdir()), sorted(f"{name}.{form}" for name in expected))
        volumes, video = group.folder / "volumes", group.folder / "all.mp4"
        group.client.export("group", "ply", volumes)
        self.assertEqual(len(list(volumes.glob(f"{len(group.poses) - 1:06}*.ply"))), 4)
        self.assertEqual(len(table_of(volumes / "subjects.csv")), 3)
        group.client.export("group", "mp4", video, width_px=640)
        images = cv2.VideoCapture(str(video))
        self.assertGreaterEqual(int(images.get(cv2.CAP_PROP_FRAME_COUNT)), len(group.poses))  # lost ones, too

    def test_the_anonymous_session_has_no_names(self):
        out = group.folder / "anonymous"
        done = self.export(self.recording, "--anonymous", "--out", out)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertEqual(kinevox.PoseTable.read(out).subject_ids, [1, 2, 3, 4])
        for file in out.iterdir():
            for name in ("Anna", "Jörg", "Cleo"):
                self.assertNotIn(name.encode(), file.read_bytes(), file.name)

    def export(self, *words):
        command = [BUILD / "server/tools/kinevox-export", *map(str, words), "--quiet"]
        return subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S)

    def test_report_of_each(self):
        subject = group.ids["Jörg/№ 3"]
        out = group.folder / "page.png"
        done = subprocess.run(
            [BUILD / "client/cli/kinevox", "report", self.recording, "--subject", str(subject), "--out", out],
            capture_output=True,
            text=True,
        )
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertGreater(out.stat().st_size, 50_000)


class Replay(unittest.TestCase):
    def test_replayed_people_have_the_recorded_names(self):
        with kinevox.Client(group.daemon.address) as client:
            frames = list(client.measure_session("group"))
            roots = roots_of(frames)
            self.assertEqual(sorted(pose.name for pose in frames[-1].subjects), sorted(STANDS_AT))
            self.assertGreaterEqual(len(roots), 4)
            for pose in frames[-1].subjects:
                self.assertEqual(pose.name, name_at(*roots[pose.subject_id][:2]))


if __name__ == "__main__":
    unittest.main()
