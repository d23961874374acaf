#!/usr/bin/env python3
"""`kinevox compare`: what it says of two trials whose difference is known, and user errors.

usage: compare_test.py KINEVOX MAKE_POSED_TRIAL [unittest options]"""
import csv
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
        """Every cell of the second trial's table as `change(column, row, value)` says; rows for which it is None go."""
        file = self.b / name
        header, *rows = csv.reader(file.read_text().splitlines())
        rows = [[cell if i < 2 or not cell else change(header[i], k, float(cell)) for i, cell in enumerate(row)]
                for k, row in enumerate(rows)]
        with file.open("w", newline="") as f:
            csv.writer(f).writerows([header, *rows])

    def table(self, *more):
        out = self.folder / "table.csv"
        done = run(self.a, self.b, "--csv", out, *more)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return {row["name"]: row for row in csv.DictReader(out.read_text().splitlines())}, done.stdout

    def test_a_known_difference_is_told_and_what_was_withheld_is_counted_apart(self):
        self.change("angles.csv", lambda name, k, v: v + (2 if k % 2 else -1) * (name == "knee_flexion_l_deg"))
        self.change("joints.csv", lambda name, k, v: v + 0.003 * (name == "head_top_x") + 0.004 * (name == "head_top_z"))
        table, text = self.table("--out", self.folder / "page.png")
        knee, other, head = table["knee_flexion_l"], table["knee_flexion_r"], table["head_top"]
        compared = [k for k in range(40) if k not in (10, 11, 12)]   # which the first trial withholds
        values = [2 if k % 2 else -1 for k in compared]
        self.assertEqual((knee["unit"], int(knee["frames"]), int(knee["only_a"]), int(knee["only_b"])), ("deg", 37, 0, 3))
        self.assertAlmostEqual(float(knee["mean"]), sum(values) / 37, places=3)
        self.assertAlmostEqual(float(knee["rms"]), math.sqrt(sum(v * v for v in values) / 37), places=3)
        self.assertAlmostEqual(float(knee["max"]), 2, places=3)
        self.assertEqual(float(other["max"]), 0)
        self.assertAlmostEqual(float(head["mean"]), 5, places=2)
        self.assertLess(text.index("knee_flexion_l"), text.index("knee_flexion_r"), "the largest difference comes first")
        page = cv2.imread(str(self.folder / "page.png"))
        self.assertEqual(page.shape[:2], (2338, 1653), "A4 at 200 dpi")

    def test_the_same_numbers_are_the_same(self):
        done = run(self.a, self.a)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertIn("no difference, to the last digit", done.stdout)
        self.assertNotIn("no difference", run(self.a, self.b).stdout, "one withholds three frames")

    def test_user_errors_are_one_line(self):
        other = self.folder / "other"
        shutil.copytree(self.b, other)
        header, *rows = (other / "angles.csv").read_text().splitlines()
        (other / "angles.csv").write_text("\n".join([header, *(f"{1000 + k}," + r.split(",", 1)[1] for k, r in enumerate(rows))]))
        for arguments, words in (([self.a], "required"), ([self.a, "/nowhere"], "/nowhere"), ([self.a, self.folder], "angles.csv"),
                                 ([self.a, other], "no frame in common"), ([self.a, self.b, "--out", "page.gif"], ".png or .pdf"),
                                 ([self.a, self.b, "--csv", "/proc/no.csv"], "/proc/no.csv")):
            with self.subTest(words):
                done = run(*arguments)
                self.assertEqual((done.returncode, len(done.stderr.splitlines())), (1, 1), done.stderr)
                self.assertIn(words, done.stderr)


if __name__ == "__main__":
    KINEVOX, MAKE_TRIAL = sys.argv[1:3]
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
