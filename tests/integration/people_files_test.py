#!/usr/bin/python3
"""Tables of 0, 1, 2 and 4 people with and without names: every export of a single file, report and Python.

usage: people_files_test.py BUILD_FOLDER [unittest options]"""
import csv
import json
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
BUILD = Path(sys.argv.pop(1) if len(sys.argv) > 1 else REPOSITORY / "build/release").resolve()
sys.path[:0] = [str(BUILD / "client/python"), str(REPOSITORY / "tests/support")]
import numpy as np  # noqa: E402
from forked_program import ForkedProgram  # noqa: E402
from motion_files import Bvh, read_c3d, read_mot, read_trc  # noqa: E402

import kinevox  # noqa: E402

REPORT = ForkedProgram(
    REPOSITORY / "server/tools/report/kinevox-report", ["kinevox_report.page", "kinevox_report.trial"]
)
FORMATS = ("trc", "mot", "c3d", "bvh", "csv")
FRAMES = 40
NAMES = ["Anna B.", "", "Jörg/№ $3$", "Anna B."]  # the ids from 1 on
FILES = ["s1_Anna_B_", "s2", "s3_Jörg_№__3_", "s4_Anna_B_"]


class PeopleFiles(unittest.TestCase):
    def setUp(self):
        self.folder = Path(tempfile.mkdtemp(prefix="kinevox-people-"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def people(self, count, names=()):
        folder = self.folder / f"{count}{'_named' if names else ''}"
        subprocess.run([BUILD / "tests/make_posed_trial", folder, "people", str(count), *names], check=True)
        return folder

    def export(self, *words):
        return subprocess.run(
            [BUILD / "server/tools/kinevox-export", *map(str, words)], capture_output=True, text=True, timeout=60
        )

    def exported(self, trial, form, *more):
        out = self.folder / f"{trial.name}_{form}{len(more)}"
        done = self.export(trial, "--format", form, "--out", out, "--each-subject", "--quiet", *more)
        self.assertEqual((done.returncode, done.stdout, done.stderr), (0, "", ""))
        return {file.name: file for file in out.iterdir()}

    def failed(self, *words):
        done = self.export(*words)
        self.assertEqual((done.returncode, done.stdout, done.stderr.count("\n")), (1, "", 1), done.stderr)
        return done.stderr

    def roots(self, trial):
        """{subject: (frames, 3) m}."""
        roots = {}
        with open(trial / "joints.csv", newline="") as lines:
            for row in csv.DictReader(lines):
                roots.setdefault(int(row["subject"]), []).append([float(row[f"root_{a}"]) for a in "xyz"])
        return {subject: np.array(rows) for subject, rows in roots.items()}

    def root_of(self, file):
        if file.suffix == ".trc":
            trc = read_trc(file)
            x, y, z = (0.001 * trc["points"][:, trc["names"].index("root")]).T
            return np.stack([x, -z, y], 1)
        if file.suffix == ".c3d":
            c3d = read_c3d(file)
            return 0.001 * c3d["points"][:, c3d["parameters"]["POINT"]["LABELS"].index("root")]
        if file.suffix == ".csv":
            with open(file, newline="") as lines:
                return np.array([[float(row[f"root_{a}_m"]) for a in "xyz"] for row in csv.DictReader(lines)])
        return None

    def test_each_subject_has_a_file_in_every_format(self):
        for count in (1, 2, 4):
            trial = self.people(count, NAMES[:count])
            roots = self.roots(trial)
            self.assertEqual(list(roots), list(range(1, count + 1)))
            for form in FORMATS if count == 4 else ("csv",):
                files = self.exported(trial, form)
                self.assertEqual(sorted(files), sorted(f"{name}.{form}" for name in FILES[:count]))
                for subject, name in enumerate(FILES[:count], 1):
                    file = files[f"{name}.{form}"]
                    if form == "bvh":
                        self.assertEqual(len(Bvh(file).motion), FRAMES)
                    elif form == "mot":
                        self.assertEqual(len(read_mot(file)["columns"]["time"]), FRAMES)
                    else:
                        np.testing.assert_allclose(self.root_of(file), roots[subject], rtol=0, atol=2e-5)

    def test_names_are_where_a_format_has_a_place(self):
        trial = self.people(4, NAMES)
        c3d, mot = self.exported(trial, "c3d"), self.exported(trial, "mot")
        for name, file in zip(NAMES, FILES):
            parameters = read_c3d(c3d[f"{file}.c3d"])["parameters"]
            self.assertEqual(parameters.get("SUBJECTS", {}).get("NAMES"), [name] if name else None)
            first = mot[f"{file}.mot"].read_text().splitlines()[0]
            self.assertEqual(first, f"{trial.name}, {name}" if name else trial.name)

    def test_names_change_nothing_else(self):
        named, plain = self.people(2, NAMES[:2]), self.people(2)
        for form in ("trc", "csv", "bvh"):
            ours, theirs = self.exported(named, form), self.exported(plain, form)
            for subject, name in enumerate(FILES[:2], 1):
                text = ours[f"{name}.{form}"].read_text().replace(f"{name}.{form}", f"s{subject}.{form}")
                self.assertEqual(text, theirs[f"s{subject}.{form}"].read_text())

    def test_anonymous_files_have_no_names(self):
        for form in FORMATS:
            files = self.exported(self.people(4, NAMES), form, "--anonymous")
            self.assertEqual(sorted(files), sorted(f"s{n}.{form}" for n in (1, 2, 3, 4)))
            for file in files.values():
                self.assertNotIn(b"Anna", file.read_bytes())

    def test_existing_files_are_replaced_only_on_request(self):
        trial, out = self.people(2), self.folder / "out"
        out.mkdir()
        (out / "notes.txt").write_text("mine")
        words = (trial, "--format", "csv", "--out", out, "--each-subject")
        self.assertIn("--overwrite", self.failed(*words))
        done = self.export(*words, "--overwrite", "--json")
        self.assertEqual((done.returncode, json.loads(done.stdout)["frame_count"]), (0, FRAMES), done.stderr)
        self.assertEqual(sorted(f.name for f in out.iterdir()), ["notes.txt", "s1.csv", "s2.csv"])
        self.assertEqual([f.name for f in self.folder.glob(".*")], [], "no temporary folder is left")

    def test_errors_are_one_line(self):
        two, out = self.people(2), self.folder / "out"
        self.assertIn(
            "no subject has a measured joint",
            self.failed(self.people(0), "--format", "c3d", "--out", out, "--each-subject"),
        )
        self.assertIn("omit --each-subject", self.failed(two, "--anonymous", "--out", out, "--each-subject"))
        self.assertIn("omit --each-subject", self.failed(two, "--format", "ply", "--out", out, "--each-subject"))
        self.assertIn(
            "omit --subject", self.failed(two, "--format", "csv", "--subject", 1, "--out", out, "--each-subject")
        )
        (two / "coordinates.csv").unlink()
        self.assertIn("subject 1: ", self.failed(two, "--format", "bvh", "--out", out, "--each-subject"))
        (two / "subjects.csv").write_text("subject,name\n1,Anna\nBen\n")
        self.assertIn("subjects.csv:3", self.failed(two, "--format", "csv", "--out", out, "--each-subject"))
        self.assertFalse(out.exists())

    def test_report_of_each_has_the_name(self):
        trial = self.people(4, NAMES)
        pages = {}
        for subject in (2, 3):
            done = REPORT.run(trial, "--subject", subject)
            self.assertEqual((done.returncode, done.stderr), (0, ""))
            pages[subject] = (trial / "report.png").read_bytes()
        (trial / "subjects.csv").unlink()
        for subject in (2, 3):
            self.assertEqual(REPORT.run(trial, "--subject", subject).returncode, 0)
            same = (trial / "report.png").read_bytes() == pages[subject]
            self.assertEqual(same, not NAMES[subject - 1], "only a name changes the page")
        (trial / "subjects.csv").write_text("subject,name\nAnna\n")
        done = REPORT.run(trial, "--subject", 1)
        self.assertEqual((done.returncode, done.stderr.count("\n")), (1, 1), done.stderr)
        self.assertIn("subjects.csv", done.stderr)
        empty = REPORT.run(self.people(0))
        self.assertEqual((empty.returncode, empty.stderr.count("\n")), (1, 1), empty.stderr)

    def test_python_reads_everybody(self):
        for count in (0, 1, 2, 4):
            table = kinevox.PoseTable.read(self.people(count, NAMES[:count]))
            self.assertEqual(table.subject_ids, list(range(1, count + 1)))
            self.assertEqual(table.names, {n + 1: name for n, name in enumerate(NAMES[:count]) if name})
            self.assertEqual(len(table), FRAMES * max(count, 1))
            for subject, own in table.by_subject().items():
                self.assertEqual(own.names.get(subject, ""), NAMES[subject - 1])
                self.assertLessEqual(list(own.names), [subject])
                self.assertEqual(len(own), FRAMES)
        plain = self.people(2)
        self.assertEqual(kinevox.PoseTable.read(plain).names, {})
        (plain / "subjects.csv").write_text("id;name\n")
        with self.assertRaisesRegex(kinevox.InvalidArgument, "subjects.csv"):
            kinevox.PoseTable.read(plain)


if __name__ == "__main__":
    unittest.main()
