#!/usr/bin/python3
"""`kinevox subjects` with a running daemon: list, follow, ignore, name, and the rules of its configuration.

usage: subjects_test.py BUILD_FOLDER [unittest options]"""
import json
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY / "tests/support"))
from studio_daemon import StudioDaemon  # noqa: E402

BUILD = Path()
WAIT_S = 60


class Subjects(unittest.TestCase):
    def start(self, tracking):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        program = BUILD / "server/daemon/kinevoxd"
        self.daemon = StudioDaemon(program, folder.name, f"[tracking]\n{tracking}", motion="squat", fps=5)
        self.addCleanup(self.daemon.stop)

    def kinevox(self, *words):
        command = [BUILD / "client/cli/kinevox", *words, "--server", self.daemon.address]
        return subprocess.run(command, capture_output=True, text=True, timeout=WAIT_S)

    def done(self, *words):
        result = self.kinevox(*words)
        self.assertEqual(result.returncode, 0, result.stderr)
        return result.stdout

    def failed(self, *words):
        result = self.kinevox(*words)
        self.assertEqual(result.returncode, 1, result.stdout)
        self.assertEqual(result.stderr.count("\n"), 1, result.stderr)
        return result.stderr

    def listed(self):
        return json.loads(self.done("subjects", "list", "--json"))["subjects"]

    def wait_for(self, following):
        end = time.monotonic() + WAIT_S
        while True:
            subjects = self.listed()
            if subjects and subjects[0]["following"] == following:
                return subjects[0]
            self.assertLess(time.monotonic(), end, f"not {following}: {subjects}")
            time.sleep(0.1)

    def followed_in_status(self):
        """Of a result after the last request."""
        first = json.loads(self.done("status", "--json"))["latest_sequence"]
        while True:
            status = json.loads(self.done("status", "--json"))
            if status["latest_sequence"] >= first + 3:
                return [subject["subject"] for subject in status["subjects"]]
            time.sleep(0.1)

    def events_until(self, text):
        command = [BUILD / "client/cli/kinevox", "events", "--history", "50", "--server", self.daemon.address]
        with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
            seen = ""
            for line in process.stdout:
                seen += line
                if text in line:
                    break
            process.terminate()
        return seen

    def test_list_ignore_follow_and_name(self):
        self.start("max_subjects = 2\n")
        subject = self.wait_for("followed")
        self.assertEqual(subject["subject_id"], 1)
        self.assertGreater(subject["height_m"], 0.9)
        self.done("subjects", "name", "1", "Anna B.")
        table = self.done("subjects", "list").splitlines()
        self.assertEqual(table[0].split(), ["id", "name", "state", "x", "m", "y", "m", "height", "m"])
        self.assertRegex(table[1], r"^ *1 +Anna B\. +followed ")
        self.assertEqual([s["name"] for s in self.followed_in_status()], ["Anna B."])

        self.done("subjects", "ignore", "1")
        self.wait_for("ignored")
        self.assertEqual(self.followed_in_status(), [])
        self.done("subjects", "follow", "--all")
        self.assertEqual(self.wait_for("followed")["name"], "Anna B.")
        self.assertEqual([s["subject_id"] for s in self.followed_in_status()], [1])
        events = self.events_until("followed again")
        self.assertIn("no longer followed (on request)", events)

        self.assertIn("no subject 7; choose one of 1", self.failed("subjects", "follow", "1", "7"))
        self.assertIn("no subject 7", self.failed("subjects", "ignore", "7"))
        self.assertIn("--all", self.failed("subjects", "follow"))
        self.assertIn("control characters", self.failed("subjects", "name", "1", "a\tb"))

    def test_keep_out_region(self):
        corners = "[[-9, -9], [9, -9], [9, 9], [-9, 9]]"
        self.start(f"keep_out_region = [{{ corners_m = {corners} }}]\n")
        self.wait_for("outside")
        self.assertEqual(self.followed_in_status(), [])
        self.done("subjects", "follow", "1")
        self.wait_for("followed")

    def test_one_subject(self):
        self.start("max_subjects = 1\n")
        self.wait_for("followed")
        self.done("subjects", "name", "1", "Anna")
        self.done("subjects", "ignore", "1")
        self.wait_for("ignored")
        self.assertEqual(self.followed_in_status(), [])
        self.done("subjects", "follow", "--all")
        self.assertEqual(self.wait_for("followed")["name"], "Anna")
        self.assertEqual([s["name"] for s in self.followed_in_status()], ["Anna"])


if __name__ == "__main__":
    BUILD = Path(sys.argv.pop(1))
    unittest.main()
