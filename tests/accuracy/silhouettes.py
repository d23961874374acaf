#!/usr/bin/env python3
"""Silhouettes against ground truth masks, compared with OpenCV's subtractors.

Runs `kinevox-process SESSION --save silhouettes` on each studio sequence, compares every frame of every camera with
truth/masks_CAMERA.zip (intersection over union), and runs MOG2 and KNN on the same frames: learned on the same background
clip, with their own shadow detection, then the same kind of clean-up (specks and small components removed, small holes
filled) and, for each of the two, the best of three thresholds in every sequence. Prints one table; exit status 1 where
OpenCV is ahead, 77 without programs or data. sequences.py holds the bounds.
"""
import argparse
import os
import subprocess
import sys
import tempfile
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

try:
    import cv2
    import numpy as np
except ImportError as missing:
    print(f"skipped: this needs numpy and OpenCV for Python ({missing})")
    sys.exit(77)

SEQUENCES = ["walk", "gesture", "signal", "ring8", "sprint"]
MIN_COMPONENT_PX, MIN_COMPONENT_FRACTION, MAX_HOLE_PX = 30, 0.04, 60
# Squared distance (MOG2: in variances; KNN: in grey levels^2) up to which a pixel is background.
MOG2_THRESHOLDS, KNN_THRESHOLDS = (5, 10, 20), (20, 50, 120)
# Practically no learning; KNN interprets 0 as "as fast as possible".
FROZEN = 1e-4


def read_clip(path):
    clip = cv2.VideoCapture(str(path))
    while True:
        ok, image = clip.read()
        if not ok:
            return
        yield image


def read_masks(path):
    with zipfile.ZipFile(path) as archive:
        for name in sorted(archive.namelist()):
            yield cv2.imdecode(np.frombuffer(archive.read(name), np.uint8), cv2.IMREAD_GRAYSCALE) > 0


def iou(mask, truth):
    union = np.count_nonzero(mask | truth)
    return np.count_nonzero(mask & truth) / union if union else 1.0


def clean(mask):
    """Specks and small components removed, small holes filled, as the segmenter does."""
    mask = cv2.medianBlur(mask, 3)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=8)
    if count > 1:
        areas = stats[:, cv2.CC_STAT_AREA]
        keep = areas >= max(MIN_COMPONENT_PX, MIN_COMPONENT_FRACTION * areas[1:].max())
        keep[0] = False
        mask = np.where(keep[labels], 255, 0).astype(np.uint8)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(255 - mask, connectivity=4)
    fill = stats[:, cv2.CC_STAT_AREA] < MAX_HOLE_PX
    fill[0] = False
    mask[fill[labels]] = 255
    return mask > 0


def subtractors():
    for threshold in MOG2_THRESHOLDS:
        yield "MOG2", cv2.createBackgroundSubtractorMOG2(history=60, varThreshold=threshold, detectShadows=True)
    for threshold in KNN_THRESHOLDS:
        yield "KNN", cv2.createBackgroundSubtractorKNN(history=60, dist2Threshold=threshold, detectShadows=True)


class OpencvCamera:
    """Both subtractors of one camera with all thresholds, learned on its background clip and frozen."""

    def __init__(self, folder, camera):
        self.video, self.truth = folder / f"{camera}.mp4", folder / "truth" / f"masks_{camera}.zip"
        self.methods = list(subtractors())
        for image in read_clip(folder / "background" / f"{camera}.mp4"):
            for _, subtractor in self.methods:
                subtractor.apply(image, learningRate=1 / 30)

    def mean_iou(self, chosen, step):
        """Per method of `chosen` (indices) the mean over every step-th frame."""
        sums, frames = np.zeros(len(chosen)), 0
        for n, (image, truth) in enumerate(zip(read_clip(self.video), read_masks(self.truth))):
            if n % step:
                continue
            frames += 1
            for i, method in enumerate(chosen):
                foreground = self.methods[method][1].apply(image, learningRate=FROZEN)
                sums[i] += iou(clean(np.where(foreground == 255, 255, 0).astype(np.uint8)), truth)
        return sums / frames


def opencv_sequence(pool, folder, cameras):
    """{"MOG2": per camera, "KNN": per camera}: every frame, with the threshold that is best on every eighth frame (the
    models are frozen, so frames are independent)."""
    rigs = list(pool.map(lambda camera: OpencvCamera(folder, camera), cameras))
    names = [name for name, _ in rigs[0].methods]
    trial = np.mean(list(pool.map(lambda rig: rig.mean_iou(range(len(names)), 8), rigs)), axis=0)
    chosen = [
        max((i for i, name in enumerate(names) if name == method), key=lambda i: trial[i]) for method in ("MOG2", "KNN")
    ]
    values = np.array(list(pool.map(lambda rig: rig.mean_iou(chosen, 1), rigs)))
    return {"MOG2": values[:, 0], "KNN": values[:, 1]}


def kinevox_camera(folder, out, camera):
    values = []
    for n, truth in enumerate(read_masks(folder / "truth" / f"masks_{camera}.zip")):
        file = out / "silhouettes" / camera / f"{n:06d}.png"
        mask = cv2.imread(str(file), cv2.IMREAD_GRAYSCALE)
        if mask is None:
            sys.exit(f"{file} is missing: kinevox-process did not write every frame's silhouettes")
        if mask.shape != truth.shape:
            sys.exit(f"{file} is {mask.shape[1]} x {mask.shape[0]}, the truth {truth.shape[1]} x {truth.shape[0]}")
        values.append(iou(mask > 0, truth))
    return float(np.mean(values))


def cameras_of(folder):
    return sorted(p.stem.removeprefix("masks_") for p in (folder / "truth").glob("masks_*.zip"))


def judge(folder, out, pool):
    """{camera: mean IoU} of the silhouettes in `out`, the results of the session in `folder`."""
    cameras = cameras_of(folder)
    return dict(zip(cameras, pool.map(lambda camera: kinevox_camera(folder, out, camera), cameras)))


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinevox-process", required=True, help="the program kinevox-process")
    root = Path(__file__).resolve().parents[2]
    parser.add_argument(
        "--data",
        help="the folder that holds studio/ (default: $KINEVOX_TEST_DATA or ../shared/data)",
        default=os.environ.get("KINEVOX_TEST_DATA", root / ".." / "shared" / "data"),
    )
    parser.add_argument("--sequences", default=",".join(SEQUENCES), help="comma separated")
    parser.add_argument("--out", help="keep the output of kinevox-process here")
    arguments = parser.parse_args()
    studio = Path(arguments.data) / "studio"
    sequences = arguments.sequences.split(",")
    for needed in [Path(arguments.kinevox_process)] + [studio / name / "session.toml" for name in sequences]:
        if not needed.exists():
            print(f"skipped: {needed} is not here; set KINEVOX_TEST_DATA to the folder that holds studio/")
            return 77

    cv2.setNumThreads(1)
    failures = []
    print(f"{'sequence':9} {'method':8} mean   per camera")
    with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(os.cpu_count()) as pool:
        for name in sequences:
            folder, out = studio / name, Path(arguments.out or scratch) / name
            cameras = cameras_of(folder)
            command = [
                arguments.kinevox_process,
                str(folder / "session.toml"),
                "--out",
                str(out),
                "--save",
                "silhouettes",
            ]
            run = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
            if run.returncode != 0:
                print(f"{' '.join(command)}\n{run.stderr.strip()}")
                return 1
            table = {"kinevox": list(judge(folder, out, pool).values())}
            table |= opencv_sequence(pool, folder, cameras)
            for method, values in table.items():
                print(f"{name:9} {method:8} {np.mean(values):.3f}  " + " ".join(f"{v:.3f}" for v in values), flush=True)
            ours = float(np.mean(table["kinevox"]))
            for method in ("MOG2", "KNN"):
                if ours <= np.mean(table[method]):
                    failures.append(f"{name}: {method} is ahead with {np.mean(table[method]):.3f}")
    for failure in failures:
        print("FAILED " + failure)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
