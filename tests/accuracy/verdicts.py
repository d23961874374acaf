#!/usr/bin/env python3
"""Are the verdicts of `kinevox calibrate check` and `refine` right?

check: right calibrations must not be NO-GO, wrong ones not GO. refine: cameras moved by known amounts; the error against the
true extrinsics must not grow, and GO must not follow from cameras moved by more than two centimetres.

usage: verdicts.py --calibrate KINEVOX-CALIBRATE [--check CASE,...|none] [--refine CASE,...|none] [--quick]
Exit status 1 where a verdict is wrong; 77 without the test data."""
import argparse
import json
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from session_data import data_folder  # noqa: E402
from spoiled_sessions import Spoiled, rotation  # noqa: E402

RIGHT = ("walk", "gesture", "signal", "ring8", "martial", "boxing", "exercise", "floor", "sprint", "balancing")


def moved(camera, mm, degrees):
    def change(s):
        axis = np.array([[0.2, 0.97, 0.1], [0.9, -0.3, 0.3], [-0.5, 0.8, 0.3], [0.1, -0.9, 0.4]][camera % 4])
        s.cameras[camera].rotation = rotation(axis / np.linalg.norm(axis), degrees) @ s.cameras[camera].rotation
        step = np.array([0.8, 0.2, -0.5]) / np.linalg.norm([0.8, 0.2, -0.5])
        s.cameras[camera].translation = s.cameras[camera].translation + 1e-3 * mm * step

    return change


def all_moved(mm):
    """Every camera by about `mm`, in its own direction, without rotation."""

    def change(s):
        random = np.random.default_rng(7)
        for camera in s.cameras:
            step = random.normal(size=3)
            camera.translation = camera.translation + 1e-3 * mm * step / np.linalg.norm(step)

    return change


def swapped(s):
    a, b = s.cameras[0], s.cameras[1]
    for key in ("rotation", "translation", "matrix"):
        first, second = getattr(a, key), getattr(b, key)
        setattr(a, key, second), setattr(b, key, first)


def world(turn, scale=1.0, up_m=0.0):
    def change(s):
        for camera in s.cameras:
            camera.rotation = camera.rotation @ turn.T
            camera.translation = scale * camera.translation - camera.rotation @ np.array([0, 0, up_m])

    return change


def mirrored(s):
    """As from a mirrored board: y is inverted; no rotation does this, so the cameras' x is, too."""
    for camera in s.cameras:
        mirror = np.diag([1.0, -1.0, 1.0])
        camera.rotation = np.diag([-1.0, 1.0, 1.0]) @ camera.rotation @ mirror
        camera.translation = np.diag([-1.0, 1.0, 1.0]) @ camera.translation


def focal(camera, factor):
    def change(s):
        for c in s.cameras if camera is None else [s.cameras[camera]]:
            c.matrix[0, 0] *= factor
            c.matrix[1, 1] *= factor

    return change


WRONG = {
    "upside_down": ("walk", world(rotation((1, 0, 0), 180))),
    "tilted_8": ("gesture", world(rotation((0.6, 0.8, 0), 8))),
    "tilted_20": ("boxing", world(rotation((0.9, -0.44, 0), 20))),
    "floor_too_high": ("signal", world(np.eye(3), up_m=0.25)),
    "mirrored": ("walk", mirrored),
    "millimetres": ("walk", world(np.eye(3), 1000)),
    "scale_1.3": ("walk", world(np.eye(3), 1.3)),
    "scale_0.7": ("boxing", world(np.eye(3), 0.7)),
    "swapped": ("signal", swapped),
    "moved_60_1": ("walk", moved(1, 60, 1.0)),
    "moved_150_3": ("boxing", moved(2, 150, 3.0)),
    "rotated_2": ("gesture", moved(0, 0, 2.0)),
    "moved_300": ("exercise", moved(3, 300, 0.0)),
    "all_moved_80": ("walk", all_moved(80)),
    "another_day": ("boxing", all_moved(250)),
    "focal_1.15": ("gesture", focal(1, 1.15)),
    "focal_all_0.8": ("signal", focal(None, 0.8)),
}
REFINE = {
    "walk_exact": ("walk", lambda s: None),
    "walk_5": ("walk", all_moved(5)),
    "walk_20": ("walk", all_moved(20)),
    "walk_60": ("walk", all_moved(60)),
    "boxing_5": ("boxing", all_moved(5)),
    "boxing_20": ("boxing", all_moved(20)),
    "boxing_60": ("boxing", all_moved(60)),
    "balancing": ("balancing", None),
}


def run(*command):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    return done.returncode, done.stdout, done.stderr.strip()


def certificate_of(text):
    start = text.find("{")
    return json.loads(text[start:]) if start >= 0 else {"verdict": "ERROR", "findings": []}


def found_in(certificate):
    return ", ".join(
        f"{f['check']}({f['verdict']}{' ' + f['camera'] if f.get('camera') else ''})"
        for f in certificate["findings"]
        if f["verdict"] != "GO"
    )


def poses_of(file):
    out = {}
    for name, section in tomllib.loads(Path(file).read_text()).items():
        if isinstance(section, dict) and "rotation" in section:
            turn = cv2.Rodrigues(np.array(section["rotation"], float))[0]
            out[name] = turn, -turn.T @ np.array(section["translation"], float)
    return out


def error_mm(found, truth):
    """Mean distance of the camera centres after a rigid alignment with scale."""
    names = sorted(truth)
    a, b = (np.array([p[n][1] for n in names]) for p in (found, truth))
    mean_a, mean_b = a.mean(0), b.mean(0)
    u, s, vt = np.linalg.svd((a - mean_a).T @ (b - mean_b))
    d = np.diag([1, 1, np.sign(np.linalg.det(vt.T @ u.T))])
    turn = vt.T @ d @ u.T
    scale = (s * np.diag(d)).sum() / ((a - mean_a) ** 2).sum()
    return 1000 * np.linalg.norm(scale * (a - mean_a) @ turn.T - (b - mean_b), axis=1).mean()


def session_of(sequence, change, folder):
    if change is None:
        return data_folder() / sequence / "session.toml"
    spoiled = Spoiled(sequence, Path(folder) / "session")
    change(spoiled)
    return spoiled.write()


def check(program, name, sequence, change, right):
    with tempfile.TemporaryDirectory() as folder:
        if right:
            session = data_folder() / (sequence if sequence == "balancing" else f"studio/{sequence}") / "session.toml"
        else:
            session = session_of(sequence, change, folder)
        _, text, errors = run(program, "check", session, "--json", "--quiet")
    certificate = certificate_of(text)
    verdict = certificate["verdict"]
    wrong = verdict == ("NO-GO" if right else "GO") or (right and verdict == "ERROR")
    stature = certificate.get("stature_m")
    print(
        f"check  {name:16} {sequence:10} {verdict:8} {'' if stature is None else f'{stature:.2f} m':8} "
        f"{found_in(certificate)} {errors if verdict == 'ERROR' else ''}{'   WRONG' if wrong else ''}",
        flush=True,
    )
    return wrong


def refine(program, name, sequence, change):
    with tempfile.TemporaryDirectory() as folder:
        session = session_of(sequence, change, folder)
        truth_file = data_folder() / (f"studio/{sequence}" if change else sequence)
        truth = poses_of(truth_file / ("calibration.toml" if change else "calibration_refined.toml"))
        given = Path(session).parent / "calibration.toml" if change else truth_file / "calibration_published.toml"
        out = Path(folder) / "refined.toml"
        code, text, errors = run(
            program, "refine", session, "--calibration", given, "--out", out, "--quiet", "--json", "--frame-sets", 40
        )
        certificate = certificate_of(text)
        before = error_mm(poses_of(given), truth)
        after = error_mm(poses_of(out), truth) if out.exists() else before
        if not certificate["findings"] and code != 0:
            certificate["verdict"] = "REFUSED"
    corrected = after != before
    wrong = (change is not None and after > 1.05 * before + 1) or (
        certificate["verdict"] == "GO" and corrected and abs(before - after) > 20
    )
    print(
        f"refine {name:16} {before:8.1f} mm -> {after:8.1f} mm {certificate['verdict']:8} {found_in(certificate)} "
        f"{errors}{'   WRONG' if wrong else ''}",
        flush=True,
    )
    return wrong


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--calibrate", required=True)
    parser.add_argument("--check", default=",".join([*RIGHT, *WRONG]))
    parser.add_argument("--refine", default=",".join(REFINE))
    parser.add_argument("--quick", action="store_true", help="two right and two wrong calibrations")
    arguments = parser.parse_args()
    if not (data_folder() / "studio").is_dir():
        print("skipped: no test data; set KINEVOX_TEST_DATA")
        return 77
    if arguments.quick:
        arguments.check, arguments.refine = "walk,upside_down,moved_60_1", "none"
    wrong = 0
    for name in arguments.check.split(",") if arguments.check != "none" else []:
        right = name in RIGHT
        sequence, change = (name, None) if right else WRONG[name]
        wrong += check(arguments.calibrate, name, sequence, change, right)
    for name in arguments.refine.split(",") if arguments.refine != "none" else []:
        wrong += refine(arguments.calibrate, name, *REFINE[name])
    print(f"{wrong} wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    sys.exit(main())
