#!/usr/bin/env python3
"""kinevox-process: files, columns, repeatability, messages.

usage: process_test.py KINEVOX_PROCESS [unittest options]; skips (exit 77) without the shared test data."""
import csv
import os
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
import tomllib
import unittest
from pathlib import Path

PROGRAM = None
REPOSITORY = Path(__file__).resolve().parents[2]
DATA = Path(os.environ.get("KINEVOX_TEST_DATA", REPOSITORY.parent / "shared" / "data"))
WALK = DATA / "studio" / "walk" / "session.toml"
PAIR = DATA / "studio" / "pair" / "session.toml"
FRAMES = 12
SIDED_JOINTS = ("shoulder", "elbow", "wrist", "hand", "hip", "knee", "ankle", "toe")
JOINTS = [
    "root",
    "sacroiliac",
    "skullbase",
    "head_top",
    *(f"{joint}_{side}" for side in "lr" for joint in SIDED_JOINTS),
]
SIDED_ANGLES = ("knee_flexion", "elbow_flexion", "hip_flexion", "hip_abduction", "shoulder_elevation")
ANGLES = [*(f"{angle}_geometric_{side}" for angle in SIDED_ANGLES for side in "lr"), "trunk_lean_geometric"]
LEG = ("hip_flexion", "hip_adduction", "hip_rotation", "knee_angle", "ankle_angle")
ARM = ("arm_flex", "arm_add", "arm_rot", "elbow_flex", "wrist_flex")
COORDINATES = [
    *(f"pelvis_{axis}_m" for axis in "xyz"),
    *(
        f"{name}_deg"
        for name in (
            "pelvic_tilt",
            "pelvic_obliquity",
            "pelvic_rotation",
            "lumbar_extension",
            "lumbar_bending",
            "lumbar_rotation",
            "neck_extension",
            "neck_bending",
            "neck_rotation",
            *(f"{name}_{side}" for side in "lr" for name in LEG + ARM),
        )
    ),
]
COLUMNS = {
    "volume.csv": "frame,subject,voxel_mm,voxels,volume_litres,min_x,min_y,min_z,max_x,max_y,max_z",
    "timing.csv": "frame,segmentation_ms,tracking_ms,hull_ms,colouring_ms,pose_ms,total_ms",
    "track.csv": "frame,time_s,subject,centre_x_m,centre_y_m,centre_z_m,centre_std_m,used_camera_count",
    "silhouette_iou.csv": "frame,subject,cam1,cam2,cam3,cam4",
    "events.csv": "frame,time_s,subject,kind,camera,message",
    "withheld.csv": "frame,time_s,subject,name,reason",
    "joints.csv": "frame,time_s,subject," + ",".join(f"{joint}_{axis}" for joint in JOINTS for axis in "xyz"),
    "angles.csv": "frame,time_s,subject," + ",".join(f"{angle}_deg" for angle in ANGLES),
    "coordinates.csv": "frame,time_s,subject," + ",".join(COORDINATES),
    "uncertainty.csv": "frame,time_s,subject,"
    + ",".join(
        [f"{joint}_std_m,{joint}_camera_count" for joint in JOINTS]
        + [f"{angle}_std_deg,{angle}_camera_count" for angle in ANGLES]
        + [f"{c.rpartition('_')[0]}_std_{c.rpartition('_')[2]}" for c in COORDINATES]
    ),
}


def rows_of(file):
    with open(file, newline="") as f:
        return list(csv.DictReader(f))


def run(*arguments):
    return subprocess.run([PROGRAM, *map(str, arguments)], capture_output=True, text=True, timeout=300)


class Process(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.shared = Path(tempfile.mkdtemp(prefix="kinevox-process-"))
        cls.addClassCleanup(shutil.rmtree, cls.shared, ignore_errors=True)

    def setUp(self):
        self.folder = Path(tempfile.mkdtemp(prefix="kinevox-process-"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def process(self, name, *more, frames=FRAMES):
        done = run(WALK, "--out", self.folder / name, "--frames", frames, "--quiet", *more)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(done.stdout + done.stderr, "", "--quiet")
        return self.folder / name

    def results(self):
        """The walk with all results, computed once; tests only read them."""
        out = self.shared / "out"
        return out if out.exists() else self.process(out, "--save", "silhouettes,volumes,hulls", "--threads", 4)

    def test_rules_select_the_subjects(self):
        """The second person of the pair stands in the keep-out region, and hides and touches the first one."""
        config = self.folder / "config.toml"
        tracked = {}
        for name, rules in (
            ("both", ""),
            ("one", "keep_out_region = [{ corners_m = [[-3, -3], [3, -3], [3, -0.4], [-3, -0.4]] }]\n"),
        ):
            config.write_text(f"[tracking]\nmax_subjects = 2\n{rules}")
            options = ("--config", config, "--no-pose", "--frames", FRAMES, "--quiet")
            done = run(PAIR, "--out", self.folder / name, *options)
            self.assertEqual(done.returncode, 0, done.stderr)
            tracked[name] = rows_of(self.folder / name / "track.csv")
        self.assertEqual({row["subject"] for row in tracked["both"]}, {"1", "2"})
        self.assertEqual(len(tracked["one"]), FRAMES)
        self.assertEqual(len({row["subject"] for row in tracked["one"]}), 1)
        for row in tracked["one"]:
            self.assertGreater(float(row["centre_y_m"]), -0.3)

    def test_writes_the_documented_files(self):
        out = self.results()
        for name, columns in COLUMNS.items():
            self.assertEqual((out / name).read_text().splitlines()[0], columns, name)
        for name in ("volume.csv", "timing.csv", "track.csv"):
            rows = rows_of(out / name)
            self.assertEqual([int(r["frame"]) for r in rows], list(range(FRAMES)), name)
            self.assertTrue(all(v != "" for r in rows for v in r.values()), name)
        for camera in ("cam1", "cam2", "cam3", "cam4"):
            images = sorted(p.name for p in (out / "silhouettes" / camera).iterdir())
            self.assertEqual(images, [f"{n:06d}.png" for n in range(FRAMES)])
        header = (out / "silhouettes" / "cam2" / "000003.png").read_bytes()[:24]
        self.assertEqual(struct.unpack(">II", header[16:24]), (640, 480), "the camera's full image")
        for kind in ("volumes", "hulls"):
            self.assertEqual(sorted(p.name for p in (out / kind).iterdir()), [f"{n:06d}.ply" for n in range(FRAMES)])
            self.assertTrue((out / kind / "000000.ply").read_bytes().startswith(b"ply\n"))
        self.assertEqual([p.name for p in out.iterdir() if p.name.startswith(".")], [], "no partial file is left")

    def test_volume_is_a_persons(self):
        out = self.results()
        for row in rows_of(out / "volume.csv"):
            r = {k: float(v) for k, v in row.items()}
            self.assertEqual(r["voxel_mm"], 10)
            self.assertAlmostEqual(r["voxels"] * 1e-3, r["volume_litres"], delta=0.01)
            self.assertTrue(50 < r["volume_litres"] < 150, row)
            self.assertLess(r["min_z"], 0.15, row)
            self.assertTrue(1.6 < r["max_z"] < 2.0, row)
        for row in rows_of(out / "timing.csv"):
            r = {k: float(v) for k, v in row.items()}
            stages = sum(r[k] for k in r if k not in ("frame", "total_ms"))
            self.assertLessEqual(stages, r["total_ms"] + 0.01)

    def test_pose_is_in_the_room(self):
        out = self.results()
        rows = rows_of(out / "joints.csv")
        self.assertEqual([int(r["frame"]) for r in rows], list(range(FRAMES)))
        for row in rows:
            self.assertTrue(0.7 < float(row["root_z"]) < 1.1, row)
            self.assertTrue(1.5 < float(row["head_top_z"]) < 1.95, row)
        for row in rows_of(out / "angles.csv"):
            self.assertTrue(0 <= float(row["knee_flexion_geometric_l_deg"]) < 60, row)

    def test_reports_uncertainty_and_input(self):
        out = self.results()
        joints, angles = rows_of(out / "joints.csv"), rows_of(out / "angles.csv")
        coordinates, uncertainty = rows_of(out / "coordinates.csv"), rows_of(out / "uncertainty.csv")
        withheld = {(r["frame"], r["name"]) for r in rows_of(out / "withheld.csv")}
        for n in range(FRAMES):
            for joint in JOINTS:
                self.assertTrue(0 < float(uncertainty[n][f"{joint}_std_m"]), joint)
                self.assertEqual(joints[n][f"{joint}_x"] == "", (str(n), joint) in withheld, joint)
            for angle in ANGLES:
                self.assertTrue(0 <= int(uncertainty[n][f"{angle}_camera_count"]) <= 4, angle)
                self.assertEqual(angles[n][f"{angle}_deg"] == "", (str(n), angle) in withheld, angle)
            if coordinates[n]["pelvis_x_m"]:
                self.assertEqual(coordinates[n]["pelvis_x_m"], joints[n]["root_x"])
        run = tomllib.loads((out / "run.toml").read_text())
        self.assertEqual((run["session"], run["fps"], run["frame_count"]), (str(WALK.absolute()), 30, FRAMES))
        self.assertEqual((run["loose_threshold"], run["filter_cutoff_hz"]), (0.3, 6))
        cameras = tomllib.loads((out / "calibration.toml").read_text())
        self.assertEqual([cameras[f"cam{n}"]["size"] for n in range(1, 5)], [[640, 480]] * 4)
        self.assertGreater(tomllib.loads((out / "body.toml").read_text())["thigh_m"], 0.3)
        self.assertEqual((out / "body_1.toml").read_bytes(), (out / "body.toml").read_bytes())
        self.assertEqual({r["subject"] for r in joints + angles + rows_of(out / "track.csv")}, {"1"})

    def test_every_nth_frame_set_keeps_its_number_and_time(self):
        out = self.process("out", "--every", 3, frames=5)
        rows = rows_of(out / "joints.csv")
        self.assertEqual([int(r["frame"]) for r in rows], [0, 3, 6, 9, 12])
        self.assertAlmostEqual(float(rows[3]["time_s"]), 9 / 30, delta=1e-3)
        run = tomllib.loads((out / "run.toml").read_text())
        self.assertEqual((run["fps"], run["frame_count"]), (10, 5))

    def test_results_do_not_depend_on_threads(self):
        runs = [self.process("one", "--save", "silhouettes,volumes,hulls", "--threads", 1), self.results()]
        files = sorted(p.relative_to(runs[0]) for p in runs[0].rglob("*") if p.is_file())
        self.assertEqual(files, sorted(p.relative_to(runs[1]) for p in runs[1].rglob("*") if p.is_file()))
        for file in files:
            if file.name != "timing.csv":
                self.assertEqual((runs[0] / file).read_bytes(), (runs[1] / file).read_bytes(), file)

    def test_without_pose_replaces_all_results_of_an_earlier_run(self):
        out = shutil.copytree(self.results(), self.folder / "out")
        done = run(WALK, "--out", out, "--frames", FRAMES, "--voxel-mm", 20)
        self.assertEqual((done.returncode, done.stderr.count("\n")), (1, 1), done.stderr)
        self.assertIn("--overwrite", done.stderr)
        self.assertTrue((out / "volumes").exists())
        self.process("out", "--voxel-mm", 20, "--no-pose", "--overwrite")
        for name in ("volumes", "hulls", "joints.csv", "angles.csv", "coordinates.csv", "body.toml", "body_1.toml"):
            self.assertFalse((out / name).exists(), f"{name} of the earlier run next to new tables")
        self.assertTrue((out / "run.toml").exists())
        self.assertEqual({r["voxel_mm"] for r in rows_of(out / "volume.csv")}, {"20"})

    def test_interrupt_leaves_no_partial_results(self):
        out = self.folder / "out"
        program = subprocess.Popen(
            [PROGRAM, WALK, "--out", out, "--save", "volumes"],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        partial = out / ".kinevox-partial"
        deadline = time.time() + 60
        while not any(partial.glob("*/volumes/*.ply")) and program.poll() is None and time.time() < deadline:
            time.sleep(0.01)
        program.send_signal(signal.SIGINT)
        _, errors = program.communicate(timeout=30)
        self.assertEqual(program.returncode, 1)
        self.assertRegex(errors, r"stopped after \d+ frame sets; nothing was written\n$")
        self.assertFalse(out.exists())

    def test_tpose_without_a_person_is_an_error(self):
        lines = ['name = "empty"', "fps = 30.0", f'calibration = "{WALK.parent / "calibration.toml"}"']
        for camera in ("cam1", "cam2", "cam3", "cam4"):
            empty = WALK.parent / "background" / f"{camera}.mp4"
            lines += ["[[camera]]", f'name = "{camera}"', f'video = "{empty}"', f'background = "{empty}"']
        empty = self.folder / "empty.toml"
        empty.write_text("\n".join(lines) + "\n")
        done = run(WALK, "--out", self.folder / "out", "--frames", 2, "--tpose", empty)
        self.assertEqual(done.returncode, 1)
        self.assertEqual(done.stderr.count("\n"), 1, done.stderr)
        self.assertIn("empty.toml: no person's pose was found in 0 frame sets", done.stderr)
        self.assertFalse((self.folder / "out").exists())

    def test_tpose_with_poor_silhouettes_is_not_used(self):
        # The light has changed since its background was recorded.
        tpose = DATA / "balancing" / "session_tpose.toml"
        out = self.folder / "out"
        done = run(WALK, "--out", out, "--frames", 8, "--quiet", "--single-run", "--tpose", tpose)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertRegex(
            done.stderr,
            r"session_tpose\.toml: the fitted body is \d+ mm from the silhouettes' contours \(at most 25\); "
            r"record a background for this session; the body is fitted to the movement instead\n$",
        )
        self.assertTrue((out / "body.toml").exists())

    def test_known_body_and_stature_are_used(self):
        read = lambda out: tomllib.loads((out / "body.toml").read_text())
        measured, given = self.folder / "measured", self.folder / "given"
        done = run(WALK, "--out", measured, "--frames", FRAMES, "--quiet", "--stature", 1.85)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertAlmostEqual(read(measured)["stature_m"], 1.85, delta=0.015)
        done = run(WALK, "--out", given, "--frames", 2, "--quiet", "--body", measured / "body.toml")
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(read(given), read(measured))

    def test_errors_are_one_line(self):
        table = [
            (["--out", "x"], "SESSION"),
            ([WALK], "--out"),
            ([WALK, "--out", self.folder / "x", "--bogus"], "--bogus"),
            ([WALK, "--out", self.folder / "x", "--stature", "18"], "stature"),
            ([WALK, "--out", self.folder / "x", "--body", "/nowhere/body.toml"], "/nowhere/body.toml"),
            ([WALK, "--out", self.folder / "x", "--voxel-mm", "0"], "voxel-mm"),
            ([WALK, "--out", self.folder / "x", "--save", "everything"], "everything"),
            (["/nowhere/session.toml", "--out", self.folder / "x"], "/nowhere/session.toml"),
            ([WALK, "--out", "/proc/nothing/x"], "/proc/nothing/x"),
            ([WALK, "--out", WALK], "session.toml"),
        ]
        for arguments, names in table:
            done = run(*arguments)
            self.assertEqual(done.returncode, 1, arguments)
            self.assertEqual(done.stderr.count("\n"), 1, (arguments, done.stderr))
            self.assertIn(names, done.stderr, arguments)
        self.assertFalse((self.folder / "x").exists())


if __name__ == "__main__":
    PROGRAM = sys.argv.pop(1)
    if not WALK.exists():
        print(f"skipped: {WALK} is not here; set KINEVOX_TEST_DATA to the folder that holds studio/walk")
        sys.exit(77)
    unittest.main()
