#!/usr/bin/python3
"""Two people, one of them alone and an empty room through a real daemon. usage: several_subjects_test.py BUILD_FOLDER

The first frame sets of the shared sequence pair, after an empty room and with person b painted out for a while. Streams,
status, events, metrics and bodies over gRPC; the recording, its exports, and `kinevox process` on it. Skips (77) without
the test data."""
import csv
import json
import re
import struct
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import urllib.request
import zipfile
from pathlib import Path

import cv2
import grpc
import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent.parent
BUILD = Path(sys.argv.pop(1) if len(sys.argv) > 1 else REPOSITORY / "build/release").resolve()
sys.path[:0] = [str(BUILD / "client/python"), str(REPOSITORY / "tests/accuracy"), str(REPOSITORY / "tests/integration")]
from session_data import data_folder  # noqa: E402

from kinevox.v1 import capture_service_pb2 as capture  # noqa: E402
from kinevox.v1 import pose_service_pb2 as pose  # noqa: E402
from kinevox.v1 import stream_service_pb2 as stream  # noqa: E402

PAIR = data_folder() / "studio/pair"
EMPTY, ALONE, BOTH = 3, 4, 24  # frame sets, in this order
FRAMES = EMPTY + ALONE + BOTH
CAMERAS = ["cam1", "cam2", "cam3", "cam4"]
TABLES = ("joints.csv", "angles.csv", "coordinates.csv", "uncertainty.csv")


def images_of(file, count):
    video = cv2.VideoCapture(str(file))
    return [video.read()[1] for _ in range(count)]


def write_session(folder):
    """Lossless images: what is painted out is the empty room."""
    lines = [f'name = "group"\nfps = 28.0\ncalibration = "{PAIR}/calibration.toml"\n']
    for camera in CAMERAS:
        empty, images = images_of(PAIR / f"background/{camera}.mp4", 60), images_of(
            PAIR / f"{camera}.mp4", ALONE + BOTH
        )
        with zipfile.ZipFile(PAIR / f"truth/masks_b_{camera}.zip") as masks:
            for n in range(ALONE):
                mask = cv2.imdecode(np.frombuffer(masks.read(f"frame_{n:04}.png"), np.uint8), cv2.IMREAD_GRAYSCALE)
                mask = cv2.dilate(mask, np.ones((7, 7), np.uint8))
                images[n] = np.where(mask[..., None] > 0, empty[10 + n], images[n])
        (folder / camera).mkdir(parents=True)
        for n, image in enumerate(empty[:EMPTY] + images):
            cv2.imwrite(str(folder / camera / f"{n:04}.png"), image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        lines.append(
            f'[[camera]]\nname = "{camera}"\nvideo = "{camera}"\nbackground = "{PAIR}/background/{camera}.mp4"\n'
        )
    (folder / "session.toml").write_text("\n".join(lines))
    return folder / "session.toml"


def table_of(file):
    with open(file, newline="") as lines:
        return list(csv.DictReader(lines))


def points_of(ply):
    """Without colours, which a recording rounds."""
    head, _, body = ply.read_bytes().partition(b"end_header\n")
    count = int(next(line for line in head.splitlines() if line.startswith(b"element vertex")).split()[-1])
    return np.frombuffer(body, dtype=np.dtype([("p", "<f4", 3), ("c", "u1", 3)]), count=count)["p"]


def subjects_of_volumes(file):
    """By frame the subjects of a volumes.kvxv with subjects."""
    data, at, frames = file.read_bytes(), 8, {}
    while at < len(data):
        frame, subject, size = struct.unpack_from("<QII", data, at)
        frames.setdefault(frame, []).append(subject)
        at += 16 + size
    return frames


def subjects_by_frame(rows):
    frames = {}
    for row in rows:
        frames.setdefault(int(row["frame"]), []).extend([int(row["subject"])] if row["subject"] else [])
    return [frames[n] for n in sorted(frames)]


class Group:
    """A daemon that has captured the session once, with everything that it sent."""

    def __init__(self, folder):
        self.folder = folder
        self.session = write_session(folder / "session")
        config = folder / "kinevoxd.toml"
        config.write_text(
            f'[server]\nlisten = "127.0.0.1:0"\n[source]\nkind = "session"\nsession_file = "{self.session}"\n'
            'pacing = "as_fast_as_possible"\nloop = false\nautostart = false\n[tracking]\nmax_subjects = 2\n'
            f'[pose]\ndatabase_file = ""\nfitted_body_file = "{folder}/body.toml"\n[calibration]\nfolder = ""\n'
            f'[recording]\nfolder = "{folder}/recordings"\nmin_free_disk_mb = 0\nmax_queue_mb = 2000\n'
            '[metrics]\nlisten = "127.0.0.1:0"\n[log]\nlevel = "info"\n'
        )
        self.log = open(folder / "log", "w+")
        self.process = subprocess.Popen(
            [BUILD / "server/daemon/kinevoxd", "--config", config], stdout=subprocess.PIPE, stderr=self.log, text=True
        )
        self.address = self.process.stdout.readline().split()[-1]
        self.channel = grpc.insecure_channel(self.address)
        self.poses, self.volumes, self.previews, self.events, self.body_states = [], [], [], [], []
        self.status_before = self.get_status()
        watch = self.open("PoseService/WatchBody", pose.WatchBodyRequest(), pose.WatchBodyResponse)
        self.bodies_before = next(watch)
        watch.cancel()
        self.run()

    def get_status(self):
        method = "/kinevox.v1.CaptureService/GetStatus"
        message = capture.GetStatusRequest().SerializeToString()
        return capture.GetStatusResponse.FromString(self.channel.unary_unary(method)(message, timeout=10))

    def open(self, method, request, response):
        return self.channel.unary_stream(f"/kinevox.v1.{method}", response_deserializer=response.FromString)(
            request.SerializeToString()
        )

    def read(self, into, *method):
        call = self.open(*method)

        def loop():
            try:
                for message in call:
                    into.append(message)
            except grpc.RpcError as error:
                if error.code() != grpc.StatusCode.CANCELLED:
                    raise

        thread = threading.Thread(target=loop, daemon=True)
        thread.start()
        return call, thread

    def run(self):
        lossless = stream.DELIVERY_LOSSLESS
        previews = stream.StreamPreviewsRequest(
            camera="cam1", kind=stream.StreamPreviewsRequest.KIND_SILHOUETTE, max_rate_hz=1000
        )
        calls = [
            self.read(
                self.poses,
                "StreamService/StreamPoses",
                stream.StreamPosesRequest(delivery=lossless),
                stream.StreamPosesResponse,
            ),
            self.read(
                self.volumes,
                "StreamService/StreamVolumes",
                stream.StreamVolumesRequest(delivery=lossless),
                stream.StreamVolumesResponse,
            ),
            self.read(self.previews, "StreamService/StreamPreviews", previews, stream.StreamPreviewsResponse),
            self.read(
                self.events, "CaptureService/WatchEvents", capture.WatchEventsRequest(), capture.WatchEventsResponse
            ),
            self.read(self.body_states, "PoseService/WatchBody", pose.WatchBodyRequest(), pose.WatchBodyResponse),
        ]
        while not all(
            getattr(self.get_status(), f"{kind}_subscriber_count") for kind in ("pose", "volume", "preview", "event")
        ):
            time.sleep(0.02)
        self.client("record", "start", "group")
        self.client("start")
        end = time.monotonic() + 120
        while time.monotonic() < end:
            self.recorder = json.loads(self.client("record", "status", "--json").stdout)
            if self.recorder["state"] == "idle" and len(self.poses) == len(self.volumes) == FRAMES:
                break
            time.sleep(0.1)
        self.status = self.get_status()
        self.metrics = self.read_metrics()
        for call, thread in calls:
            call.cancel()
            thread.join(10)

    def read_metrics(self):
        port = re.search(r"metrics on port (\d+)", (self.folder / "log").read_text()).group(1)
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10) as answer:
            lines = answer.read().decode().splitlines()
        return {name: float(value) for name, _, value in (line.rpartition(" ") for line in lines if line[:1] != "#")}

    def client(self, *words, check=True):
        done = subprocess.run(
            [BUILD / "client/cli/kinevox", *words, "--server", self.address, "--timeout", "60"],
            capture_output=True,
            text=True,
        )
        if check and done.returncode != 0:
            raise RuntimeError(f"kinevox {' '.join(words)}: {done.stderr}")
        return done

    def stop(self):
        self.process.terminate()
        status = self.process.wait(10)
        self.process.stdout.close()
        self.channel.close()
        self.log.close()
        if status != 0:
            raise RuntimeError(f"the daemon ended with {status}")


group = None


def setUpModule():
    global group
    folder = tempfile.TemporaryDirectory()
    unittest.addModuleCleanup(folder.cleanup)
    group = Group(Path(folder.name))
    unittest.addModuleCleanup(group.stop)


class Streams(unittest.TestCase):
    def test_one_message_per_result_with_every_subject(self):
        posed = [[subject.subject_id for subject in message.subjects] for message in group.poses]
        shown = [[subject.subject.subject_id for subject in message.subjects] for message in group.volumes]
        self.assertEqual(len(posed), FRAMES)
        self.assertEqual(posed, shown)
        self.assertEqual(posed[:EMPTY], [[]] * EMPTY)
        self.assertIn([1], posed[EMPTY : EMPTY + ALONE])
        self.assertEqual(posed[-10:], [[1, 2]] * 10)
        self.assertTrue(all(ids == sorted(set(ids)) for ids in posed))
        self.assertEqual({message.header.missed_count for message in group.poses + group.volumes}, {0})

    def test_each_subject_has_a_pose_and_a_volume_of_its_own(self):
        last, volume = group.poses[-1], group.volumes[-1]
        roots = []
        for subject, shown in zip(last.subjects, volume.subjects):
            self.assertTrue(shown.encoded_volume)
            self.assertTrue(40 < shown.volume_litres < 160, shown.volume_litres)
            root = next(joint for joint in subject.pose.joints if joint.name == "root").position_in_world
            centre = shown.subject.centre_in_world
            self.assertLess(np.hypot(root.x - centre.x, root.y - centre.y), 0.3)
            roots.append((root.x, root.y))
        self.assertTrue(0.5 < np.hypot(*np.subtract(*roots)) < 2.5, roots)

    def test_previews_show_all_silhouettes(self):
        def foreground(message):
            image = cv2.imdecode(np.frombuffer(message.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
            return np.count_nonzero(image > 200)

        areas = {message.header.sequence: foreground(message) for message in group.previews}
        parts = (0, EMPTY), (EMPTY + 1, EMPTY + ALONE), (EMPTY + ALONE + 1, FRAMES)
        empty, alone, both = ([areas[n] for n in range(*part) if n in areas] for part in parts)
        self.assertLess(max(empty, default=0), 50)
        self.assertGreater(min(alone, default=1000), 300)
        self.assertGreater(min(both), 1.3 * max(alone, default=300))


class State(unittest.TestCase):
    def test_status_before_and_after(self):
        self.assertEqual(len(group.status_before.subjects), 0)
        self.assertTrue(all(len(camera.subjects) == 0 for camera in group.status_before.cameras))
        status = group.status
        self.assertEqual([subject.subject.subject_id for subject in status.subjects], [1, 2])
        for subject in status.subjects:
            self.assertTrue(subject.pose_found)
            self.assertGreater(subject.volume.volume_litres, 40)
        for camera in status.cameras:
            self.assertEqual([subject.subject_id for subject in camera.subjects], [1, 2])
        text = group.client("status").stdout
        for line in ("subject  ", "1  ", "2  "):
            self.assertTrue(any(row.strip().startswith(line) for row in text.splitlines()), text)

    def test_events_name_their_subject(self):
        found = [e.event for e in group.events if e.event.kind == capture.EVENT_KIND_SUBJECT_FOUND]
        self.assertEqual([event.subject_id for event in found], [1, 2])
        self.assertEqual([event.message.split(" found")[0] for event in found], ["subject 1", "subject 2"])
        self.assertTrue(EMPTY <= found[0].sequence < EMPTY + ALONE <= found[1].sequence)

    def test_metrics_count_every_subject(self):
        self.assertEqual(group.metrics["kinevox_subjects_tracked"], 2)
        self.assertEqual(group.metrics["kinevox_subjects_with_pose"], 2)
        volumes = {name: value for name, value in group.metrics.items() if "subject=" in name}
        self.assertEqual(len(volumes), 2, volumes)
        for n, camera in enumerate(CAMERAS):
            ious = [s.silhouette_iou for s in group.status.cameras[n].subjects if s.HasField("silhouette_iou")]
            value = group.metrics[f'kinevox_camera_silhouette_iou{{camera="{camera}"}}']
            self.assertAlmostEqual(value, min(ious), 4)


class Bodies(unittest.TestCase):
    def test_each_subject_has_one(self):
        before = group.bodies_before.subjects
        self.assertEqual([(body.subject_id, body.state) for body in before], [(0, pose.BODY_FIT_STATE_NOT_STARTED)])
        ids = [[body.subject_id for body in state.subjects] for state in group.body_states]
        self.assertEqual(sorted(ids, key=len), ids)
        self.assertEqual([ids[0], ids[-1]], [[0], [1, 2]])
        for body in group.body_states[-1].subjects:
            self.assertNotEqual(body.state, pose.BODY_FIT_STATE_NOT_STARTED)
        shown = group.client("body", "show").stdout
        self.assertIn("subject 1:", shown)
        self.assertIn("subject 2:", shown)


class Recording(unittest.TestCase):
    def setUp(self):
        self.recording = group.folder / "recordings/group"

    def test_it_holds_what_was_streamed(self):
        latest = group.recorder["latest"]
        self.assertEqual((latest["frame_set_count"], latest["dropped_frame_set_count"]), (FRAMES, 0))
        streamed = [[subject.subject_id for subject in message.subjects] for message in group.poses]
        for name in TABLES:
            self.assertEqual(subjects_by_frame(table_of(self.recording / "poses" / name)), streamed, name)
        rows = {(int(r["frame"]), r["subject"]): r for r in table_of(self.recording / "poses/joints.csv")}
        for n, message in enumerate(group.poses):
            for subject in message.subjects:
                row = rows[n, str(subject.subject_id)]
                for joint in subject.pose.joints:
                    if not joint.withheld_reason:
                        self.assertAlmostEqual(float(row[f"{joint.name}_z"]), joint.position_in_world.z, 4)
        self.assertTrue((self.recording / "poses/body_1.toml").exists())
        self.assertTrue((self.recording / "poses/body_2.toml").exists())

    def process(self, session, out, *options):
        done = subprocess.run(
            [BUILD / "server/tools/kinevox-process", session, "--out", out, "--quiet", "--max-subjects", "2", *options],
            capture_output=True,
            text=True,
        )
        self.assertEqual((done.returncode, done.stderr), (0, ""))

    def test_processing_it_again_gives_the_same_subjects_and_volumes(self):
        results, plys = group.folder / "results", group.folder / "plys"
        self.process(self.recording / "session.toml", results, "--save", "volumes", "--no-pose")
        group.client("record", "export", "group", "--format", "ply", "--out", str(plys))
        streamed = [[subject.subject_id for subject in message.subjects] for message in group.poses]
        self.assertEqual(subjects_by_frame(table_of(results / "track.csv")), streamed)
        ours, theirs = ({file.name: points_of(file) for file in f.glob("*.ply")} for f in (plys, results / "volumes"))
        self.assertEqual(sorted(ours), sorted(theirs))
        self.assertEqual([name for name in ours if not np.array_equal(ours[name], theirs[name])], [])
        self.assertIn(f"{FRAMES - 1:06}_s2.ply", ours)

    def test_an_anonymous_export_shows_every_subject(self):
        out = group.folder / "anonymous"
        subprocess.run(
            [BUILD / "server/tools/kinevox-export", self.recording, "--anonymous", "--out", out, "--quiet"], check=True
        )
        self.assertEqual(subjects_of_volumes(out / "volumes.kvxv")[FRAMES - 1], [1, 2])
        self.assertTrue((out / "body_1.toml").exists() and (out / "body_2.toml").exists())
        for n, camera in enumerate(CAMERAS):
            shown = images_of(out / f"cam_{n + 1:02}.mkv", FRAMES)
            self.assertEqual(np.count_nonzero(shown[0]), 0)
            with zipfile.ZipFile(PAIR / f"truth/masks_{camera}.zip") as masks:
                data = np.frombuffer(masks.read(f"frame_{ALONE + BOTH - 1:04}.png"), np.uint8)
            people, found = cv2.imdecode(data, cv2.IMREAD_GRAYSCALE) > 0, shown[-1][..., 0] > 0
            self.assertGreater(np.sum(people & found) / np.sum(people | found), 0.85, camera)

    def test_exports_give_a_result_per_subject(self):
        refused = group.client("record", "export", "group", "--format", "trc", "--out", "x.trc", check=False)
        self.assertEqual(refused.returncode, 1)
        self.assertEqual(refused.stderr.count("\n"), 1, refused.stderr)
        self.assertIn("1, 2", refused.stderr)
        rows = {(int(r["frame"]), r["subject"]): r for r in table_of(self.recording / "poses/joints.csv")}
        for subject in ("1", "2"):
            for form in ("trc", "c3d", "bvh", "mot", "csv", "mp4"):
                words = ["--hold-withheld"] if form == "bvh" else []
                out = group.folder / f"{subject}.{form}"
                group.client(
                    "record", "export", "group", "--format", form, "--subject", subject, "--out", str(out), *words
                )
                self.assertGreater(out.stat().st_size, 1000)
            last = (group.folder / f"{subject}.csv").read_text().splitlines()[-1].split(",")
            self.assertIn(float(rows[FRAMES - 1, subject]["root_x"]), [float(cell or "nan") for cell in last])
        volumes = group.folder / "second"
        group.client("record", "export", "group", "--format", "ply", "--subject", "2", "--out", str(volumes))
        self.assertIn(f"{FRAMES - 1:06}.ply", [file.name for file in volumes.iterdir()])


if __name__ == "__main__":
    if not (PAIR / "session.toml").exists():
        print(f"skipped: {PAIR} is not here")
        sys.exit(77)
    unittest.main()
