#!/usr/bin/python3
"""The daemon with fake GigE Vision cameras in a network namespace.

usage: live_cameras_test.py BUILD_FOLDER"""
import json
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from live_rig import Daemon, FakeCamera, cameras_toml, event_time_ns, in_a_namespace, wait_until  # noqa: E402

BUILD = Path(sys.argv[1] if len(sys.argv) > 1 else "build/release").resolve()
FAKE = BUILD / "tests/support/fake_gige/kinevox-fake-gige"
PROBE = BUILD / "tests/live_probe"
PACKAGED = "arv-fake-gv-camera-0.8"
# With the thread sanitizer, daemon and cameras are too slow for 30 images per second.
TIMES_SLOWER = 5 if BUILD.name.startswith("tsan") else 1
FPS = 30 / TIMES_SLOWER
EXTERNAL = f'trigger = "external"\nfps = {FPS}\n'
NAMES = ["cam1", "cam2", "cam3", "cam4"]
SETTINGS = (
    'exposure_us = 4000\ngain_db = 3.5\nwhite_balance = "off"\nwhite_balance_ratios = [1.5, 1.0, 2.0]\n'
    "sensor_offset_px = [64, 32]\n"
)
LIGHT = "[pipeline]\nvoxel_mm = 25\n[pose]\nenabled = false\n"
ENOUGH = ["--until-complete", str(int(60 / TIMES_SLOWER))]
WAYS = [
    "image_count",
    "lost_image_count",
    "incomplete_image_count",
    "late_image_count",
    "unmatched_image_count",
    "warmup_image_count",
]


class LiveCameras(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.shared = tempfile.TemporaryDirectory()
        cls.session = Path(cls.shared.name) / "walk/session.toml"
        subprocess.run(
            [
                BUILD / "server/tools/kinevox-studio",
                "--motion",
                "walk",
                "--frames",
                "12",
                "--background-frames",
                "8",
                "--no-masks",
                "--out",
                cls.session.parent,
            ],
            check=True,
            stdout=subprocess.DEVNULL,
        )
        cls.calibration = cls.session.parent / "calibration.toml"

    @classmethod
    def tearDownClass(cls):
        cls.shared.cleanup()

    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.cameras = []

    def tearDown(self):
        for camera in self.cameras:
            if camera.process:
                camera.process.kill()
                camera.process.communicate()
        self.folder.cleanup()

    def fakes(self, *options, count=4):
        self.cameras = [FakeCamera(FAKE, n, ["--external-fps", FPS, *options]) for n in range(1, count + 1)]

    def probe(self, seconds, more, devices=None, *options):
        config = Path(self.folder.name) / "cameras.toml"
        text = cameras_toml(NAMES if devices is None else NAMES[: len(devices)], self.calibration, more)
        for n, device in enumerate(devices or [], 1):
            text = text.replace(f'"F{n}"', f'"{device}"')
        config.write_text(text)
        run = subprocess.run(
            [PROBE, config, "--seconds", str(seconds), *options], capture_output=True, text=True, timeout=60
        )
        self.assertEqual(run.returncode, 0, run.stderr)
        lines = [json.loads(line) for line in run.stdout.splitlines()]
        return lines[-1], lines[:-1]

    def test_tracking_survives_disconnected_camera(self):
        empty = Path(self.folder.name) / "empty"
        empty.touch()
        self.cameras = [
            FakeCamera(
                FAKE,
                n,
                [
                    "--external-fps",
                    FPS,
                    "--session",
                    self.session,
                    "--camera",
                    name,
                    "--empty-while",
                    empty,
                    "--loss",
                    0.01,
                    "--jitter-ms",
                    20,
                ],
            )
            for n, name in enumerate(NAMES, 1)
        ]
        daemon = Daemon(
            self.folder.name,
            cameras_toml(NAMES, self.calibration, EXTERNAL + 'pixel_format = "BayerRG8"\n') + LIGHT,
            BUILD / "server/daemon/kinevoxd",
            BUILD / "client/cli/kinevox",
        )
        self.addCleanup(daemon.end)
        wait_until("all deliver", lambda: all(each and each["connected"] for each in daemon.connections()))
        daemon.kinevox("learn-background", "--frames", "16")
        empty.unlink()
        wait_until("a subject is tracked", lambda: daemon.status().get("subjects"))
        self.assertEqual({each["timestamp_source"] for each in daemon.connections()}, {"device"})

        at_ns = time.time_ns()
        self.cameras[2].vanish()
        wait_until("it is reported", lambda: daemon.events("camera_disconnected"))
        reported_s = (event_time_ns(daemon.events("camera_disconnected")[0]) - at_ns) / 1e9
        self.assertLess(reported_s, TIMES_SLOWER)
        self.assertEqual(daemon.events("camera_disconnected")[0]["camera"], "cam3")
        before = daemon.status()
        self.assertIn("cam3", before["cameras"][2]["connection"]["error_message"])
        time.sleep(TIMES_SLOWER)
        after = daemon.status()
        self.assertGreater(int(after["result_count"]), int(before["result_count"]), "the other cameras continue")
        self.assertTrue(after.get("subjects"))
        self.assertFalse(after["cameras"][2]["has_image"])
        self.cameras[2].start()
        wait_until("it reconnects", lambda: daemon.events("camera_reconnected"))
        wait_until("its images are used", lambda: daemon.status()["cameras"][2]["has_image"])
        kinds = [e["kind"] for e in daemon.events("camera_disconnected", "camera_reconnected")]
        self.assertEqual(kinds, ["camera_disconnected", "camera_reconnected"])
        connections = daemon.connections()
        self.assertEqual(int(connections[2]["disconnect_count"]), 1)
        self.assertGreater(sum(int(each["resent_packet_count"]) for each in connections), 10 / TIMES_SLOWER)

        self.cameras[0].vanish()  # a camera that has just died does not delay the shutdown
        self.assertLess(daemon.stop(), 4 * TIMES_SLOWER)
        counted = [sum(int(each[way]) for way in WAYS) for each in connections]
        for camera, count in zip(self.cameras, counted):
            if camera.process:
                camera.vanish()
            self.assertGreaterEqual(camera.total("taken"), count)

    def test_background_is_restored_after_crash(self):
        empty = Path(self.folder.name) / "empty"
        empty.touch()
        self.cameras = [
            FakeCamera(
                FAKE, n, ["--external-fps", FPS, "--session", self.session, "--camera", name, "--empty-while", empty]
            )
            for n, name in enumerate(NAMES, 1)
        ]
        text = cameras_toml(NAMES, self.calibration, EXTERNAL + 'pixel_format = "BayerRG8"\n') + LIGHT
        daemon = Daemon(self.folder.name, text, BUILD / "server/daemon/kinevoxd", BUILD / "client/cli/kinevox")
        self.addCleanup(daemon.end)
        wait_until("all deliver", lambda: all(each and each["connected"] for each in daemon.connections()))
        daemon.kinevox("learn-background", "--frames", "16")
        stored = Path(self.folder.name) / "kinevox/background"
        wait_until("it is stored", lambda: all((stored / f"{name}.index").is_file() for name in NAMES))
        daemon.process.kill()
        daemon.stop()
        empty.unlink()  # from now on the scene has a subject: the background could not be learned again
        daemon = Daemon(self.folder.name, text, BUILD / "server/daemon/kinevoxd", BUILD / "client/cli/kinevox")
        self.addCleanup(daemon.end)
        wait_until("a subject is tracked", lambda: daemon.status().get("subjects"))
        learned = [event["message"] for event in daemon.events("background_learned")]
        self.assertEqual(len(learned), 1, learned)
        daemon.stop()

    def test_images_are_exact_and_losses_counted(self):
        self.fakes("--loss", 0.02, "--lost-images", 0.05 * TIMES_SLOWER, "--jitter-ms", 30, "--first-block", 65450)
        seen, _ = self.probe(8, EXTERNAL + 'pixel_format = "Mono8"\n', None, "--pattern")
        self.assertEqual(seen["wrong"], 0)
        self.assertGreater(seen["sets"], 100 / TIMES_SLOWER)
        for camera, each in zip(self.cameras, seen["cameras"]):
            camera.vanish()
            self.assertGreaterEqual(camera.total("gone"), 2)
            self.assertLessEqual(
                abs(camera.total("gone") - each["lost_image_count"]), 3
            )  # the last ones may be on the way
            not_counted = camera.total("taken") - sum(each[way] for way in WAYS)  # on their way at the end
            self.assertGreaterEqual(not_counted, 0)
            self.assertLessEqual(not_counted, 10 + camera.total("under_way"))

    def test_image_without_first_packet_is_counted_once(self):
        self.fakes("--loss", 0.02)
        seen, _ = self.probe(6, EXTERNAL + 'pixel_format = "Mono8"\npacket_resend = false\n', None, "--pattern")
        self.assertEqual(seen["wrong"], 0)
        for camera, each in zip(self.cameras, seen["cameras"]):
            camera.vanish()
            self.assertGreater(each["incomplete_image_count"], 20 / TIMES_SLOWER)
            not_counted = camera.total("taken") - sum(each[way] for way in WAYS)  # on their way at the end
            self.assertGreaterEqual(not_counted, 0)
            self.assertLessEqual(not_counted, 10 + camera.total("under_way"))

    def test_software_external_and_ptp_synchronisation(self):
        for more, clock in ((f'trigger = "software"\nfps = {FPS}\n', 2), (EXTERNAL + "ptp = true\n", 3)):
            self.fakes()
            seen, _ = self.probe(5, 'pixel_format = "Mono8"\n' + more + SETTINGS, None, *ENOUGH)
            for camera, each in zip(self.cameras, seen["cameras"]):
                camera.vanish()
                self.assertEqual(each["error_message"], "")
                self.assertEqual(each["timestamp_source"], clock)
                self.assertGreater(each["image_count"], 30 / TIMES_SLOWER)
                self.assertEqual(each["lost_image_count"], 0)
            self.assertGreater(seen["complete"], 0.9 * seen["sets"], more)
            if clock == 3:
                self.assertLess(max(each["max_abs_skew_ms"] for each in seen["cameras"]), 0.1)

    def test_rejected_setting_names_key(self):
        self.fakes(count=2)
        for more, words in (
            ('pixel_format = "Mono99"\n', ["pixel_format", "Mono99", "cam1"]),
            ('trigger_input_line = "Line7"\ntrigger = "external"\n', ["trigger", "Line7"]),
        ):
            seen, events = self.probe(5, more, ["F1", "F2"], "--until-error", "1")
            for word in words:
                self.assertIn(word, seen["cameras"][0]["error_message"])
            self.assertIn(seen["cameras"][0]["error_message"], [event["message"] for event in events])

    def test_cameras_are_found_by_serial_name_and_address(self):
        self.fakes(count=3)
        run = subprocess.run(
            [BUILD / "server/tools/kinevox-discover", "--json"], capture_output=True, text=True, check=True
        )
        found = json.loads(run.stdout)
        self.assertEqual([camera["serial"] for camera in found], ["F1", "F2", "F3"])
        self.assertEqual(found[1]["name"], "eye2")
        seen, _ = self.probe(4, 'trigger = "external"\n', ["127.0.0.3", "eye2", "F1"], *ENOUGH)
        self.assertGreater(seen["complete"], 0)
        self.assertEqual([each["error_message"] for each in seen["cameras"]], ["", "", ""])
        seen, _ = self.probe(5, 'trigger = "external"\n', ["F1", "F9"], "--until-error", "2")
        self.assertIn("F9", seen["cameras"][1]["error_message"])
        self.assertIn("F3", seen["cameras"][1]["error_message"], "the cameras that were found")

    def test_aravis_own_fake_camera(self):
        try:
            fakes = [
                subprocess.Popen(
                    [PACKAGED, "-i", f"127.0.0.{n}", "-s", f"GV0{n}"],
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                )
                for n in (1, 2)
            ]
        except FileNotFoundError:
            self.skipTest("aravis-tools is not installed")
        try:
            time.sleep(0.5)
            seen, _ = self.probe(6, 'trigger = "software"\npixel_format = "Mono8"\n', ["GV01", "GV02"], *ENOUGH)
        finally:
            for fake in fakes:
                fake.kill()
                fake.wait()
        self.assertEqual([each["error_message"] for each in seen["cameras"]], ["", ""])
        self.assertGreater(seen["complete"], 20)


if __name__ == "__main__":
    in_a_namespace()
    unittest.main(argv=[sys.argv[0], *sys.argv[2:]])
