#!/usr/bin/python3
"""Checks every command line that README and docs show.   usage: docs_commands_test.py BUILD_FOLDER

Commands of Kinevox must exist and have the options that the line and its comment name. Other lines must be of a known
program. Three tasks are run as written: process videos, stream a knee angle into Python, calibrate with a board.
"""
import re
import shlex
import subprocess
import sys
import tempfile
import unittest
from functools import cache
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
BUILD = Path(sys.argv.pop(1) if len(sys.argv) > 1 else REPOSITORY / "build/release").resolve()
sys.path.insert(0, str(REPOSITORY / "tests/support"))
from studio_daemon import StudioDaemon  # noqa: E402

PAGES = [
    REPOSITORY / "README.md",
    REPOSITORY / "CONTRIBUTING.md",
    REPOSITORY / "SECURITY.md",
    REPOSITORY / "client/python/README.md",
    *sorted(page for page in (REPOSITORY / "docs").glob("*.md") if page.name not in ("vocabulary.md", "api.md")),
]
KINEVOX = BUILD / "client/cli/kinevox"
PROGRAMS = {
    "kinevox": KINEVOX,
    "kinevoxd": BUILD / "server/daemon/kinevoxd",
    "kinevox-bridge": BUILD / "client/bridge/kinevox-bridge",
    "kinevox-web": BUILD / "client/web/kinevox-web",
    "kinevox-viewer": BUILD / "client/viewer/kinevox-viewer",
}
# First words of lines that are no commands of Kinevox; not checked further.
OTHER_PROGRAMS = (
    "apt apt-get chromium cmake ctest curl export find git journalctl ninja openssl pip podman prometheus python3 sbatch "
    "g++ scp source sudo systemctl"
).split()
OPTION = re.compile(r"(?<![\w-])(--[a-z][a-z0-9-]*)")


def lines_of(page):
    """(number, line) of the indented and fenced blocks, continued lines joined."""
    fenced, joined, start = False, "", 0
    for number, line in enumerate(page.read_text().splitlines(), 1):
        if line.startswith("```"):
            fenced = not fenced
        elif fenced or line.startswith("    "):
            start = start if joined else number
            joined += line.strip()
            if joined.endswith("\\"):
                joined = joined[:-1]
                continue
            yield start, joined
        joined = ""


def inline_commands(page):
    """(number, command) of `kinevox ...` in the text."""
    for number, line in enumerate(page.read_text().splitlines(), 1):
        if not line.startswith("    "):
            yield from ((number, command) for command in re.findall(r"`(kinevox(?:d|-[a-z]+)? [^`]+)`", line))


def program_of(word):
    """The key of PROGRAMS for the first word of a line; None for other lines."""
    name = word.rsplit("/", 1)[-1]
    return name if name in PROGRAMS and (word == name or word.startswith("build/release/")) else None


def alternatives(command):
    """ "kinevox replay play | step 10" as two commands, each a list of words; redirections are dropped."""
    first, *rest = (part.strip() for part in re.split(r"\s\|\s", command))
    words = without_redirection(first)
    path = words[: len(command_path(tuple(words)))]
    yield words
    for part in rest:
        if part in ("...", ""):
            continue
        if part.split()[0] in ("sort", "head", "grep", "less", "jq"):
            return  # a pipe
        yield path[:-1] + without_redirection(part)


def without_redirection(text):
    """The words of a shell command up to a redirection."""
    words = shlex.split(text.replace("...", ""), posix=True)
    for i, word in enumerate(words):
        if word[0] in "<>&;" or word in ("2>", ">"):
            return words[:i]
    return words


@cache
def help_of(path):
    """Text of --help of a command, a tuple of words; None if it does not exist."""
    program, *rest = path
    if program == "kinevox-viewer" and not PROGRAMS[program].exists():
        return ""  # built with Qt only
    ran = subprocess.run([PROGRAMS[program], *rest, "--help"], capture_output=True, text=True, timeout=60)
    return ran.stdout + ran.stderr if ran.returncode == 0 else None


@cache
def command_path(words):
    """The words that name the command: program and subcommands, which have a help of their own."""
    path = (program_of(words[0]),)
    for word in words[1:]:
        if not re.fullmatch(r"[a-z][a-z-]*", word) or help_of(path + (word,)) in (None, help_of(path)):
            break
        path += (word,)
    return path


def problem(words, comment=""):
    """What is wrong with a command; None if nothing is."""
    path = command_path(tuple(words))
    if help_of(path) is None:
        return f"{' '.join(path)} --help fails"
    rest = [word for word in words[len(path) :] if not word.startswith("-")]
    if path == ("kinevox",) and rest and rest[0] not in ("VERB", "COMMAND"):
        return f"there is no command `kinevox {rest[0]}`"
    known = set(OPTION.findall(help_of(path))) | set(OPTION.findall(help_of(path[:1]) or "")) | {"--help", "--version"}
    named = [word.split("=")[0] for word in words if word.startswith("--")] + OPTION.findall(comment)
    unknown = [option for option in named if option not in known and help_of(path)]
    return f"{' '.join(path)} has no option {', '.join(unknown)}" if unknown else None


class Commands(unittest.TestCase):
    """Every command line of every page."""

    maxDiff = None

    def check(self, page, number, text):
        command, comment = re.fullmatch(r"(.*?)(?:\s+#(.*))?", text).groups(default="")
        for words in alternatives(command):
            if words:
                if what := problem(words, comment):
                    self.problems.append(f"{page.relative_to(REPOSITORY)}:{number}: {what}")
                self.count += 1

    def test_options_and_commands_exist(self):
        self.problems, self.count = [], 0
        for page in PAGES:
            for number, line in lines_of(page):
                line = re.sub(r"^(sudo |\$ |[A-Z_]+=\S+ )+", "", line)
                first = line.split()[0] if line.split() else ""
                if program_of(first):
                    self.check(page, number, line)
                elif first.startswith(("deploy/", "tests/", "client/", "proto/")) and re.match(r"^[\w./-]+$", first):
                    if not (REPOSITORY / first).exists():
                        self.problems.append(f"{page.relative_to(REPOSITORY)}:{number}: {first} does not exist")
            for number, command in inline_commands(page):
                if re.match(r"kinevox [A-Z]", command) or "..." in command:
                    continue
                try:
                    self.check(page, number, command)
                except ValueError:
                    pass  # half of a quotation
        self.assertEqual(self.problems, [])
        self.assertGreater(self.count, 80, "the pages show fewer commands than expected")

    def test_options_of_other_programs_are_not_ours(self):
        """Guards the lists above: a block that begins with an unknown `kinevox...` program is an error."""
        unknown = []
        for page in PAGES:
            for number, line in lines_of(page):
                first = line.split()[0] if line.split() else ""
                if re.fullmatch(r"kinevox[\w-]*", first) and first not in PROGRAMS:
                    unknown.append(f"{page.name}:{number}: {first}")
        self.assertEqual([line for line in unknown if "kinevox-" in line.split(": ")[1]], [])


def readme_lines(*beginnings):
    """The command lines of README.md that begin so, without comments."""
    lines = [re.sub(r"\s+#.*", "", line) for _, line in lines_of(REPOSITORY / "README.md")]
    found = [line for line in lines if line.startswith(beginnings)]
    if not found:
        raise AssertionError(f"README.md shows no line that begins with {beginnings}")
    return found


class Tasks(unittest.TestCase):
    """The first tasks of a new user, as written."""

    def setUp(self):
        folder = tempfile.TemporaryDirectory(prefix="kinevox-docs-")
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def run_line(self, line, timeout_s=300):
        words = shlex.split(line)
        words[0] = str(KINEVOX)
        ran = subprocess.run(words, cwd=self.folder, capture_output=True, text=True, timeout=timeout_s)
        self.assertEqual(ran.returncode, 0, f"{line}\n{ran.stdout[-500:]}{ran.stderr[-1500:]}")
        return ran.stdout

    def studio(self, *options):
        size = [] if "--size" in options else ["--size", "320x240"]
        self.run_line(shlex.join(["kinevox", "studio", *size, "--background-frames", "4", *options]))

    def test_process_own_videos(self):
        self.studio("--motion", "walk", "--frames", "12", "--no-masks", "--out", "rendered")
        # The session.toml of the README, on these videos and under these names.
        shown = "\n".join(
            line for _, line in lines_of(REPOSITORY / "README.md") if re.match(r"[a-z_]+ = |\[\[camera", line)
        )
        self.assertRegex(
            shown, r'name = "trial"\nfps = .*\ncalibration = .*\n\[\[camera\]\]\nname = .*\nvideo = .*\nbackground = '
        )
        rendered = (self.folder / "rendered/session.toml").read_text()
        for key in re.findall(r"^([a-z_]+) = ", shown, re.MULTILINE):
            if key != "offset_s":
                self.assertRegex(rendered, rf"(?m)^{key} = ", f"the studio's session.toml has no {key}")
        moved = re.sub(r'(?m)^(calibration|video|background) = "', r'\1 = "rendered/', rendered)
        (self.folder / "session.toml").write_text(moved)
        for line in readme_lines("kinevox process "):
            self.run_line(line)
        for file in ("joints.csv", "angles.csv", "coordinates.csv", "volume.csv"):
            self.assertTrue((self.folder / "results" / file).stat().st_size > 100, file)
        self.assertTrue((self.folder / "results/withheld.csv").read_text().startswith("frame,"))
        self.assertEqual(len(list((self.folder / "results/volumes").glob("*.ply"))), 12)
        (self.folder / "other").symlink_to("results")
        for line in readme_lines("kinevox export results", "kinevox report results", "kinevox compare results"):
            self.run_line(line)
        self.assertGreater((self.folder / "trial.c3d").stat().st_size, 1000)
        self.assertGreater((self.folder / "results/report.png").stat().st_size, 10000)

    def test_stream_a_knee_angle_into_python(self):
        daemon = StudioDaemon(str(PROGRAMS["kinevoxd"]), self.folder)
        try:
            block = [line for line in (REPOSITORY / "README.md").read_text().splitlines() if line.startswith("    ")]
            start = next(i for i, line in enumerate(block) if "from kinevox import Client" in line)
            program = "\n".join(line[4:] for line in block[start : start + 3]).replace("host:50770", daemon.address)
            self.assertIn("knee_angle_r", program)
            process = subprocess.Popen(
                ["/usr/bin/python3", "-u", "-c", program],
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                env={"PYTHONPATH": str(BUILD / "client/python"), "PATH": "/usr/bin:/bin"},
            )
            try:
                found = any(re.match(r"-?\d+\.\d+ \[", line) for line, _ in zip(process.stdout, range(200)))
            finally:
                process.kill()
                error = process.communicate()[1]
            self.assertTrue(found, f"no knee angle in 200 frame sets: {error[-1000:]}")
        finally:
            daemon.stop()

    def test_calibrate_with_a_board(self):
        board = "charuco:6x5:160:120:DICT_4X4_100"
        self.studio(
            "--target",
            board,
            "--board-on-floor-frames",
            "4",
            "--frames",
            "60",
            "--fps",
            "3",
            "--size",
            "640x480",
            "--out",
            "board",
        )
        # Intrinsics from the rendered calibration, as from an earlier session.
        self.run_line(
            f"kinevox calibrate extrinsics board/session.toml --board {board} --board-on-floor-frame 2 "
            "--intrinsics board/calibration.toml --out calibration.toml"
        )
        self.assertIn("[cam1]", (self.folder / "calibration.toml").read_text())
        self.assertTrue((self.folder / "calibration.certificate.json").exists())


if __name__ == "__main__":
    unittest.main(verbosity=2)
