#!/usr/bin/env python3
"""kinevox-export: every format read back by an independent reader, and user errors.

usage: export_test.py KINEVOX_EXPORT MAKE_POSED_TRIAL [unittest options]"""
import csv
import json
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np

from motion_files import Bvh, read_c3d, read_mot, read_trc, rotation

EXPORT = MAKE_TRIAL = None
FRAMES, FPS = 40, 50
OPENSIM = np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])  # x, y up, z
BVH = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])  # left, up, forward


def run(*arguments):
    return subprocess.run([EXPORT, *map(str, arguments)], capture_output=True, text=True, timeout=60)


def joints_of(folder):
    """{joint: (frames, 3) m}, NaN where withheld."""
    with open(folder / "joints.csv", newline="") as f:
        rows = list(csv.DictReader(f))
    number = lambda text: float(text) if text else np.nan
    names = [c[:-2] for c in rows[0] if c.endswith("_x")]
    return {n: np.array([[number(r[f"{n}_{a}"]) for a in "xyz"] for r in rows]) for n in names}


class Export(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = Path(tempfile.mkdtemp(prefix="kinevox-export-"))
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)
        cls.whole, cls.gaps = cls.folder / "whole", cls.folder / "gaps"
        subprocess.run([MAKE_TRIAL, cls.whole], check=True)
        subprocess.run([MAKE_TRIAL, cls.gaps, "gaps"], check=True)

    def export(self, trial, kind, *more):
        out = self.folder / f"{trial.name}.{kind}"
        done = run(trial, "--format", kind, "--out", out, "--overwrite", "--quiet", *more)
        self.assertEqual((done.returncode, done.stdout + done.stderr), (0, ""))
        return out

    def close(self, found, expected, tolerance):
        np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance, equal_nan=True)

    def test_trc_has_the_joints_in_opensims_axes(self):
        for trial in (self.whole, self.gaps):
            joints, trc = joints_of(trial), read_trc(self.export(trial, "trc"))
            self.assertEqual((trc["rate"], trc["units"], trc["names"]), (FPS, "mm", list(joints)))
            self.assertEqual(list(trc["frame"]), list(range(1, FRAMES + 1)))
            self.close(trc["time"], np.arange(FRAMES) / FPS, 1e-6)
            for n, name in enumerate(joints):
                self.close(trc["points"][:, n], 1000 * joints[name] @ OPENSIM.T, 1e-3)

    def test_c3d_has_the_joints_and_marks_the_missing(self):
        for trial in (self.whole, self.gaps):
            joints, c3d = joints_of(trial), read_c3d(self.export(trial, "c3d"))
            point = c3d["parameters"]["POINT"]
            self.assertEqual((point["LABELS"], point["UNITS"]), (list(joints), "mm"))
            self.assertEqual((point["FRAMES"], point["RATE"], c3d["header"]["rate"]), (FRAMES, FPS, FPS))
            self.assertEqual(len(point["DESCRIPTIONS"]), len(joints))
            self.assertEqual(c3d["parameters"]["ANALOG"]["USED"], 0)
            self.assertEqual(list(c3d["parameters"]["TRIAL"]["ACTUAL_END_FIELD"]), [FRAMES, 0])
            for n, name in enumerate(joints):
                self.close(c3d["points"][:, n], 1000 * joints[name], 1e-3)
                self.assertEqual(set(c3d["residual"][:, n]), {0.0, -1.0} if np.isnan(joints[name]).any() else {0.0})

    def test_bvh_skeleton_follows_the_joints(self):
        same = {
            "Hips": "root",
            "Spine": "sacroiliac",
            "Head": "skullbase",
            "Head_end": "head_top",
            "LeftUpLeg": "hip_l",
            "LeftLeg": "knee_l",
            "LeftFoot": "ankle_l",
            "LeftFoot_end": "toe_l",
            "RightUpLeg": "hip_r",
            "RightLeg": "knee_r",
            "RightFoot": "ankle_r",
            "RightFoot_end": "toe_r",
        }
        arms = {
            f"{side}{bone}": f"{joint}_{side[0].lower()}"
            for side in ("Left", "Right")
            for bone, joint in {"Arm": "shoulder", "ForeArm": "elbow", "Hand": "wrist", "Hand_end": "hand"}.items()
        }
        joints, bvh = joints_of(self.whole), Bvh(self.export(self.whole, "bvh"))
        self.assertAlmostEqual(bvh.frame_time, 1 / FPS)
        self.assertEqual(len(bvh.motion), FRAMES)
        for frame in range(FRAMES):
            positions = bvh.positions(frame)
            for bone, joint in same.items():
                self.close(positions[bone], 100 * BVH @ joints[joint][frame], 0.005)
            shoulders = {
                s: positions[f"{s}Arm"] - 100 * BVH @ joints[f"shoulder_{s[0].lower()}"][frame]
                for s in ("Left", "Right")
            }
            for bone, joint in arms.items():  # BVH has one clavicle length, so the arm is offset
                lacking = shoulders["Left" if bone.startswith("Left") else "Right"]
                self.assertLess(np.linalg.norm(lacking), 1.2)
                self.close(positions[bone] - lacking, 100 * BVH @ joints[joint][frame], 0.005)
        self.assertLess(np.abs(np.diff(bvh.motion[:, 3:], axis=0)).max(), 60, "angles do not jump")

    def test_bvh_holds_values_only_on_request(self):
        done = run(self.gaps, "--format", "bvh", "--out", self.folder / "x.bvh")
        self.assertEqual((done.returncode, done.stderr.count("\n")), (1, 1))
        self.assertIn("frame 10", done.stderr)
        self.assertFalse((self.folder / "x.bvh").exists())
        bvh = Bvh(self.export(self.gaps, "bvh", "--hold-withheld"))
        self.close(bvh.motion[10:13], bvh.motion[[9, 9, 9]], 0)
        self.assertFalse(np.isnan(bvh.motion).any())

    def test_mot_moves_opensims_model_to_the_joints(self):
        """Forward kinematics by the joints of Rajagopal2016.osim: axes and orders as in that file."""
        for trial in (self.whole, self.gaps):
            joints, mot = joints_of(trial), read_mot(self.export(trial, "mot"))
            self.assertTrue(mot["degrees"])
            c = mot["columns"]
            self.assertTrue(np.isfinite(c["time"]).all())
            measured = [n for n in range(FRAMES) if np.isfinite(joints["root"][n]).all()]
            self.assertEqual([n for n in range(FRAMES) if np.isfinite(c["pelvis_tx"][n])], measured)
            for n in measured:
                if np.isnan([v[n] for v in c.values()]).any():
                    self.assertEqual(n, 20)
                    self.assertEqual([k for k, v in c.items() if np.isnan(v[n])], ["wrist_flex_r"])
                at = {name: OPENSIM @ p[n] for name, p in joints.items()}
                ball = lambda flexion, adduction, axial, side=1: (
                    rotation("Z", c[flexion][n])
                    @ rotation("X", side * c[adduction][n])
                    @ rotation("Y", side * c[axial][n])
                )
                pelvis = ball("pelvis_tilt", "pelvis_list", "pelvis_rotation")
                origin = np.array([c[f"pelvis_t{axis}"][n] for axis in "xyz"])
                hips = origin - pelvis @ np.array([0.056276, 0.07849, 0]) * 1.8 / 1.7
                self.close((at["hip_l"] + at["hip_r"]) / 2, hips, 2e-5)
                thorax = pelvis @ ball("lumbar_extension", "lumbar_bending", "lumbar_rotation")
                along = lambda bone, a, b: self.close(
                    bone @ [0, -1, 0], (at[b] - at[a]) / np.linalg.norm(at[b] - at[a]), 2e-4
                )
                for s, side in (("r", 1), ("l", -1)):
                    thigh = pelvis @ ball(f"hip_flexion_{s}", f"hip_adduction_{s}", f"hip_rotation_{s}", side)
                    along(thigh, f"hip_{s}", f"knee_{s}")
                    along(thigh @ rotation("Z", -c[f"knee_angle_{s}"][n]), f"knee_{s}", f"ankle_{s}")
                    arm = thorax @ ball(f"arm_flex_{s}", f"arm_add_{s}", f"arm_rot_{s}", side)
                    along(arm, f"shoulder_{s}", f"elbow_{s}")
                    along(arm @ rotation("Z", c[f"elbow_flex_{s}"][n]), f"elbow_{s}", f"wrist_{s}")
            steps = np.diff(c["pelvis_rotation"][measured])
            self.assertLess(np.abs(steps).max(), 60, "through 180 deg without a jump")

    def test_csv_names_every_unit_and_no_column_twice(self):
        with open(self.export(self.gaps, "csv"), newline="") as f:
            reader = csv.DictReader(f)
            rows = list(reader)
        self.assertEqual(len(set(reader.fieldnames)), len(reader.fieldnames))
        joints = joints_of(self.gaps)
        self.assertEqual(len(rows), FRAMES)
        for column in list(rows[0])[1:]:
            self.assertTrue(column.endswith(("_s", "_m", "_deg")), column)
        self.assertEqual(float(rows[5]["knee_l_z_m"]), joints["knee_l"][5][2])
        for column in ("knee_l_z_m", "trunk_lean_geometric_deg", "hip_flexion_geometric_l_deg", "hip_flexion_l_deg"):
            self.assertEqual(rows[11][column], "")

    def test_range_and_yaw(self):
        trc = read_trc(self.export(self.whole, "trc", "--range", "10-19", "--yaw", "90"))
        root = joints_of(self.whole)["root"][10:20]
        self.assertEqual(len(trc["points"]), 10)
        self.close(trc["points"][:, 0], 1000 * np.stack([-root[:, 1], root[:, 2], -root[:, 0]], 1), 2e-3)

    def test_json_describes_the_file(self):
        done = run(self.whole, "--format", "csv", "--out", self.folder / "json.csv", "--json")
        summary = json.loads(done.stdout)
        self.assertEqual((summary["frame_count"], summary["rate_hz"], summary["warning"]), (FRAMES, FPS, ""))

    def test_prints_a_summary(self):
        done = run(self.whole, "--format", "mot", "--out", self.folder / "said.mot")
        self.assertRegex(done.stdout, r"^40 frames at 50 Hz in .*said\.mot; pelvis_rotation ranges from \d+ to \d+ deg")

    def test_existing_file_is_kept_without_overwrite(self):
        out = self.folder / "mine.trc"
        out.write_text("mine")
        done = run(self.whole, "--format", "trc", "--out", out)
        self.assertEqual((done.returncode, done.stderr.count("\n"), out.read_text()), (1, 1, "mine"))
        self.assertIn("--overwrite", done.stderr)

    def test_errors_are_one_line(self):
        empty = self.folder / "empty"
        empty.mkdir()
        out = ["--out", self.folder / "never"]
        table = [
            ([], "PATH"),
            ([self.whole], "--format"),
            ([self.whole, "--format", "fbx", *out], "fbx"),
            ([self.whole, "--format", "trc"], "--out"),
            ([self.whole, "--format", "trc", "--out", "x/"], "--out"),
            (["/nowhere", "--format", "trc", *out], "/nowhere"),
            ([empty, "--format", "trc", *out], "joints.csv"),
            ([self.whole, "--format", "trc", "--out", "/proc/nothing/x"], "/proc/nothing/x"),
            ([self.whole, "--format", "trc", *out, "--range", "9-3"], "9-3"),
            ([self.whole, "--format", "trc", *out, "--range", "90-93"], "90"),
            ([self.whole, "--format", "trc", *out, "--yaw", "north"], "north"),
        ]
        for arguments, names in table:
            done = run(*arguments)
            self.assertEqual((done.returncode, done.stdout), (1, ""), arguments)
            self.assertEqual(done.stderr.count("\n"), 1, (arguments, done.stderr))
            self.assertIn(names, done.stderr, arguments)
        self.assertFalse((self.folder / "never").exists())


if __name__ == "__main__":
    EXPORT, MAKE_TRIAL = sys.argv.pop(1), sys.argv.pop(1)
    unittest.main()
