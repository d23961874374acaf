#!/usr/bin/python3
"""Fake GigE Vision cameras over a loopback of their own, and what the daemon makes of them.

usage: live_cameras_test.py BUILD_FOLDER"""
import json
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from live_rig import Daemon, FakeCamera, cameras_toml, in_a_namespace, wait_until  # noqa: E402

BUILD = Path(sys.argv[1] if len(sys.argv) > 1 else "build/release").resolve()
FAKE = BUILD / "tests/support/fake_gige/kinevox-fake-gige"
PROBE = BUILD / "tests/live_probe"
PACKAGED = "arv-fake-gv-camera-0.8"
# The thread sanitizer's daemon and cameras keep no 30 pictures a second.
TIMES_SLOWER = 5 if BUILD.name.startswith("tsan") else 1
FPS = 30 / TIMES_SLOWER
EXTERNAL = f'trigger = "external"\nfps = {FPS}\n'
NAMES = ["cam1", "cam2", "cam3", "cam4"]
SETTINGS = ('exposure_us = 4000\ngain_db = 3.5\nwhite_balance = "off"\nwhite_balance_ratios = [1.5, 1.0, 2.0]\n'
            'offset_px = [64, 32]\n')
LIGHT = '[pipeline]\nvoxel_mm = 25\n[pose]\nenabled = false\n'
WAYS = ["pictures", "lost", "incomplete", "late", "unmatched", "settling"]


class LiveCameras(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.shared = tempfile.TemporaryDirectory()
        cls.session = Path(cls.shared.name) / "walk/session.toml"
        subprocess.run([BUILD / "server/tools/kinevox-studio", "--motion", "walk", "--frames", "12", "--background-frames",
                        "8", "--no-masks", "--out", cls.session.parent], check=True, stdout=subprocess.DEVNULL)
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
        text = cameras_toml(NAMES if devices is None else NAMES[:len(devices)], self.calibration, more)
        for n, device in enumerate(devices or [], 1):
            text = text.replace(f'"F{n}"', f'"{device}"')
        config.write_text(text)
        run = subprocess.run([PROBE, config, "--seconds", str(seconds), *options], capture_output=True, text=True, timeout=60)
        self.assertEqual(run.returncode, 0, run.stderr)
        lines = [json.loads(line) for line in run.stdout.splitlines()]
        return lines[-1], lines[:-1]

    def test_the_daemon_tracks_and_outlives_a_camera(self):
        empty = Path(self.folder.name) / "empty"
        empty.touch()
        self.cameras = [FakeCamera(FAKE, n, ["--external-fps", FPS, "--session", self.session, "--camera", name, "--empty-while", empty,
                                             "--loss", 0.01, "--jitter-ms", 20]) for n, name in enumerate(NAMES, 1)]
        daemon = Daemon(self.folder.name,
                        cameras_toml(NAMES, self.calibration, EXTERNAL + 'pixel_format = "BayerRG8"\n') + LIGHT,
                        BUILD / "server/daemon/kinevoxd", BUILD / "client/cli/kinevox")
        self.addCleanup(daemon.end)
        wait_until("all deliver", lambda: all(link and link["connected"] for link in daemon.links()))
        daemon.kinevox("learn-background", "--frames", "16")
        empty.unlink()
        wait_until("somebody is tracked", lambda: daemon.status().get("subject"))
        self.assertEqual({link["clock"] for link in daemon.links()}, {"device"})

        at_ns = time.time_ns()
        self.cameras[2].vanish()
        wait_until("it is named", lambda: daemon.events("camera_lost"))
        named_s = (int(daemon.events("camera_lost")[0]["time_ns"]) - at_ns) / 1e9
        self.assertLess(named_s, TIMES_SLOWER)
        self.assertEqual(daemon.events("camera_lost")[0]["camera"], "cam3")
        before = daemon.status()
        self.assertIn("cam3", before["cameras"][2]["link"]["problem"])
        time.sleep(TIMES_SLOWER)
        after = daemon.status()
        self.assertGreater(int(after["results"]), int(before["results"]), "the others go on")
        self.assertTrue(after.get("subject"))
        self.assertFalse(after["cameras"][2]["has_picture"])
        self.cameras[2].start()
        wait_until("it rejoins", lambda: daemon.events("camera_rejoined"))
        wait_until("its pictures are used", lambda: daemon.status()["cameras"][2]["has_picture"])
        kinds = [e["kind"] for e in daemon.events("camera_lost", "camera_rejoined")]
        self.assertEqual(kinds, ["camera_lost", "camera_rejoined"])
        links = daemon.links()
        self.assertEqual(int(links[2]["disconnects"]), 1)
        self.assertGreater(sum(int(link["packets_resent"]) for link in links), 10 / TIMES_SLOWER)

        self.cameras[0].vanish()   # the end comes in time also where a camera has just died
        self.assertLess(daemon.stop(), 4 * TIMES_SLOWER)
        counted = [sum(int(link[way]) for way in WAYS) for link in links]
        for camera, count in zip(self.cameras, counted):
            if camera.process:
                camera.vanish()
            self.assertGreaterEqual(camera.total("taken"), count)

    def test_after_a_crash_the_background_is_there_again(self):
        empty = Path(self.folder.name) / "empty"
        empty.touch()
        self.cameras = [FakeCamera(FAKE, n, ["--external-fps", FPS, "--session", self.session, "--camera", name, "--empty-while", empty])
                        for n, name in enumerate(NAMES, 1)]
        text = cameras_toml(NAMES, self.calibration, EXTERNAL + 'pixel_format = "BayerRG8"\n') + LIGHT
        daemon = Daemon(self.folder.name, text, BUILD / "server/daemon/kinevoxd", BUILD / "client/cli/kinevox")
        self.addCleanup(daemon.end)
        wait_until("all deliver", lambda: all(link and link["connected"] for link in daemon.links()))
        daemon.kinevox("learn-background", "--frames", "16")
        stored = Path(self.folder.name) / "kinevox/background"
        wait_until("it is stored", lambda: all((stored / f"{name}.index").is_file() for name in NAMES))
        daemon.process.kill()
        daemon.stop()
        empty.unlink()   # from now on somebody stands there: it could not be learned again
        daemon = Daemon(self.folder.name, text, BUILD / "server/daemon/kinevoxd", BUILD / "client/cli/kinevox")
        self.addCleanup(daemon.end)
        wait_until("somebody is tracked", lambda: daemon.status().get("subject"))
        learned = [event["message"] for event in daemon.events("background_learned")]
        self.assertEqual(len(learned), 1, learned)
        daemon.stop()

    def test_every_byte_is_as_it_was_sent_and_every_loss_counted(self):
        self.fakes("--loss", 0.02, "--lost-pictures", 0.05 * TIMES_SLOWER, "--jitter-ms", 30, "--first-block", 65450)
        seen, _ = self.probe(8, EXTERNAL + 'pixel_format = "Mono8"\n', None, "--pattern")
        self.assertEqual(seen["wrong"], 0)
        self.assertGreater(seen["sets"], 100 / TIMES_SLOWER)
        for camera, link in zip(self.cameras, seen["cameras"]):
            camera.vanish()
            self.assertGreaterEqual(camera.total("gone"), 2)
            self.assertLessEqual(abs(camera.total("gone") - link["lost"]), 3)   # the last ones may be on the way
            not_counted = camera.total("taken") - sum(link[way] for way in WAYS)   # on their way at the end
            self.assertGreaterEqual(not_counted, 0)
            self.assertLessEqual(not_counted, 10 + camera.total("under_way"))

    def test_a_picture_without_its_first_packet_is_counted_once(self):
        self.fakes("--loss", 0.02)
        seen, _ = self.probe(6, EXTERNAL + 'pixel_format = "Mono8"\npacket_resend = false\n', None, "--pattern")
        self.assertEqual(seen["wrong"], 0)
        for camera, link in zip(self.cameras, seen["cameras"]):
            camera.vanish()
            self.assertGreater(link["incomplete"], 20 / TIMES_SLOWER)
            not_counted = camera.total("taken") - sum(link[way] for way in WAYS)   # on their way at the end
            self.assertGreaterEqual(not_counted, 0)
            self.assertLessEqual(not_counted, 10 + camera.total("under_way"))

    def test_the_same_moment_by_command_by_line_and_by_ptp(self):
        for more, clock in ((f'trigger = "software"\nfps = {FPS}\n', 2), (EXTERNAL + 'ptp = true\n', 3)):
            self.fakes()
            seen, _ = self.probe(5, 'pixel_format = "Mono8"\n' + more + SETTINGS)
            for camera, link in zip(self.cameras, seen["cameras"]):
                camera.vanish()
                self.assertEqual(link["problem"], "")
                self.assertEqual(link["clock"], clock)
                self.assertGreater(link["pictures"], 30 / TIMES_SLOWER)
                self.assertEqual(link["lost"], 0)
            self.assertGreater(seen["complete"], 0.9 * seen["sets"], more)
            if clock == 3:
                self.assertLess(max(link["skew_max_ms"] for link in seen["cameras"]), 0.1)

    def test_what_a_camera_refuses_is_told_with_the_key(self):
        self.fakes(count=2)
        for more, words in (('pixel_format = "Mono99"\n', ["pixel_format", "Mono99", "cam1"]),
                            ('trigger_line = "Line7"\ntrigger = "external"\n', ["trigger", "Line7"])):
            seen, events = self.probe(5, more, ["F1", "F2"])
            for word in words:
                self.assertIn(word, seen["cameras"][0]["problem"])
            self.assertIn(seen["cameras"][0]["problem"], [event["message"] for event in events])

    def test_cameras_are_found_by_serial_name_and_address(self):
        self.fakes(count=3)
        run = subprocess.run([BUILD / "server/tools/kinevox-discover", "--json"], capture_output=True, text=True, check=True)
        found = json.loads(run.stdout)
        self.assertEqual([camera["serial"] for camera in found], ["F1", "F2", "F3"])
        self.assertEqual(found[1]["name"], "eye2")
        seen, _ = self.probe(4, 'trigger = "external"\n', ["127.0.0.3", "eye2", "F1"])
        self.assertEqual([link["problem"] for link in seen["cameras"]], ["", "", ""])
        seen, _ = self.probe(5, 'trigger = "external"\n', ["F1", "F9"])
        self.assertIn("F9", seen["cameras"][1]["problem"])
        self.assertIn("F3", seen["cameras"][1]["problem"], "what there is instead")

    def test_aravis_own_fake_camera(self):
        try:
            fakes = [subprocess.Popen([PACKAGED, "-i", f"127.0.0.{n}", "-s", f"GV0{n}"], stdout=subprocess.DEVNULL,
                                      stderr=subprocess.DEVNULL) for n in (1, 2)]
        except FileNotFoundError:
            self.skipTest("aravis-tools is not installed")
        try:
            time.sleep(0.5)
            seen, _ = self.probe(6, 'trigger = "software"\npixel_format = "Mono8"\n', ["GV01", "GV02"])
        finally:
            for fake in fakes:
                fake.kill()
                fake.wait()
        self.assertEqual([link["problem"] for link in seen["cameras"]], ["", ""])
        self.assertGreater(seen["complete"], 20)


if __name__ == "__main__":
    in_a_namespace()
    unittest.main(argv=[sys.argv[0], *sys.argv[2:]])
