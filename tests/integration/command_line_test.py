#!/usr/bin/python3
"""What every command of every program keeps to: help, --json, exit status, suggestions and files that are not replaced.

usage: command_line_test.py BUILD_FOLDER [unittest options]"""
import json
import re
import subprocess
import sys
import tempfile
import unittest
from functools import cache
from pathlib import Path

BUILD = Path(sys.argv.pop(1)).resolve()
KINEVOX = BUILD / "client/cli/kinevox"
PROGRAMS = [
    BUILD / "server/daemon/kinevoxd",
    BUILD / "client/bridge/kinevox-bridge",
    BUILD / "client/web/kinevox-web",
    BUILD / "client/viewer/kinevox-viewer",  # without a display
]


def run(*words):
    return subprocess.run([*map(str, words)], capture_output=True, text=True, timeout=60)


@cache
def help_of(*words):
    done = run(*words, "--help")
    return done.stdout if done.returncode == 0 else None


def subcommands(text):
    found = []
    for heading in ("Subcommands", "Daemon", "Files"):
        for section in re.findall(rf"^{heading}:\n((?:  .*\n)+)", text, re.MULTILINE):
            found += re.findall(r"^  ([a-z][a-z-]*) ", section, re.MULTILINE)
    return found


def commands(*path):
    """Every command below a program, as tuples of words; those without subcommands."""
    text = help_of(*path)
    local = re.search(r"Local commands \(no daemon\): (.*)\. See", " ".join(text.split()))
    names = subcommands(text) + (local[1].split(", ") if local else [])
    # `kinevox-web` and others are programs of their own, which `kinevox web` would start.
    names = [name for name in names if name not in ("bridge", "web", "viewer")]
    if not names:
        yield path
    for name in names:
        yield from commands(*path, name)


class EveryCommand(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.commands = list(commands(KINEVOX))

    def test_all_are_found(self):
        names = {" ".join(command[1:]) for command in self.commands}
        self.assertGreater(len(names), 55)
        for name in ("status", "record delete", "calibrate check", "calibrate apply", "token list", "tls issue client"):
            self.assertIn(name, names)
        for name in ("process", "export", "report", "compare", "sync", "studio"):
            self.assertIn(name, names)
        for name in ("devices", "discover", "doctor", "bug-report"):
            self.assertIn(name, names)

    def test_help_documents_the_exit_status(self):
        for command in [*self.commands, *((program,) for program in PROGRAMS if program.exists())]:
            self.assertIn("Exit status: 0 ", " ".join(help_of(*command).split()), command)

    def test_has_json(self):
        for command in self.commands:
            self.assertIn("--json", help_of(*command), command)

    def test_commands_that_write_or_delete_say_how_to_force_it(self):
        for command in self.commands:
            text = help_of(*command)
            if command[-1] == "delete":
                self.assertIn("--yes", text, command)
            # Into a folder of certificates that are never replaced; into an empty folder.
            if command[1] in ("tls", "studio"):
                continue
            if re.search(r"--(out|plot)\b", text):
                self.assertIn("--overwrite", text, command)


class Devices(unittest.TestCase):
    def test_lists_the_cpu_and_recommends_a_device_that_is_usable(self):
        done = run(KINEVOX, "devices", "--json")
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        devices = json.loads(done.stdout)
        self.assertGreaterEqual(devices["cpu"]["logical_cores"], 1)
        usable = [gpu["device"] for gpu in devices["gpus"] if gpu["usable"]]
        self.assertIn(devices["recommended"], usable or ["cpu"])
        self.assertEqual(bool(devices["gpus"]), devices["cuda"]["problem"] is None)
        table = run(KINEVOX, "devices").stdout
        self.assertRegex(table, r"(?m)^cpu +- +- +(usable|recommended) +\S")
        if not devices["gpus"]:
            self.assertIn(f"no GPU: {devices['cuda']['problem']}; {devices['cuda']['remedy']}", table)


class Mistakes(unittest.TestCase):
    def check(self, expected, *words):
        done = run(*words)
        self.assertEqual((done.returncode, done.stdout), (1, ""), words)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        self.assertIn(expected, done.stderr)

    def test_mistyped_options_get_a_suggestion(self):
        for command in commands(KINEVOX):
            self.check("did you mean '--json'?", *command, "--jsno")
        for program in PROGRAMS[:3]:
            self.check("did you mean '--help'?", program, "--hepl")

    def test_mistyped_commands_get_a_suggestion(self):
        for word, meant in (
            ("procss", "process"),
            ("recrod", "record"),
            ("doctro", "doctor"),
            ("calibarte", "calibrate"),
        ):
            self.check(f"did you mean '{meant}'?", KINEVOX, word)
        self.check("did you mean 'list'?", KINEVOX, "token", "listt")


class ExistingFiles(unittest.TestCase):
    """Refused before any work, so the inputs need not be readable."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.file = Path(folder.name) / "page.png"
        self.file.write_text("kept")
        (Path(folder.name) / "checked.json").write_text("kept")

    def test_are_not_replaced(self):
        folder, none = self.file.parent, self.file.parent / "none/session.toml"
        rows = [
            ("sync", none, "--plot", self.file),
            ("calibrate", "check", none, "--out", folder / "checked"),
            ("calibrate", "convert", none, "--out", self.file),
            ("report", none, "--out", self.file),
            ("compare", none, none, "--out", self.file),
            ("bug-report", "--out", self.file),
        ]
        for words in rows:
            done = run(KINEVOX, *words)
            self.assertEqual(done.returncode, 1, words)
            self.assertIn("exists", done.stderr)
            self.assertIn("--overwrite", done.stderr, words)
        self.assertEqual({file.read_text() for file in folder.iterdir()}, {"kept"})
        self.assertIn("empty folder", run(KINEVOX, "studio", "--motion", "walk", "--frames", 1, "--out", folder).stderr)


if __name__ == "__main__":
    unittest.main()
