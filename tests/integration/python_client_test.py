#!/usr/bin/python3
"""The Python client against a real daemon on the virtual studio. usage: python_client_test.py BUILD_FOLDER"""
import asyncio
import csv
import gc
import re
import sys
import tempfile
import threading
import time
import unittest
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parent.parent.parent
BUILD = Path(sys.argv.pop(1) if len(sys.argv) > 1 else REPOSITORY / "build/release").resolve()
sys.path[:0] = [str(BUILD / "client/python"), str(REPOSITORY / "tests/support")]
import numpy as np  # noqa: E402
from studio_daemon import StudioDaemon  # noqa: E402

import kinevox  # noqa: E402
from kinevox import AsyncClient, Client  # noqa: E402

DAEMON = str(BUILD / "server/daemon/kinevoxd")
folder = daemon = recording = None
recorded_poses = {}  # by sequence; of the recording "trial" and a few before and after


def setUpModule():
    global folder, daemon, recording
    folder = tempfile.TemporaryDirectory()
    unittest.addModuleCleanup(folder.cleanup)
    daemon = StudioDaemon(DAEMON, folder.name)
    unittest.addModuleCleanup(stop_daemon)  # also if the setup fails
    with Client(daemon.address) as client, client.poses(idle_timeout_s=60) as poses:
        next(pose for pose in poses if pose.found)
        client.recordings.start("trial")
        for pose in poses:
            recorded_poses[pose.sequence] = pose
            written = client.recordings.status().current
            if written and written.frame_set_count >= 20:
                break
        recording = client.recordings.stop()
        latest = client.status().message.latest_sequence
        while max(recorded_poses) < latest:
            pose = next(poses)
            recorded_poses[pose.sequence] = pose


def stop_daemon():
    status = daemon.stop()
    if status != 0:
        raise RuntimeError(f"the daemon ended with {status}")


def table_of(file):
    with open(file, newline="") as lines:
        return [{name: float(cell) if cell else np.nan for name, cell in row.items()} for row in csv.DictReader(lines)]


class ClientTest(unittest.TestCase):
    def setUp(self):
        self.client = Client(daemon.address, operator="a test")
        self.addCleanup(self.client.close)

    def wait_until(self, good, limit_s=60):
        end = time.monotonic() + limit_s
        while not good():
            self.assertLess(time.monotonic(), end, "the condition is not met in time")
            time.sleep(0.05)


class Streams(ClientTest):
    def test_every_pose_comes_in_order(self):
        with self.client.poses() as poses:
            kept = [next(poses) for _ in range(20)]
        self.assertEqual([pose.missed_count for pose in kept], [0] * 20)
        self.assertTrue(all(np.diff([pose.sequence for pose in kept]) >= 1))
        self.assertTrue(all(np.diff([pose.capture_time_ns for pose in kept]) > 0))
        self.assertIsNone(kept[0].recorded_frame)
        self.assertGreater(kept[0].header.stage_times_ms["total_ms"], 0)

    def test_the_values_of_a_pose(self):
        # Of this body of an average adult, a toe is withheld in 2 % of the poses.
        ends = ("head_top", "toe_l", "toe_r")
        pose = next(p for p in self.client.poses() if p.found and not {*ends} & {*p.joints.withheld_reason})
        self.assertEqual(pose.joints["knee_r"].shape, (3,))
        top, *toes = (pose.joints[joint][2] for joint in ends)
        self.assertTrue(0.8 < top - min(toes) < 2.2)
        self.assertEqual(
            pose.angles["knee_flexion_geometric_r"],
            pose.angles.deg[kinevox.ANGLE_NAMES.index("knee_flexion_geometric_r")],
        )
        np.testing.assert_allclose(pose.angles.rad, np.radians(pose.angles.deg))
        # The model's hinges against the angles between the joints.
        for coordinate, angle in (
            ("knee_angle_r", "knee_flexion_geometric_r"),
            ("elbow_flex_l", "elbow_flexion_geometric_l"),
        ):
            if np.isfinite(pose.coordinates[coordinate]) and np.isfinite(pose.angles[angle]):
                self.assertAlmostEqual(abs(pose.coordinates[coordinate]), pose.angles[angle], delta=0.5)
        for part in (pose.joints, pose.angles, pose.coordinates, pose.translations):
            self.assertTrue(all(part.withheld_reason.values()))
        for part in (pose.angles, pose.coordinates):
            withheld = [name in part.withheld_reason for name in part]
            np.testing.assert_array_equal(np.isnan(part.deg), withheld)
            np.testing.assert_array_equal(np.isnan(part.std_deg), withheld)
            self.assertGreater(np.nanmin(part.std_deg), 0)
        np.testing.assert_allclose(pose.translations.m, pose.joints["root"], atol=1e-9)
        self.assertAlmostEqual(np.linalg.norm(pose.segments.world_from_segment, axis=1).min(), 1, places=6)
        self.assertEqual(set(pose.ratios), set(kinevox.RATIO_NAMES))
        with self.assertRaisesRegex(KeyError, "unknown angle 'knee_angle_r'; the angles are knee_flexion_geometric_l"):
            pose.angles["knee_angle_r"]
        with self.assertRaisesRegex(KeyError, "unknown coordinate 'knee_flexion_geometric_r'; the coordinates are"):
            pose.coordinates["knee_flexion_geometric_r"]
        with self.assertRaisesRegex(KeyError, "unknown joint 'foot'; the joints are root"):
            pose.joints["foot"]

    def test_the_only_subject(self):
        pose = next(pose for pose in self.client.poses() if pose.found)
        self.assertEqual(len(pose.subjects), 1)
        self.assertIs(pose.only, pose.subjects[0])
        self.assertGreater(pose.subject_id, 0)
        self.assertIs(pose.subject(pose.subject_id), pose.only)
        self.assertFalse(pose.subject(pose.subject_id + 1).found)
        self.assertEqual([subject.subject_id for subject in self.client.status().subjects], [pose.subject_id])

    def test_leaving_a_loop_leaves_nothing_behind(self):
        for _ in range(10):
            for _ in self.client.poses(idle_timeout_s=30):
                break
            for _ in self.client.volumes():
                break
        gc.collect()
        status = lambda: self.client.status().message  # noqa: E731
        self.wait_until(lambda: status().pose_subscriber_count == 0 and status().volume_subscriber_count == 0)
        self.wait_until(lambda: threading.active_count() == 1)

    def test_closing_from_another_thread_ends_the_loop(self):
        stream = self.client.poses()
        next(stream)
        threading.Timer(0.2, stream.close).start()
        for _ in stream:
            pass

    def test_latest_only_counts_what_it_missed(self):
        missed = 0
        for rate_hz in (1, 0.2):  # the second for a capture that is slow itself, under a sanitizer
            with self.client.poses(max_rate_hz=rate_hz) as poses:
                missed = sum(next(poses).missed_count for _ in range(3))
            if missed:
                break
        self.assertGreater(missed, 0)
        with self.assertRaisesRegex(kinevox.InvalidArgument, "lossless"):
            next(self.client.poses("lossless", max_rate_hz=4))
        with self.assertRaisesRegex(ValueError, "use 'lossless' or 'latest'"):
            self.client.poses("some")

    def test_volumes_at_several_resolutions(self):
        fine = next(frame for frame in self.client.volumes(idle_timeout_s=60) if frame.volume)
        coarse = next(frame for frame in self.client.volumes(max_voxel_m=0.04, colours=False) if frame.volume)
        volume = fine.volume
        self.assertAlmostEqual(volume.volume_litres, fine.volume_litres, delta=1e-6)
        self.assertEqual(coarse.volume.voxel_m, 0.04)
        self.assertIsNone(coarse.volume.colours)
        dense = volume.dense()
        self.assertEqual(dense.shape, volume.shape)
        self.assertTrue(dense[tuple(volume.occupied_indices.T)].all())
        self.assertEqual(dense.sum(), volume.voxel_count)
        # The surface, found again on the whole box.
        padded = np.pad(dense, 1)
        inner = np.ones_like(dense)
        for axis in range(3):
            for side in (-1, 1):
                inner &= np.roll(padded, side, axis)[1:-1, 1:-1, 1:-1]
        surface = np.zeros_like(dense)
        surface[tuple(volume.surface_indices.T)] = True
        np.testing.assert_array_equal(surface, dense & ~inner)
        self.assertEqual(volume.colours.shape, (len(volume.surface_indices), 3))
        self.assertLess(np.linalg.norm(volume.surface_points_m.mean(axis=0) - fine.centre_m), 0.3)
        camera = self.client.cameras()[0]
        pixels = camera.project(volume.surface_points_m)
        self.assertTrue((pixels > 0).all() and (pixels < camera.size_px).all())

    def test_previews_and_events(self):
        with self.client.previews("cam1", max_width_px=160) as previews:
            self.assertEqual(next(previews).image().shape, (120, 160, 3))
        with self.assertRaisesRegex(kinevox.NotFound, "'cam9'.*cam1, cam2"):
            next(self.client.previews("cam9"))
        with self.client.events(history=1, idle_timeout_s=10) as events:
            before = next(events).event_id
            with self.client.control("Eve"):
                event = next(event for event in events if event.kind == "control_acquired")
        self.assertGreater(event.event_id, before)
        self.assertIn("Eve", event.message)


class Control(ClientTest):
    def test_one_operator_at_a_time(self):
        with Client(daemon.address) as other, other.control("Anna"):
            other.status()  # reading needs no control
            with self.assertRaisesRegex(kinevox.FailedPrecondition, "Anna") as caught:
                self.client.stop()
            self.assertNotIn("\n", str(caught.exception))
            self.assertEqual(self.client.status().operator_name, "Anna")
            with self.assertRaisesRegex(kinevox.KinevoxError, "holds control already"):
                with other.control():
                    pass
        self.assertEqual(self.client.status().operator_name, "")

    def test_a_stopped_capture_is_silent(self):
        self.client.stop()
        try:
            self.assertEqual(self.client.status().state, "stopped")
            with self.assertRaisesRegex(kinevox.DeadlineExceeded, "no message from .* for 0.4 s; .*idle_timeout_s"):
                for _ in self.client.poses(idle_timeout_s=0.4):
                    pass
            self.assertEqual(self.client.status().operator_name, "")
        finally:
            self.client.start()
        self.assertIsNotNone(next(self.client.poses(idle_timeout_s=60)))

    def test_calls_cover_the_api(self):
        from kinevox.v1 import calibration_service_pb2, capture_service_pb2, pose_service_pb2
        from kinevox.v1 import recording_service_pb2, replay_service_pb2, stream_service_pb2

        there = {
            f"{service.name}/{method.name}"
            for module in (
                calibration_service_pb2,
                capture_service_pb2,
                pose_service_pb2,
                recording_service_pb2,
                replay_service_pb2,
                stream_service_pb2,
            )
            for service in module.DESCRIPTOR.services_by_name.values()
            for method in service.methods
        }
        source = "".join(file.read_text() for file in (REPOSITORY / "client/python/kinevox").glob("*.py"))
        ours = set(re.findall(r'Call\(\s*"(\w+/\w+)"', source))
        self.assertEqual(ours - there, set())
        self.assertEqual(there - ours, {"CaptureService/RenewControl"})  # AcquireControl renews, too


class Recorded(ClientTest):
    """One recording: its entry, tables, exports and replay."""

    def setUp(self):
        super().setUp()
        self.folder = daemon.recordings / "trial"

    def test_what_is_known_of_it(self):
        self.assertEqual(recording.name, "trial")
        self.assertIn("trial", [entry.name for entry in self.client.recordings.list()])
        self.assertEqual(self.client.recordings.get("trial").frame_set_count, recording.frame_set_count)
        self.assertEqual(self.client.recordings.status().state, "idle")
        with self.assertRaisesRegex(kinevox.AlreadyExists, "trial"):
            self.client.recordings.start("trial")
        with self.assertRaises(kinevox.NotFound):
            self.client.recordings.delete("nothing")
        with self.assertRaisesRegex(ValueError, "use ffv1, utvideo or h264"):
            self.client.recordings.start(codec="mpeg")

    def test_streamed_poses_are_the_recorded_tables(self):
        table = kinevox.PoseTable.read(self.folder / "poses")
        with open(self.folder / "frames.csv", newline="") as lines:
            sequences = [int(row["sequence"]) for row in csv.DictReader(lines)]
        compared = 0
        for row, sequence in zip(range(len(table)), sequences):
            pose = recorded_poses.get(sequence)
            if pose is None:
                continue
            np.testing.assert_allclose(table.joints_m[row], pose.joints.positions_m, atol=6e-6)
            np.testing.assert_allclose(table.angles_deg[row], pose.angles.deg, atol=6e-4)
            # Modulo 360 degrees; the same values are withheld.
            away = table.coordinates_deg[row] - pose.coordinates.deg
            np.testing.assert_array_equal(np.isnan(table.coordinates_deg[row]), np.isnan(pose.coordinates.deg))
            np.testing.assert_allclose((away + 180) % 360, np.where(np.isnan(away), np.nan, 180), atol=1e-3)
            compared += pose.found
        # A slow capture finds the subject in fewer of them.
        found = np.isfinite(table.joints_m[:, 0, 0]).sum()
        self.assertGreater(found, 5)
        self.assertGreater(compared, 0.7 * found)

    def test_tables(self):
        table = kinevox.PoseTable.of(recorded_poses.values(), max_poses=5)
        file = Path(folder.name) / "table.csv"
        table.write_csv(file)
        rows = table_of(file)
        self.assertEqual(len(rows), 5)
        # Withheld in both or in none.
        np.testing.assert_allclose([row["knee_r_z_m"] for row in rows], table.joint("knee_r")[:, 2], atol=1e-5)
        np.testing.assert_allclose(
            [row["knee_angle_l_deg"] for row in rows], table.coordinate("knee_angle_l"), atol=1e-5
        )
        columns = list(table.columns())
        self.assertEqual(len(columns), len(set(columns)))
        self.assertRegex(repr(table), r"^<PoseTable: 5 rows over \d+\.\d\d s, \d poses, subjects \[[\d, ]*\]>$")
        subject_ids = table.subject_ids
        for subject_id in subject_ids:
            self.assertEqual(set(table.of_subject(subject_id).subject), {subject_id})
        self.assertEqual(rows[0]["time_s"], 0)
        with self.assertRaisesRegex(kinevox.InvalidArgument, "joints.csv cannot be read"):
            kinevox.PoseTable.read("/nowhere")
        self.assertEqual(len(kinevox.PoseTable.of([])), 0)
        try:
            import pandas  # noqa: F401
        except ImportError:
            self.skipTest("python3-pandas is not installed")
        frame = table.to_pandas()
        np.testing.assert_allclose(frame["trunk_lean_geometric_deg"], table.angle("trunk_lean_geometric"), atol=1e-7)

    def test_exports(self):
        out = Path(folder.name) / "exports"
        files = self.client.export("trial", "csv", out / "trial.csv")
        self.assertEqual(files, [out / "trial.csv"])
        self.assertGreaterEqual(len(table_of(files[0])), recording.frame_set_count)  # and a row for each that was lost
        with self.assertRaisesRegex(kinevox.NotFound, "cam9"):
            self.client.export("trial", "mp4", out / "trial.mp4", camera="cam9")
        with self.assertRaisesRegex(ValueError, "use trc, mot"):
            self.client.export("trial", "xls", out / "trial.xls")
        with self.assertRaisesRegex(kinevox.InvalidArgument, "anonymous"):
            self.client.export("trial", "session", out)
        self.assertEqual([file.name for file in out.iterdir()], ["trial.csv"])
        progress = []
        passed_on = {
            file.name
            for file in self.client.export(
                "trial", "session", out / "passed_on", anonymous=True, on_progress=progress.append
            )
        }
        self.assertTrue(progress, "no progress was reported while the silhouettes were computed")
        self.assertTrue(0 < progress[0] and progress == sorted(progress) and progress[-1] <= 1, progress)
        self.assertLessEqual({"session.toml", "README.txt", "cam_01.mkv", "video.mp4", "joints.csv"}, passed_on)

    def test_volumes_decode_to_what_the_daemon_exports(self):
        points = self.client.export("trial", "ply", Path(folder.name) / "points", first_frame=5, last_frame=7)
        data = (self.folder / "volumes.kvxv").read_bytes()
        volumes, at = {}, 8
        while at + 12 <= len(data):
            frame, size = int.from_bytes(data[at : at + 8], "little"), int.from_bytes(data[at + 8 : at + 12], "little")
            volumes[frame] = data[at + 12 : at + 12 + size]
            at += 12 + size
        for file in points:
            head, _, body = file.read_bytes().partition(b"end_header\n")
            count = int(re.search(rb"element vertex (\d+)", head).group(1))
            ply = np.frombuffer(body, dtype=np.dtype([("p", "<f4", 3), ("c", "u1", 3)]), count=count)
            volume = kinevox.Volume(volumes[int(file.stem)])
            np.testing.assert_allclose(volume.surface_points_m, ply["p"], atol=1e-5)
            np.testing.assert_array_equal(volume.colours, ply["c"])
        # Damaged tables are refused with one line.
        random = np.random.default_rng(1)
        refused = 0
        for _ in range(120):
            damaged = bytearray(volumes[int(points[0].stem)])
            for place in random.integers(0, len(damaged) if random.random() < 0.5 else 112, size=2):
                damaged[place] ^= 1 << random.integers(8)
            try:
                kinevox.Volume(bytes(damaged[: random.integers(len(damaged)) if random.random() < 0.3 else None]))
            except kinevox.InvalidArgument as error:
                self.assertNotIn("\n", str(error))
                refused += 1
        self.assertGreater(refused, 80)

    def test_replay(self):
        session = self.folder / "session.toml"
        with self.assertRaises(kinevox.NotFound):
            self.client.replay.open("nothing")
        with self.assertRaisesRegex(kinevox.PermissionDenied, "/nowhere/session.toml"):
            self.client.replay.open("/nowhere/session.toml")
        with self.client.control("replay test", timeout_s=600), self.client.poses(idle_timeout_s=60) as poses:
            poses.wait_until_subscribed()
            try:
                self.assertEqual(self.client.replay.open("trial", paused=True).state, "paused")
                self.assertEqual(self.client.replay.status().session_path, str(session))
                for wanted in (0, 1, 2):
                    pose = next(pose for pose in poses if pose.recorded_frame is not None)
                    self.assertEqual(pose.recorded_frame, wanted)
                    self.client.replay.step()
                self.client.replay.seek(frame=10)
                found = next(pose for pose in poses if pose.recorded_frame not in (3, None))
                self.assertEqual(found.recorded_frame, 10)
                self.assertEqual(self.client.replay.status().frame_count, recording.frame_set_count)
                with self.assertRaises(kinevox.OutOfRange):
                    self.client.replay.seek(frame=100000)
                with self.assertRaisesRegex(ValueError, "one of them"):
                    self.client.replay.seek()
                self.assertEqual(self.client.replay.set_speed(2).speed, 2)
                self.assertTrue(self.client.replay.set_loop(True).loop)
                self.assertEqual(self.client.replay.play().state, "playing")
            finally:
                self.client.replay.close()
        self.assertEqual(self.client.replay.status().state, "live")

    def test_every_frame_of_a_session(self):
        session = self.folder / "session.toml"
        for pose in self.client.measure_session("trial"):
            self.assertLess(pose.recorded_frame, 3)
            if pose.recorded_frame == 2:
                break  # ends the replay, too
        self.wait_until(lambda: self.client.replay.status().state == "live")

        async def use():
            async with AsyncClient(daemon.address) as client:
                frames = client.measure_session(session)
                numbers = [(await anext(frames)).recorded_frame for _ in range(3)]
                await frames.aclose()
                return numbers, (await client.replay.status()).state

        self.assertEqual(asyncio.run(use()), ([0, 1, 2], "live"))
        self.assertEqual(self.client.status().operator_name, "")


class Others(ClientTest):
    def test_calibrations(self):
        text = self.client.calibrations.export()
        self.assertIn(b"[cam1]", text)
        stored = self.client.calibrations.import_(text, note="from a test")
        entry = self.client.calibrations.list()[-1]
        self.assertEqual(
            (entry.id, entry.method, entry.note, entry.compatible), (stored, "import", "from a test", True)
        )
        self.assertIn(self.client.calibrations.certificate(stored).verdict, ("unspecified", "go", "caution", "no_go"))
        self.assertFalse(self.client.calibrations.apply(stored))
        self.assertEqual(self.client.calibrations.undo(), "")
        self.client.calibrations.delete(stored)
        with self.assertRaisesRegex(ValueError, "unknown format 'xml'; use one of toml, opencv"):
            self.client.calibrations.export(format="xml")

    def test_a_calibration_procedure(self):
        with self.client.calibration_progress(idle_timeout_s=10) as progress:
            self.assertEqual(next(progress).state, "none")
            self.client.calibrations.start("extrinsics_board", board="charuco:4x5:54:40.5:DICT_4X4_1000")
            self.client.calibrations.add_live("moving_target")
            seen = next(state for state in progress if state.raw.shared_frame_set_count or state.raw.cameras)
            self.assertEqual(seen.state, "collecting")
            self.client.calibrations.cancel()
            self.assertEqual(next(state for state in progress if state.over).state, "cancelled")
        with self.assertRaises(kinevox.FailedPrecondition):
            self.client.calibrations.solve()

    def test_body_and_pose_database(self):
        body = next(self.client.body_progress()).only
        self.assertTrue(1.2 < body.stature_m < 2.2)
        self.assertTrue(body.lengths_m and all(0 < value < 1 for value in body.lengths_m.values()))
        with self.assertRaisesRegex(kinevox.FailedPrecondition, "pose database"):
            self.client.poses.list()


class Restarts(unittest.TestCase):
    def test_streams_over_a_restart(self):
        with tempfile.TemporaryDirectory() as name:
            first = StudioDaemon(DAEMON, name, size=(160, 120))
            client = Client(first.address)
            reasons = []
            with client.poses(
                reconnect=True, idle_timeout_s=30, on_reconnect=reasons.append
            ) as lasting, client.poses() as ending:
                next(lasting), next(ending)
                other_reasons = []
                other = threading.Thread(target=lambda: asyncio.run(self.follow(first.address, other_reasons)))
                other.start()
                while not other_reasons:
                    next(lasting)
                first.stop()
                second = StudioDaemon(DAEMON, name, port=first.port, size=(160, 120))
                try:
                    with self.assertRaises(kinevox.Unavailable):
                        for _ in ending:
                            pass
                    # Messages already received come first.
                    self.assertTrue(any(lasting.reconnects > 0 for _ in lasting))
                    other.join(30)
                    self.assertEqual(other_reasons[-1], "came back")
                    self.assertEqual({type(why) for why in reasons + other_reasons[1:-1]}, {kinevox.Unavailable})
                finally:
                    second.stop()
            with self.assertRaisesRegex(
                kinevox.Unavailable, f"cannot connect to a daemon at {first.address} .*; start kinevoxd"
            ):
                client.status()

    async def follow(self, address, reasons):
        async with AsyncClient(address) as client, client.poses(reconnect=True, on_reconnect=reasons.append) as poses:
            reasons.append((await anext(poses)).sequence)
            async for _ in poses:
                if poses.reconnects:
                    break
        reasons.append("came back")


class Asynchronous(unittest.TestCase):
    def test_calls_and_streams(self):
        async def use():
            async with AsyncClient(daemon.address, operator="an async test") as client:
                self.assertEqual((await client.status()).state, "running")
                count = 0
                async for pose in client.poses(idle_timeout_s=60):
                    count += 1
                    self.assertEqual(pose.missed_count, 0)
                    if count == 5:
                        break
                volumes, previews = await asyncio.gather(
                    self.first(client.volumes()), self.first(client.previews("cam2"))
                )
                self.assertEqual(previews.image().shape[2], 3)
                self.assertGreater(volumes.header.sequence, 0)
                name = await client.recordings.start("async")
                await asyncio.sleep(0.3)
                self.assertEqual((await client.recordings.stop()).name, name)
                files = await client.export("trial", "csv", Path(folder.name) / "async.csv")
                self.assertTrue(files[0].exists())
                await client.recordings.delete(name)
                async with client.control("Ben"):
                    self.assertEqual((await client.status()).operator_name, "Ben")
                with self.assertRaises(kinevox.FailedPrecondition):
                    await client.replay.pause()
                with self.assertRaises(kinevox.FailedPrecondition):
                    await client.calibrations.solve()
                with self.assertRaises(kinevox.DeadlineExceeded):
                    await self.silent(client)
                while (
                    status := (await client.status()).message
                ).pose_subscriber_count + status.volume_subscriber_count:
                    await asyncio.sleep(0.05)

        asyncio.run(asyncio.wait_for(use(), 60))

    async def first(self, stream):
        async with stream:
            async for message in stream:
                return message

    async def silent(self, client):
        await client.stop()
        try:
            async for _ in client.poses(idle_timeout_s=0.3):
                pass
        finally:
            await client.start()


if __name__ == "__main__":
    unittest.main(verbosity=2)
