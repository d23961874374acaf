#!/usr/bin/env python3
"""`kinevox compare`: two trials with a known difference, different numbering, and user errors.

usage: compare_test.py KINEVOX MAKE_POSED_TRIAL [unittest options]"""
import csv
import json
import math
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import cv2

KINEVOX = MAKE_TRIAL = None


def run(*arguments):
    return subprocess.run([KINEVOX, "compare", *map(str, arguments)], capture_output=True, text=True, timeout=120)


class Compare(unittest.TestCase):
    def setUp(self):
        self.folder = Path(tempfile.mkdtemp(prefix="kinevox-compare-"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        self.a, self.b = self.folder / "a", self.folder / "b"
        for trial, gaps in ((self.a, ["gaps"]), (self.b, [])):
            subprocess.run([MAKE_TRIAL, trial, *gaps], check=True)

    def change(self, name, change):
        """Replaces every value of the second trial's table by change(column, row, value)."""
        file = self.b / name
        header, *rows = csv.reader(file.read_text().splitlines())
        rows = [
            [cell if i < 3 or not cell else change(header[i], k, float(cell)) for i, cell in enumerate(row)]
            for k, row in enumerate(rows)
        ]
        with file.open("w", newline="") as f:
            csv.writer(f).writerows([header, *rows])

    def table(self, *more):
        out = self.folder / "table.csv"
        done = run(self.a, self.b, "--csv", out, *more)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return {row["name"]: row for row in csv.DictReader(out.read_text().splitlines())}, done.stdout

    def test_known_difference_is_reported_and_withheld_values_are_counted(self):
        self.change(
            "angles.csv", lambda name, k, v: v + (2 if k % 2 else -1) * (name == "knee_flexion_geometric_l_deg")
        )
        self.change(
            "joints.csv", lambda name, k, v: v + 0.003 * (name == "head_top_x") + 0.004 * (name == "head_top_z")
        )
        table, text = self.table("--out", self.folder / "page.png")
        knee, other, head = table["knee_flexion_geometric_l"], table["knee_flexion_geometric_r"], table["head_top"]
        compared = [k for k in range(40) if k not in (10, 11, 12)]  # which the first trial withholds
        values = [2 if k % 2 else -1 for k in compared]
        self.assertEqual(
            (knee["unit"], int(knee["frames"]), int(knee["only_a"]), int(knee["only_b"])), ("deg", 37, 0, 3)
        )
        self.assertAlmostEqual(float(knee["mean"]), sum(values) / 37, places=3)
        self.assertAlmostEqual(float(knee["rms"]), math.sqrt(sum(v * v for v in values) / 37), places=3)
        self.assertAlmostEqual(float(knee["max"]), 2, places=3)
        self.assertEqual(float(other["max"]), 0)
        self.assertAlmostEqual(float(head["mean"]), 5, places=2)
        self.assertLess(
            text.index("knee_flexion_geometric_l"),
            text.index("knee_flexion_geometric_r"),
            "the largest difference comes first",
        )
        page = cv2.imread(str(self.folder / "page.png"))
        self.assertEqual(page.shape[:2], (2338, 1653), "A4 at 200 dpi")

    def test_identical_trials_are_identical(self):
        done = run(self.a, self.a)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertIn("identical to the last digit", done.stdout)
        self.assertTrue(json.loads(run(self.a, self.a, "--json").stdout)["identical"])
        self.assertNotIn("identical", run(self.a, self.b).stdout, "one withholds three frames")

    def shifted(self, name, by_frames, by_s=0.0):
        """A copy of the second trial with other frame numbers and times."""
        other = self.folder / name
        shutil.copytree(self.b, other)
        for table in ("angles.csv", "joints.csv"):
            header, *rows = csv.reader((other / table).read_text().splitlines())
            with (other / table).open("w", newline="") as f:
                csv.writer(f).writerows(
                    [header, *([int(r[0]) + by_frames, f"{float(r[1]) + by_s:.6f}", *r[2:]] for r in rows)]
                )
        return other

    def test_trials_are_matched_by_time(self):
        self.assertIn("30 frames in both, 20 in only one", run(self.b, self.shifted("later", 10, 10 / 50)).stdout)
        done = run(self.b, self.shifted("renumbered", 10))
        self.assertEqual((done.returncode, len(done.stderr.splitlines())), (1, 1), done.stderr)
        self.assertIn("has frame 0, but", done.stderr)

    def test_existing_files_are_kept_without_overwrite(self):
        out = self.folder / "table.csv"
        out.write_text("mine")
        done = run(self.a, self.b, "--csv", out)
        self.assertEqual((done.returncode, out.read_text()), (1, "mine"))
        self.assertIn("--overwrite", done.stderr)
        self.assertEqual(run(self.a, self.b, "--csv", out, "--overwrite").returncode, 0)

    def test_user_errors_are_one_line(self):
        other = self.shifted("other", 1000, 1000.0)
        for arguments, words in (
            ([self.a], "required"),
            ([self.a, "/nowhere"], "/nowhere"),
            ([self.a, self.folder], "angles.csv"),
            ([self.a, other], "no time in common"),
            ([self.a, self.b, "--out", "page.gif"], ".png or .pdf"),
            ([self.a, self.b, "--csv", "/proc/no.csv"], "/proc/no.csv"),
        ):
            with self.subTest(words):
                done = run(*arguments)
                self.assertEqual((done.returncode, len(done.stderr.splitlines())), (1, 1), done.stderr)
                self.assertIn(words, done.stderr)


if __name__ == "__main__":
    KINEVOX, MAKE_TRIAL = sys.argv[1:3]
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
