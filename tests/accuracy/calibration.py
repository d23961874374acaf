#!/usr/bin/env python3
"""Calibrations of real recordings against references: intrinsics from seven images of a checkerboard, extrinsics from a
ChArUco board with four webcams (with the reference's intrinsics and with estimated ones), refinement from silhouettes, and
extrinsics from a moving person alone, in the virtual studio (part person) and in the rendered sequences of the test data
(part sequences).

Prints one table; exit status 1 beyond the bounds, 77 if programs or data are missing.
"""
import argparse
import json
import re
import subprocess
import sys
import tempfile
from itertools import combinations
from pathlib import Path

try:
    import cv2
    import numpy as np
    from session_data import REPOSITORY, data_folder, tomllib
except ImportError as missing:
    print(f"skipped: this needs numpy and OpenCV for Python ({missing})")
    sys.exit(77)

RMS_BOUND_PX, FOCAL_BOUND, HELD_OUT_BOUND_PX = 0.30, 0.015, 0.5
CENTRES_BOUND, CENTRES_OWN_BOUND = 0.025, 0.05
PERSON_CENTRE_BOUND_MM, PERSON_ROTATION_BOUND_DEG, PERSON_STATURE_M = 30, 0.5, 1.80
SEQUENCE_STATURE_M = {"gesture": 1.65, "ring8": 1.68, "sprint": 1.83}
BOARD = "charuco:4x5:54:40.5:DICT_4X4_1000:inverted"


def read_cameras(file):
    with open(file, "rb") as f:
        return {name: section for name, section in tomllib.load(f).items() if isinstance(section, dict)}


def centres(file):
    out = {}
    for name, section in read_cameras(file).items():
        rotation = cv2.Rodrigues(np.array(section["rotation"], float))[0]
        out[name] = -rotation.T @ np.array(section["translation"], float)
    return out


def worst_distance(file, reference):
    """The largest relative error of a distance between two camera centres."""
    a, b = centres(file), centres(reference)
    distance = lambda c, pair: np.linalg.norm(c[pair[0]] - c[pair[1]])
    return max(abs(distance(a, pair) / distance(b, pair) - 1) for pair in combinations(sorted(b), 2))


def aligned_errors(file, reference):
    """Largest centre (mm) and rotation (degrees) error after similarity alignment of the centres, and the scale error (%)."""
    solved, true = read_cameras(file), read_cameras(reference)
    names = sorted(true)
    rotation_of = lambda cameras, name: cv2.Rodrigues(np.array(cameras[name]["rotation"], float))[0]
    a, b = centres(file), centres(reference)
    p, q = np.array([a[n] for n in names]), np.array([b[n] for n in names])
    u, d, vt = np.linalg.svd((q - q.mean(0)).T @ (p - p.mean(0)))
    sign = np.array([1, 1, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ np.diag(sign) @ vt
    scale = (d * sign).sum() / ((p - p.mean(0)) ** 2).sum()
    moved = scale * (p - p.mean(0)) @ rotation.T + q.mean(0)
    angles = [
        np.linalg.norm(cv2.Rodrigues(rotation_of(solved, n) @ rotation.T @ rotation_of(true, n).T)[0]) for n in names
    ]
    return 1000 * np.linalg.norm(moved - q, axis=1).max(), np.degrees(max(angles)), 100 * abs(scale - 1)


def without_extrinsics(text):
    """The text of a calibration with its intrinsics only."""
    return re.sub(r"(rotation|translation) = .*", r"\1 = [0.0, 0.0, 0.0]", text)


def forget_extrinsics(session):
    """Keeps only the intrinsics of a session's calibration. Returns the file of the true calibration."""
    true = session.parent / "true.toml"
    text = (session.parent / "calibration.toml").read_text()
    true.write_text(text)
    (session.parent / "calibration.toml").write_text(without_extrinsics(text))
    return true


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--program", required=True, help="kinevox-calibrate")
    parser.add_argument("--studio", help="kinevox-studio, for the part person")
    parser.add_argument("--parts", default="intrinsics,board,refine", help="comma separated; also person, sequences")
    parser.add_argument("--sequences", default="walk,gesture,ring8", help="of the test data, for the part sequences")
    parser.add_argument("--out", help="keep calibrations and certificates here")
    arguments = parser.parse_args()
    data, parts = data_folder(), arguments.parts.split(",")
    for needed in [Path(arguments.program), data / "balancing" / "board", data / "charuco"]:
        if not needed.exists():
            print(
                f"skipped: {needed} does not exist; set KINEVOX_TEST_DATA to the folder that holds balancing/ and charuco/"
            )
            return 77
    failures = []

    def row(what, value, bound, unit, good):
        print(f"| {what} | {value} | {bound} {unit} | {'' if good else 'FAILED'} |", flush=True)
        if not good:
            failures.append(what)

    def calibrate(*words):
        run = subprocess.run(
            [arguments.program, *map(str, words), *([] if words[0] == "check" else ["--overwrite"])],
            capture_output=True,
            text=True,
        )
        if run.returncode != 0:
            sys.exit(f"kinevox-calibrate {' '.join(map(str, words))}\n{run.stderr.strip()}")

    print("| what | measured | bound | |\n| --- | ---: | ---: | --- |")
    with tempfile.TemporaryDirectory() as scratch:
        out = Path(arguments.out or scratch)
        out.mkdir(parents=True, exist_ok=True)
        if "intrinsics" in parts:
            board = data / "balancing" / "board"
            truth = read_cameras(data / "balancing" / "calibration_published.toml")
            clips = [f"{name}={board / name.replace('_', '')}" for name in truth]
            calibrate("intrinsics", *clips, "--board", "checkerboard:4x7:60", "--out", out / "intrinsics.toml")
            solved, certificate = read_cameras(out / "intrinsics.toml"), json.loads(
                (out / "intrinsics.certificate.json").read_text()
            )
            for name, section in truth.items():
                rms = certificate["cameras"][name]["intrinsics"]["rms_px"]
                row(f"{name}: rms", f"{rms:.3f}", RMS_BOUND_PX, "px", rms <= RMS_BOUND_PX)
                focal = max(abs(solved[name]["matrix"][k][k] / section["matrix"][k][k] - 1) for k in (0, 1))
                row(f"{name}: focal length", f"{100 * focal:.2f}", 100 * FOCAL_BOUND, "%", focal <= FOCAL_BOUND)
        if "board" in parts:
            folder = data / "charuco"
            clips = [f"cam_{n}={folder / f'cam_{n}.mp4'}" for n in range(4)]
            for what, more, bound in (
                ("reference intrinsics", ["--intrinsics", folder / "reference.toml"], CENTRES_BOUND),
                ("own intrinsics", [], CENTRES_OWN_BOUND),
            ):
                file = out / (what.replace(" ", "_") + ".toml")
                calibrate("extrinsics", *clips, "--board", BOARD, "--out", file, *more)
                certificate = json.loads(file.with_suffix(".certificate.json").read_text())
                error = worst_distance(file, folder / "reference.toml")
                row(f"{what}: distances between centres, worst", f"{100 * error:.2f}", 100 * bound, "%", error <= bound)
                held_out = certificate["held_out_reprojection_rms_px"]
                if more:
                    row(
                        f"{what}: held-out views",
                        f"{held_out:.3f}",
                        HELD_OUT_BOUND_PX,
                        "px",
                        held_out <= HELD_OUT_BOUND_PX,
                    )
                else:
                    named = sorted({f["camera"] for f in certificate["findings"] if f["check"] == "coverage"})
                    row(
                        "own intrinsics: poorly covered, as the certificate says",
                        " ".join(named) or "none",
                        "one",
                        "",
                        bool(named),
                    )
        if "refine" in parts:
            session = out / "published.toml"
            balancing = data / "balancing"
            text = (
                (balancing / "session.toml")
                .read_text()
                .replace("calibration_refined.toml", "calibration_published.toml")
            )
            for word in ("calibration_published", "trial/", "background/"):
                text = text.replace(f'"{word}', f'"{balancing}/{word}')
            session.write_text(text)
            calibrate("refine", session, "--out", out / "refined.toml")
            hull_iou = {}
            for name, file in (
                ("refined", out / "refined.toml"),
                ("reference", balancing / "calibration_refined.toml"),
            ):
                calibrate("check", session, "--calibration", file, "--out", out / name)
                hull_iou[name] = json.loads((out / f"{name}.json").read_text())["hull_iou"]["mean_iou"]
            row(
                "refined from silhouettes: IoU",
                f"{hull_iou['refined']:.4f}",
                f"{hull_iou['reference']:.4f}",
                "(the reference's)",
                hull_iou["refined"] >= hull_iou["reference"],
            )
        for count in (4, 8) if "person" in parts and arguments.studio else ():
            folder = out / f"person{count}"
            subprocess.run(
                [
                    arguments.studio,
                    "--motion",
                    "walk",
                    "--frames",
                    "200",
                    "--cameras",
                    str(count),
                    "--seed",
                    str(count - 1),
                    "--stature",
                    str(PERSON_STATURE_M),
                    "--no-masks",
                    "--out",
                    folder,
                ],
                check=True,
                capture_output=True,
            )
            true = forget_extrinsics(folder / "session.toml")
            solved = out / f"by_person{count}.toml"
            calibrate("extrinsics", "--person", "--stature", PERSON_STATURE_M, folder / "session.toml", "--out", solved)
            centre, rotation, scale = aligned_errors(solved, true)
            row(
                f"person, {count} cameras: centres (scale off by {scale:.1f} %)",
                f"{centre:.1f}",
                PERSON_CENTRE_BOUND_MM,
                "mm",
                centre <= PERSON_CENTRE_BOUND_MM,
            )
            row(
                f"person, {count} cameras: rotations",
                f"{rotation:.3f}",
                PERSON_ROTATION_BOUND_DEG,
                "degrees",
                rotation <= PERSON_ROTATION_BOUND_DEG,
            )
        for name in arguments.sequences.split(",") if "sequences" in parts else ():
            session, intrinsics = data / "studio" / name / "session.toml", out / f"intrinsics_{name}.toml"
            true = session.parent / "calibration.toml"
            intrinsics.write_text(without_extrinsics(true.read_text()))
            solved = out / f"by_person_{name}.toml"
            calibrate(
                "extrinsics",
                "--person",
                "--stature",
                SEQUENCE_STATURE_M.get(name, PERSON_STATURE_M),
                session,
                "--intrinsics",
                intrinsics,
                "--out",
                solved,
            )
            centre, rotation, scale = aligned_errors(solved, true)
            verdict = json.loads(solved.with_suffix(".certificate.json").read_text())["verdict"]
            row(
                f"{name}, person: centres (scale off by {scale:.1f} %, {verdict})",
                f"{centre:.1f}",
                PERSON_CENTRE_BOUND_MM,
                "mm",
                centre <= PERSON_CENTRE_BOUND_MM,
            )
            row(
                f"{name}, person: rotations",
                f"{rotation:.3f}",
                PERSON_ROTATION_BOUND_DEG,
                "degrees",
                rotation <= PERSON_ROTATION_BOUND_DEG,
            )
    for failure in failures:
        print("FAILED " + failure)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
