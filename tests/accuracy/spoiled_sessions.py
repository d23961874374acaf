#!/usr/bin/env python3
"""Does `kinevox process` say that a session is spoiled, and by what?

Builds spoiled sessions from the shared studio data, one cause each, processes them and compares the first cause of
quality.json with the one that was built in. The good sequences must not be given any of these causes.

usage: spoiled_sessions.py --process KINEVOX-PROCESS [--only NAME,...] [--good NAME,...] [--quick] [--frames N] [--out FOLDER]
Exit status 1 where a cause is missed or a good sequence accused; 77 without the test data."""
import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from session_data import Session, data_folder  # noqa: E402

GOOD = ("walk", "gesture", "signal", "ring8", "martial", "boxing", "exercise", "floor", "sprint", "balancing")
# Causes that accuse the session; "silhouettes" and "withheld" only describe its result.
DESCRIPTIONS = ("silhouettes", "withheld")
QUICK = ("scale", "camera_moved", "background_person")
MAX_FRAMES = 90


class Spoiled:
    """A session of its own folder that shares what is not changed with the original."""

    def __init__(self, sequence, folder, frames=MAX_FRAMES):
        self.frames = frames
        self.original = Session(data_folder() / "studio" / sequence / "session.toml")
        self.folder = Path(folder)
        self.folder.mkdir(parents=True)
        self.cameras = self.original.cameras
        self.videos = [str(v) for v in self.original.videos]
        self.backgrounds = [str(v.parent / "background" / v.name) for v in self.original.videos]
        self.options = []

    def images(self, camera, background=False):
        capture = cv2.VideoCapture((self.backgrounds if background else self.videos)[camera])
        images = []
        while len(images) < (10 if background else self.frames):
            good, image = capture.read()
            if not good:
                break
            images.append(image)
        return images

    def set_images(self, camera, images, background=False):
        target = self.folder / f"{self.cameras[camera].name}{'_background' if background else ''}"
        target.mkdir()
        for n, image in enumerate(images):
            cv2.imwrite(str(target / f"{n:06d}.png"), image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
        (self.backgrounds if background else self.videos)[camera] = str(target)

    def change_images(self, change):
        """`change`: of one image; of all images and backgrounds."""
        for c in range(len(self.cameras)):
            for background in (False, True):
                self.set_images(c, [change(image) for image in self.images(c, background)], background)

    def transform_world(self, new_from_old, scale=1.0):
        for camera in self.cameras:
            camera.rotation = camera.rotation @ new_from_old.T
            camera.translation = camera.translation * scale

    def write(self):
        lines = []
        for c in self.cameras:
            rotation = cv2.Rodrigues(c.rotation)[0].ravel()
            lines += [
                f"[{c.name}]",
                f'name = "{c.name}"',
                f"size = [{float(c.width)}, {float(c.height)}]",
                f"matrix = {[[float(v) for v in row] for row in c.matrix]}",
                f"distortions = {[float(v) for v in c.distortion]}",
                f"rotation = {[float(v) for v in rotation]}",
                f"translation = {[float(v) for v in c.translation]}",
                "fisheye = false",
                "",
            ]
        (self.folder / "calibration.toml").write_text("\n".join(lines))
        text = f'name = "spoiled"\nfps = {self.original.fps}\ncalibration = "calibration.toml"\n'
        for camera, video, background in zip(self.cameras, self.videos, self.backgrounds):
            text += f'[[camera]]\nname = "{camera.name}"\nvideo = "{video}"\nbackground = "{background}"\n'
        (self.folder / "session.toml").write_text(text)
        return self.folder / "session.toml"


def rotation(axis, degrees):
    return cv2.Rodrigues(np.radians(degrees) * np.array(axis, float))[0]


def background_person(s):
    """Learned with the person standing in the room."""
    for c in range(len(s.cameras)):
        s.set_images(c, [s.images(c)[s.frames * 2 // 3]], background=True)


def background_median(s):
    """The median of the session itself, in which the person stays in place."""
    for c in range(len(s.cameras)):
        s.set_images(c, [np.median(np.stack(s.images(c)[::6]), 0).astype(np.uint8)], background=True)


def draw_box(s, low, high, colour):
    """A box that stands in the room, behind the person, without shadow."""
    corners = np.array([[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])])
    faces = ((0, 1, 3, 2), (4, 5, 7, 6), (0, 1, 5, 4), (2, 3, 7, 6), (0, 2, 6, 4), (1, 3, 7, 5))
    noise = np.random.default_rng(1)
    for c, camera in enumerate(s.cameras):
        pixels, centre = camera.project(corners), -camera.rotation.T @ camera.translation
        order = sorted(faces, key=lambda f: -np.linalg.norm(corners[list(f)].mean(0) - centre))
        layer, mask = np.zeros((camera.height, camera.width, 3)), np.zeros((camera.height, camera.width), np.uint8)
        for n, face in enumerate(order):
            polygon = np.round(pixels[list(face)]).astype(np.int32)
            cv2.fillConvexPoly(layer, polygon, [v * (0.7 + 0.05 * n) for v in colour])
            cv2.fillConvexPoly(mask, polygon, 255)
        images = []
        for image, person in zip(s.images(c), s.original.true_masks(camera)):
            shown = (mask > 0) & ~person
            image = image.astype(float)
            image[shown] = (layer + noise.normal(0, 1.4, layer.shape))[shown]
            images.append(np.clip(np.round(image), 0, 255).astype(np.uint8))
        s.set_images(c, images)


def still_chair(s):
    draw_box(s, (0.9, 0.6, 0), (1.3, 1.0, 0.9), (40, 60, 150))


def still_board(s):
    draw_box(s, (-1.3, -0.5, 0), (-0.6, 0.3, 0.08), (150, 120, 40))


def upside_down(s):
    s.transform_world(rotation((1, 0, 0), 180))


def tilted(s):
    s.transform_world(rotation((0.6, 0.8, 0), 12))


def scale(s):
    s.transform_world(np.eye(3), 1.3)


def scale_small(s):
    s.transform_world(np.eye(3), 0.7)


def camera_moved(s):
    """Turned by 3 degrees and shifted by 10 cm."""
    camera = s.cameras[1]
    camera.rotation = rotation((0.2, 0.97, 0), 3) @ camera.rotation
    camera.translation = camera.translation + np.array([0.08, 0.02, -0.05])


def third_camera_late(s, count):
    for c in range(len(s.cameras)):
        images = s.images(c)
        s.set_images(c, images[count:] if c == 2 else images[:-count])


def camera_time(s):
    """The third camera started eight images late; the subject moves slowly."""
    third_camera_late(s, 8)


def camera_time_short(s):
    """Two images late; the subject moves fast."""
    third_camera_late(s, 2)


def zoomed(s):
    """The second camera's zoom was changed."""
    s.cameras[1].matrix[0, 0] *= 1.15
    s.cameras[1].matrix[1, 1] *= 1.15


def resolution(s):
    """Calibrated at 1.5 times the resolution, only the size was corrected."""
    for camera in s.cameras:
        camera.matrix[:2] = 1.5 * (camera.matrix[:2] + [[0, 0, 0.5]]) - [[0, 0, 0.5]]


def out_of_view(s):
    """Every camera shows the upper part of the scene only."""
    kept = 250
    for camera in s.cameras:
        camera.height = kept
    s.change_images(lambda image: image[:kept])


def too_dark(s):
    noise = np.random.default_rng(2)
    s.change_images(
        lambda image: np.clip(np.round(0.07 * image + noise.normal(0, 1.4, image.shape)), 0, 255).astype(np.uint8)
    )


def saturated(s):
    s.change_images(lambda image: np.clip(3.0 * image.astype(float), 0, 255).astype(np.uint8))


def wrong_body(s):
    """The T-pose session is another person's."""
    s.options = ["--tpose", str(data_folder() / "studio/gesture/session.toml")]


def as_it_is(s):
    del s


# name: sequence, how it is spoiled, expected cause
CASES = {
    "background_person": ("walk", background_person, "background_occupied"),
    "background_median": ("exercise", background_median, "background_occupied"),
    "several_people": ("pair", as_it_is, "several_people"),
    "still_chair": ("signal", still_chair, "still_object"),
    "still_board": ("boxing", still_board, "still_object"),
    "upside_down": ("gesture", upside_down, "world_upside_down"),
    "tilted": ("walk", tilted, "world_tilted"),
    "scale": ("walk", scale, "scale"),
    "scale_small": ("boxing", scale_small, "scale"),
    "camera_moved": ("walk", camera_moved, "camera_moved"),
    "camera_time": ("signal", camera_time, "camera_time"),
    "camera_time_short": ("gesture", camera_time_short, "camera_time"),
    "intrinsics": ("gesture", zoomed, "intrinsics"),
    "resolution": ("signal", resolution, "intrinsics"),
    "out_of_view": ("gesture", out_of_view, "out_of_view"),
    "too_dark": ("walk", too_dark, "too_dark"),
    "saturated": ("signal", saturated, "saturated"),
    "wrong_body": ("walk", wrong_body, "wrong_body"),
}


def process(program, session, out, options):
    command = [program, session, "--out", out, "--quiet", "--overwrite", *options]
    done = subprocess.run([str(word) for word in command], stderr=subprocess.PIPE, text=True)
    if done.returncode != 0:
        return {"verdict": "ERROR", "cause": {"cause": "error", "reason": done.stderr.strip()}}
    return json.loads((Path(out) / "quality.json").read_text())


def accusations(quality):
    """Causes in quality.json that accuse the session."""
    causes = [cause["cause"] for cause in quality.get("causes", [quality["cause"]])]
    return [cause for cause in causes if cause not in DESCRIPTIONS]


def row(name, expected, quality):
    cause = quality["cause"] or {"cause": "", "reason": ""}
    return f"{name:18} {expected:20} {quality['verdict']:11} {cause['cause']:20} {cause['reason']}"


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--process", required=True)
    parser.add_argument("--only", default=None)
    parser.add_argument("--good", default=None)
    parser.add_argument("--quick", action="store_true", help="a few spoiled sessions, half as long")
    parser.add_argument("--frames", type=int, default=None, help="of a spoiled session (default: 90)")
    parser.add_argument("--out", type=Path, default=None, help="keeps the results there")
    arguments = parser.parse_args()
    arguments.frames = arguments.frames or (MAX_FRAMES // 2 if arguments.quick else MAX_FRAMES)
    if not (data_folder() / "studio").is_dir():
        print("skipped: no test data; set KINEVOX_TEST_DATA")
        return 77
    names = QUICK if arguments.quick else CASES
    goods = () if arguments.quick else GOOD  # sequences.py judges them, too
    if arguments.only is not None:
        names = [n for n in arguments.only.split(",") if n]
    if arguments.good is not None or arguments.only is not None:
        goods = [n for n in (arguments.good or "").split(",") if n]
    results = arguments.out or Path(tempfile.mkdtemp(prefix="kinevox-spoiled-"))
    failed = 0
    print(f"{'session':18} {'expected':20} {'verdict':11} {'cause':20}")
    try:
        for name in names:
            sequence, spoil, expected = CASES[name]
            with tempfile.TemporaryDirectory(prefix="kinevox-spoiled-") as folder:
                spoiled = Spoiled(sequence, Path(folder) / "session", arguments.frames)
                spoil(spoiled)
                options = [*spoiled.options, "--frames", arguments.frames]
                quality = process(arguments.process, spoiled.write(), results / name, options)
            named = bool(quality["cause"]) and quality["cause"]["cause"] == expected
            failed += not named
            print(row(name, expected, quality) + ("" if named else "   MISSED"), flush=True)
        for name in goods:
            folder = data_folder() / (name if name == "balancing" else f"studio/{name}")
            options = ["--frames", arguments.frames] if arguments.quick else []
            quality = process(arguments.process, folder / "session.toml", results / f"good_{name}", options)
            accused = accusations(quality)
            failed += bool(accused)
            print(row(name, "-", quality) + ("   FALSE ALARM" if accused else ""), flush=True)
    finally:
        if not arguments.out:
            shutil.rmtree(results, ignore_errors=True)
    print(f"{len(names)} spoiled and {len(goods)} good sessions, {failed} wrong")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
