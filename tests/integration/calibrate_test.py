#!/usr/bin/env python3
"""kinevox calibrate on rendered sessions against ground truth, and user errors.

usage: calibrate_test.py KINEVOX_CALIBRATE KINEVOX_STUDIO [unittest options]"""
import json
import shutil
import subprocess
import sys
import tempfile
import tomllib
import unittest
from pathlib import Path

import cv2
import numpy as np

CALIBRATE = STUDIO = None
BOARD = "charuco:6x5:160:120:DICT_4X4_100"
MAX_CENTRE_MM, MAX_ROTATION_DEG, MAX_SCALE = 5, 0.1, 0.002


def run(*arguments):
    return subprocess.run([CALIBRATE, *map(str, arguments), "--quiet"], capture_output=True, text=True, timeout=240)


def extrinsics_of(file):
    """{camera: (rotation world to camera, centre in the world, m)}"""
    out = {}
    for name, section in tomllib.loads(Path(file).read_text()).items():
        rotation = cv2.Rodrigues(np.array(section["rotation"], float))[0]
        out[name] = rotation, -rotation.T @ np.array(section["translation"], float)
    return out


def errors(found, truth, align):
    """Largest centre error in mm, largest rotation error in degrees, scale error; `align`: the world frame is free."""
    names = sorted(truth)
    a, b = (np.array([p[n][1] for n in names]) for p in (found, truth))
    turn, shift = np.eye(3), np.zeros(3)
    if align:
        u, _, v = np.linalg.svd((b - b.mean(0)).T @ (a - a.mean(0)))
        turn = u @ np.diag([1, 1, np.sign(np.linalg.det(u @ v))]) @ v
        shift = b.mean(0) - turn @ a.mean(0)
    spread = [np.linalg.norm(x - x.mean(0)) for x in (a, b)]
    centre = 1000 * np.linalg.norm(a @ turn.T + shift - b, axis=1).max()
    angles = [np.linalg.norm(cv2.Rodrigues(truth[n][0].T @ found[n][0] @ turn.T)[0]) for n in names]
    return centre, np.degrees(max(angles)), abs(spread[0] / spread[1] - 1)


def matrix_of(world_from_target):
    """m and a rotation vector in degrees, as in truth/target.csv, as a 4 x 4 matrix."""
    x = np.eye(4)
    x[:3, :3] = cv2.Rodrigues(np.radians(world_from_target[3:]))[0]
    x[:3, 3] = world_from_target[:3]
    return x


class Calibrate(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.from_wands = {}
        cls.folder = Path(tempfile.mkdtemp(prefix="kinevox-calibrate-"))
        cls.addClassCleanup(shutil.rmtree, cls.folder, ignore_errors=True)

    def session(self, name, *more, size="640x480"):
        """Rendered once per name, with distortion and noise. Small images are rendered and read faster."""
        folder = self.folder / name
        if not folder.exists():
            subprocess.run(
                [
                    STUDIO,
                    "--size",
                    size,
                    *map(str, more),
                    "--distortion",
                    "0.08",
                    "--background-frames",
                    "3",
                    "--out",
                    folder,
                ],
                check=True,
                capture_output=True,
            )
        return folder

    def board(self):
        return self.session("board", "--target", BOARD, "--board-on-floor-frames", 4, "--frames", 60, "--fps", 3)

    def calibrated(self, verb, *arguments):
        """The calibration file and its certificate."""
        out = self.folder / f"{len(list(self.folder.iterdir()))}.toml"
        done = run(verb, *arguments, "--out", out)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        return out, json.loads(out.with_suffix(".certificate.json").read_text())

    def wand_calibration(self, wand):
        """The session with that wand, its calibration and certificate; computed once."""
        small = {"size": "400x300"} if wand.count(":") > 1 else {}
        folder = self.session(wand.replace(":", "_"), "--target", wand, "--frames", 60, "--fps", 10, **small)
        if wand not in self.from_wands:
            self.from_wands[wand] = self.calibrated("extrinsics", folder / "session.toml", "--wand", wand)
        return folder, *self.from_wands[wand]

    def within_bounds(self, file, truth, align=True):
        centre, turn, scale = errors(extrinsics_of(file), extrinsics_of(truth), align)
        self.assertLess(centre, MAX_CENTRE_MM)
        self.assertLess(turn, MAX_ROTATION_DEG)
        self.assertLess(scale, MAX_SCALE)

    def test_extrinsics_from_a_wand(self):
        for wand in ("wand:200:600", "wand:600"):
            with self.subTest(wand):
                folder, out, certificate = self.wand_calibration(wand)
                self.within_bounds(out, folder / "calibration.toml")
                self.assertEqual((certificate["verdict"], certificate["method"]), ("GO", "extrinsics_wand"))
        # From the clips alone: the background is their median.
        clips = [f"cam{c}={folder / f'cam{c}.mp4'}" for c in range(1, 5)]
        out, _ = self.calibrated("extrinsics", *clips, "--wand", wand, "--intrinsics", folder / "calibration.toml")
        self.within_bounds(out, folder / "calibration.toml")

    def test_extrinsics_from_a_wand_with_a_walking_person(self):
        folder = self.session(
            "walker_with_wand", "--motion", "walk", "--target", "wand:600", "--frames", 80, "--fps", 10, "--no-masks"
        )
        out, certificate = self.calibrated("extrinsics", folder / "session.toml", "--wand", "wand:600")
        self.within_bounds(out, folder / "calibration.toml")
        self.assertNotEqual(certificate["verdict"], "NO-GO")

    def test_extrinsics_from_a_board_on_the_floor_first(self):
        folder = self.board()
        out, certificate = self.calibrated(
            "extrinsics",
            folder / "session.toml",
            "--board",
            BOARD,
            "--board-on-floor-frame",
            2,
            "--intrinsics",
            folder / "calibration.toml",
        )
        self.within_bounds(out, folder / "calibration.toml")
        self.assertTrue(certificate["world_defined"])
        # The true board frame is the world frame.
        row = np.loadtxt(folder / "truth" / "target.csv", delimiter=",", skiprows=1)[2, 2:]
        world_from_board = matrix_of(row)
        truth = {
            name: (rotation @ world_from_board[:3, :3], world_from_board[:3, :3].T @ (centre - world_from_board[:3, 3]))
            for name, (rotation, centre) in extrinsics_of(folder / "calibration.toml").items()
        }
        centre, turn, _ = errors(extrinsics_of(out), truth, align=False)
        self.assertLess(centre, 20)  # the board is small, the cameras are 5 m away
        self.assertLess(turn, 0.3)

    def test_names_a_camera_that_moves_meanwhile(self):
        folder = self.session(
            "bumped", "--target", "wand:200:600", "--frames", 60, "--fps", 10, "--bump", "cam2:3:1", size="400x300"
        )
        _, certificate = self.calibrated("extrinsics", folder / "session.toml", "--wand", "wand:200:600")
        self.assertEqual(certificate["verdict"], "NO-GO")
        self.assertIn(("camera_moved", "cam2"), [(f["check"], f.get("camera")) for f in certificate["findings"]])

    def world_from_truth(self, out, folder):
        """Rotation and shift from the true world to the one of the calibration found."""
        found, truth = extrinsics_of(out)["cam1"], extrinsics_of(folder / "calibration.toml")["cam1"]
        turn = found[0].T @ truth[0]
        return turn, found[1] - turn @ truth[1]

    def test_floor_from_a_board_from_points_and_from_a_person(self):
        folder = self.session("walker", "--motion", "walk", "--frames", 40, "--fps", 4, "--no-masks")
        board, session = self.board(), folder / "session.toml"
        # An arbitrary frame: the calibration contains nothing of the world frame.
        away = self.folder / "away.toml"
        text, turn = (folder / "calibration.toml").read_text(), cv2.Rodrigues(np.array([0.7, -1.9, 0.4]))[0]
        for name, (rotation, centre) in extrinsics_of(folder / "calibration.toml").items():
            new = rotation @ turn.T
            for key, value in (
                ("rotation", cv2.Rodrigues(new)[0].ravel()),
                ("translation", -new @ (turn @ centre + [3, 1, -2])),
            ):
                start = text.index(f"\n{key} ", text.index(f"[{name}]")) + 1
                text = (
                    text[:start]
                    + f"{key} = [{', '.join(f'{v:.12g}' for v in value)}]"
                    + text[text.index("\n", start) :]
                )
        away.write_text(text)
        clicks = []
        for point in ((0, 0, 0), (1, 0, 0), (0, 1, 0), (1, 1, 0)):
            words = ",".join(map(str, point))
            for name, section in tomllib.loads((folder / "calibration.toml").read_text()).items():
                pixel = cv2.projectPoints(
                    np.array([point], float),
                    np.array(section["rotation"]),
                    np.array(section["translation"]),
                    np.array(section["matrix"]),
                    np.array(section["distortions"]),
                )[0].ravel()
                words += f" {name}:{pixel[0]:.1f},{pixel[1]:.1f}"
            clicks += ["--point", words]
        for what, arguments, max_deg, max_mm in (
            ("person", [session, "--calibration", away], 1.5, 30),
            ("points", [away, *clicks], 0.1, 5),
            (
                "board",
                [board / "session.toml", "--calibration", away, "--board", BOARD, "--board-on-floor-frame", 2],
                0.3,
                10,
            ),
        ):
            with self.subTest(what):
                out, certificate = self.calibrated("floor", *arguments)
                turn, shift = self.world_from_truth(out, folder)
                self.assertLess(np.degrees(np.arccos(min(1, turn[2, 2]))), max_deg)
                self.assertLess(abs(1000 * shift[2]), max_mm)
                self.assertEqual((certificate["world_defined"], certificate["floor"]["method"]), (True, what))
                self.assertNotEqual(certificate["verdict"], "NO-GO")
                page = cv2.imread(str(out.with_suffix(".certificate.png")))
                self.assertEqual(page.shape[:2], (2338, 1653), "A4 at 200 dpi")

    def test_floor_keeps_the_extrinsics_certificate(self):
        _, out, before = self.wand_calibration("wand:600")
        session = self.board() / "session.toml"
        _, after = self.calibrated(
            "floor", session, "--calibration", out, "--board", BOARD, "--board-on-floor-frame", 1
        )
        self.assertEqual(
            (after["method"], after["held_out_reprojection_rms_px"]),
            ("extrinsics_wand", before["held_out_reprojection_rms_px"]),
        )
        self.assertEqual(len(after["target_points_m"]), len(before["target_points_m"]))
        self.assertEqual(after["volume"]["lower_m"][2], 0)
        self.assertTrue(after["world_defined"] and not before["world_defined"])

    def test_calibrations_convert_to_other_formats_and_back(self):
        cameras = self.board() / "calibration.toml"
        name = lambda file: self.folder / f"round.{file}"
        for kind, file in (("opencv", name("yml")), ("kalibr", name("yaml")), ("toml", name("export.toml"))):
            for words in (
                ["convert", cameras, "--format", kind, "--out", file],
                ["convert", file, "--out", name("toml"), "--overwrite"],
            ):
                done = subprocess.run([CALIBRATE, *map(str, words)], capture_output=True, text=True, timeout=60)
                self.assertEqual((done.returncode, done.stderr), (0, ""))
            back, there = extrinsics_of(name("toml")), extrinsics_of(cameras)
            if kind == "kalibr":  # names them cam0, cam1, ... and has no world frame
                back = dict(zip(sorted(there), (back[k] for k in sorted(back))))
            centre, turn, scale = errors(back, there, align=kind == "kalibr")
            self.assertLess(max(centre, turn, scale), 1e-6, kind)

    def test_keeps_an_existing_calibration(self):
        cameras = self.board() / "calibration.toml"
        out = self.folder / "existing.toml"
        out.write_text("mine")
        done = run("floor", cameras, "--point", "0,0,0 cam1:1,1", "--out", out)
        self.assertEqual((done.returncode, out.read_text()), (1, "mine"))
        self.assertIn("--overwrite", done.stderr)

    def test_user_errors_are_one_line(self):
        folder = self.board()
        session = folder / "session.toml"
        for arguments, words in (
            (["extrinsics", session], "one of --board, --wand, --person"),
            (["extrinsics", session, "--board", BOARD, "--wand", "wand:600"], "one of --board, --wand, --person"),
            (["extrinsics", session, "--wand", "wand:300:600"], "closer to the first one"),
            (["extrinsics", session, "--wand", "stick:600"], "wand:200:600"),
            (["extrinsics", session, "--wand", "wand:600"], "move it"),
            (
                ["extrinsics", f"cam1={folder / 'cam1.mp4'}", f"cam2={folder / 'cam2.mp4'}", "--wand", "wand:600"],
                "--intrinsics",
            ),
            (["extrinsics", session, "--wand", "wand:600", "--board-on-floor-frame", 3], "calibrate floor"),
            (["floor", folder / "calibration.toml"], "is a calibration"),
            (["floor", session, "--board", BOARD, "--videos", f"cam1={folder / 'cam1.mp4'}"], "--board-on-floor-frame"),
            (["floor", session, "--point", "0,0,0 cam9:1,1"], "cam9"),
            (["floor", session, "--point", "0,0,0 cam1:1,1"], "three or four"),
            (["floor", session, "--board", BOARD, "--point", "0,0,0 cam1:1,1"], "use one of --board"),
            (["floor", session], "record"),
            (["extrinsics", self.folder / "none.toml", "--wand", "wand:600"], "none.toml"),
        ):
            with self.subTest(arguments=arguments[1:]):
                done = run(*arguments, "--out", self.folder / "never.toml")
                self.assertEqual((done.returncode, len(done.stderr.splitlines())), (1, 1), done.stderr)
                self.assertIn(words, done.stderr)
                self.assertFalse((self.folder / "never.toml").exists())


if __name__ == "__main__":
    CALIBRATE, STUDIO = sys.argv[1:3]
    unittest.main(argv=sys.argv[:1] + sys.argv[3:])
