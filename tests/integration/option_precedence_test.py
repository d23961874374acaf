#!/usr/bin/python3
"""Connection options of every kinevox command: command line before environment, before or after the command.

usage: option_precedence_test.py KINEVOX"""
import os
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

KINEVOX = sys.argv.pop(1)
ENVIRONMENT = {k: v for k, v in os.environ.items() if not k.startswith("KINEVOX_")}

# Every command that talks to a daemon, with the arguments it requires.
REQUIRED = {
    "snapshot": ["--out", "never-written"],
    "poses add": ["label"],
    "poses delete": ["label", "--yes"],
    "poses import": ["pose.bvh"],
    "replay open": ["name"],
    "replay seek": ["120"],
    "replay speed": ["2"],
    "calibrate start": ["intrinsics", "--board", "checkerboard:4x7:60"],
    "calibrate show": ["c1"],
    "calibrate apply": ["c1"],
    "calibrate delete": ["c1", "--yes"],
    "calibrate import": ["calibration.toml"],
    "subjects follow": ["1"],
    "subjects ignore": ["1"],
    "subjects name": ["1", "A"],
    "record delete": ["name", "--yes"],
    "record export": ["name", "--format", "trc", "--out", "never-written.trc"],
}


def help_of(*words):
    return subprocess.run(
        [KINEVOX, *words, "--help"], capture_output=True, text=True, env=ENVIRONMENT, timeout=60
    ).stdout


def subcommands(text):
    found = []
    for heading in ("Subcommands", "Daemon"):
        for section in re.findall(rf"^{heading}:\n((?:  .*\n)+)", text, re.MULTILINE):
            found += re.findall(r"^  ([a-z][a-z-]*) ", section, re.MULTILINE)
    return found


def all_commands():
    for name in subcommands(help_of()):
        deeper = subcommands(help_of(name))
        yield from ([name, sub] for sub in deeper) if deeper else [[name]]


class OptionPrecedence(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = tempfile.TemporaryDirectory()
        for name in ("pose.bvh", "calibration.toml"):
            (Path(cls.folder.name) / name).write_text("\n")
        cls.commands = list(all_commands())

    @classmethod
    def tearDownClass(cls):
        cls.folder.cleanup()

    def errors(self, words, **variables):
        ran = subprocess.run(
            [KINEVOX, *words],
            capture_output=True,
            text=True,
            timeout=60,
            cwd=self.folder.name,
            env=ENVIRONMENT | variables,
        )
        self.assertEqual(ran.returncode, 1, f"{words}: {ran.stdout}{ran.stderr}")
        return ran.stderr

    def each(self):
        for command in self.commands:
            yield command, REQUIRED.get(" ".join(command), [])

    def test_every_command_is_listed(self):
        names = {" ".join(command) for command in self.commands}
        self.assertGreater(len(names), 35)
        self.assertLessEqual(set(REQUIRED), names)

    def test_server(self):
        for command, required in self.each():
            self.assertIn("127.0.0.1:1 ", self.errors([*command, *required], KINEVOX_SERVER="127.0.0.1:1"))
            for words in (
                [*command, *required, "--server", "127.0.0.1:2"],
                ["--server=127.0.0.1:2", *command, *required],
            ):
                error = self.errors(words, KINEVOX_SERVER="127.0.0.1:1")
                self.assertIn("127.0.0.1:2 ", error)
                self.assertNotIn("127.0.0.1:1 ", error)

    def test_files(self):
        rows = [("--ca", "KINEVOX_CA"), ("--token-file", "KINEVOX_TOKEN_FILE")]
        for option, variable in rows:
            for command, required in self.each():
                self.assertIn("/nowhere/env", self.errors([*command, *required], **{variable: "/nowhere/env"}))
                for words in (
                    [*command, *required, option, "/nowhere/flag"],
                    [option, "/nowhere/flag", *command, *required],
                ):
                    self.assertIn("/nowhere/flag", self.errors(words, **{variable: "/nowhere/env"}))

    def test_certificate_and_key(self):
        variables = {"KINEVOX_CERTIFICATE": "/nowhere/env.pem", "KINEVOX_KEY": "/nowhere/env-key.pem"}
        self.assertIn("/nowhere/env.pem", self.errors(["status"], **variables))
        self.assertIn("/nowhere/flag.pem", self.errors(["status", "--certificate", "/nowhere/flag.pem"], **variables))
        self.assertIn(
            "/nowhere/flag-key.pem",
            self.errors(
                ["status", "--key", "/nowhere/flag-key.pem"], KINEVOX_CERTIFICATE="", KINEVOX_KEY="/nowhere/env"
            ),
        )

    def test_timeout(self):
        server = {"KINEVOX_SERVER": "127.0.0.1:1"}
        for command, required in self.each():
            self.assertIn("timeout", self.errors([*command, *required], KINEVOX_TIMEOUT="never", **server).lower())
            self.assertIn(
                "127.0.0.1:1 ", self.errors([*command, *required, "--timeout", "2"], KINEVOX_TIMEOUT="never", **server)
            )


if __name__ == "__main__":
    unittest.main()
