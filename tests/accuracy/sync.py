#!/usr/bin/env python3
"""Accuracy of `kinevox sync` on videos with known offsets.

Each camera of a sequence loses a random number of first images, up to two seconds if the length allows, and some of its
last ones; the reported offsets are compared with the cuts. Errors are in frames, against the cameras' common time (their
mean), which is free. `half` takes every second image, the even ones of some cameras and the odd ones of the others: shifts
of half a frame, at half the rate. Images of another recording in place of a camera's must be refused without writing. With
--process the aligned session goes through `kinevox process` and is compared with the original sequence: silhouette IoU,
volume and, with --pose, joints.

usage: sync.py --sync KINEVOX-SYNC [--process KINEVOX-PROCESS [--pose]] [--sequences walk,...] [--seeds N]
               [--movement] [--max-error FRAMES] [--quick]
Exit status 1 where an error is beyond --max-error or a wrong session is accepted; 77 without the test data."""
import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
from session_data import Session, data_folder, read_table  # noqa: E402

SEQUENCES = {
    "walk": "studio/walk",
    "signal": "studio/signal",
    "balancing": "balancing",  # used during development
    "gesture": "studio/gesture",
    "sprint": "studio/sprint",
    "ring8": "studio/ring8",
}  # for confirmation only
MAX_CUT_S, MIN_LEFT_S = 2.0, 1.2


class Sequence:
    """A session's images as files, so that other sessions can use any of them; only of `cameras` if given."""

    def __init__(self, name, folder, cameras=None):
        self.name = name
        self.session = Session(data_folder() / SEQUENCES[name] / "session.toml")
        self.folder = Path(folder) / name
        self.images = []
        for n, (camera, video) in enumerate(zip(self.session.cameras, self.session.videos)):
            if cameras is not None and n not in cameras:
                self.images.append([])
                continue
            ending = "bmp" if camera.width * camera.height < 1e6 else "png"  # lossless; large ones would fill the disk
            target = self.folder / camera.name
            target.mkdir(parents=True)
            capture, files = cv2.VideoCapture(str(video)), []
            while True:
                good, image = capture.read()
                if not good:
                    break
                files.append(target / f"{len(files):06d}.{ending}")
                cv2.imwrite(str(files[-1]), image, [cv2.IMWRITE_PNG_COMPRESSION, 1])
            self.images.append(files)
        self.length = min(len(p) for p in self.images if p)

    def sizes(self):
        return [(c.width, c.height) for c in self.session.cameras]

    def backgrounds(self):
        text = self.session.file.read_text()
        return [line.split('"')[1] for line in text.splitlines() if line.startswith("background")]


def write_session(folder, sequence, parts, fps, strangers=None):
    """`parts`: a list of numbers of images for each camera. `strangers`: {camera index: another sequence}."""
    folder.mkdir(parents=True)
    source = sequence.session
    text = f'# written by sync.py\nname = "{sequence.name}"\nfps = {fps}\ncalibration = "{calibration_of(source)}"\n'
    for c, camera in enumerate(source.cameras):
        home = (strangers or {}).get(c, sequence)
        (folder / camera.name).mkdir()
        for n, image in enumerate(parts[c]):
            (folder / camera.name / f"{n:06d}{home.images[c][0].suffix}").symlink_to(home.images[c][image])
        background = home.session.file.parent / home.backgrounds()[c]
        text += f'\n[[camera]]   # {c}\nname = "{camera.name}"\nvideo = "{camera.name}"\nbackground = "{background}"\n'
    (folder / "session.toml").write_text(text)
    return folder / "session.toml"


def calibration_of(source):
    line = next(li for li in source.file.read_text().splitlines() if li.startswith("calibration"))
    return source.file.parent / line.split('"')[1]


def draw_parts(sequence, seed, step=1):
    """Images each camera keeps and the true offset of its first one, in frames of the session that is made."""
    rng = np.random.default_rng([seed, sum(map(ord, sequence.name))])
    count = len(sequence.images)
    most = int(min(MAX_CUT_S * sequence.session.fps, (sequence.length - MIN_LEFT_S * sequence.session.fps) / 1.25))
    if step == 1:
        begins = rng.integers(0, most + 1, count)
        ends = sequence.length - rng.integers(0, most // 4 + 1, count)
    else:  # both phases occur
        begins = rng.permutation(np.arange(count) % step) + step * rng.integers(0, most // (4 * step) + 1, count)
        ends = np.full(count, sequence.length)
    return [range(b, e, step) for b, e in zip(begins, ends)], begins / step


def run_sync(program, session, extrinsics, *more):
    command = [program, session, "--json", "--quiet", *more] + ([] if extrinsics else ["--no-extrinsics"])
    begun = time.monotonic()
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True)
    return done, time.monotonic() - begun


def errors_of(result, truth, fps):
    found = np.array([c["offset_s"] for c in result["cameras"]]) * fps
    error = found - truth
    return error - error.mean(), np.array([c["std_s"] for c in result["cameras"]]) * fps


def try_shift(arguments, sequence, seed, step, extrinsics, folder):
    parts, truth = draw_parts(sequence, seed, step)
    fps = sequence.session.fps / step
    session = write_session(folder / f"{sequence.name}-{seed}-{step}-{extrinsics}", sequence, parts, fps)
    done, took = run_sync(arguments.sync, session, extrinsics, "--no-plot")
    what = f"{sequence.name:10} {'half' if step == 2 else 'whole':6} {seed:4} {'extrinsics' if extrinsics else 'movement':10}"
    overlap = (min(t + len(p) for t, p in zip(truth, parts)) - max(truth)) / fps
    if done.returncode != 0:
        print(f"{what} {overlap:7.2f}  refused: {done.stderr.strip()[14:]}")
        return None, session, parts
    result = json.loads(done.stdout)
    error, std = errors_of(result, truth, fps)
    weakest = min(c["evidence_nats"] for c in result["cameras"])
    runner_up = max(c["runner_up_ratio"] for c in result["cameras"])
    print(
        f"{what} {overlap:7.2f} {abs(error).max():8.2f} {std.max():8.2f} {1000 * abs(error).max() / fps:8.1f} "
        f"{weakest:8.0f} {runner_up:6.2f} {took:6.1f}",
        flush=True,
    )
    return float(abs(error).max()), session, parts


def try_wrong(arguments, sequence, other, cameras, folder):
    """True where it is refused and nothing is written."""
    parts, _ = draw_parts(sequence, 7)
    strange, _ = draw_parts(other, 8)
    parts = [strange[c] if c in cameras else p for c, p in enumerate(parts)]
    session = write_session(
        folder / f"wrong-{sequence.name}-{other.name}",
        sequence,
        parts,
        sequence.session.fps,
        {c: other for c in cameras},
    )
    before = session.read_bytes()
    good = True
    for extrinsics in (True, False):
        done, _ = run_sync(arguments.sync, session, extrinsics)
        left = session.read_bytes() == before and not (session.parent / "sync.png").exists()
        print(
            f"{sequence.name} with cameras {cameras} of {other.name}, {'extrinsics' if extrinsics else 'movement'}: "
            f"{'refused' if done.returncode else 'ACCEPTED'}, {'nothing' if left else 'SOMETHING'} written: "
            f"{done.stderr.strip()[14:110]}"
        )
        good = good and done.returncode == 1 and left and done.stderr.count("\n") == 1
    return good


def try_user(arguments, sequence, folder):
    """Output files and user errors."""
    parts, truth = draw_parts(sequence, 5)
    fps = sequence.session.fps
    session = write_session(folder / "user", sequence, parts, fps)
    page, before = session.parent / "sync.png", session.read_text()
    done, _ = run_sync(arguments.sync, session, True, "--dry-run")
    good = done.returncode == 0 and session.read_text() == before and page.stat().st_size > 10000
    page.unlink()
    written = subprocess.run(
        [arguments.sync, session, "--plot", session.parent / "other.png"], capture_output=True, text=True
    )
    after = session.read_text()
    offsets = [float(line.split("=")[1]) for line in after.splitlines() if line.startswith("offset_s")]
    good = (
        good
        and written.returncode == 0
        and written.stdout.startswith("camera")
        and not page.exists()
        and (session.parent / "other.png").exists()
        and after.startswith("# written by sync.py\n")
        and "[[camera]]   # 2\n" in after
        and len(offsets) == len(truth)
        and abs(np.diff(np.array(offsets) * fps - truth)).max() < 1
    )
    again, _ = run_sync(arguments.sync, session, True, "--no-plot")  # earlier offsets are ignored
    good = good and again.returncode == 0 and session.read_text() == after
    recorded = session.parent / "recorded.toml"
    recorded.write_text(before + '\n[recording]\nframe_times = "session.toml"\n')
    for words, part in (
        ([session.parent / "none.toml"], "none.toml"),
        ([session, "--max-offset", "0"], "max-offset"),
        ([session, "--plot", "page.gif"], ".png"),
        ([recorded], "already synchronised"),
        ([], "session"),
    ):
        done = subprocess.run(list(map(str, [arguments.sync, *words])), capture_output=True, text=True)
        good = (
            good and done.returncode == 1 and done.stderr.count("\n") == 1 and part in done.stderr and not done.stdout
        )
    print(f"output and messages: {'good' if good else 'WRONG'}")
    return good


def process(program, session, out, frames, pose):
    more = [] if pose else ["--no-pose"]
    subprocess.run(
        [str(program), str(session), "--out", str(out), "--quiet", "--frames", str(frames), *more], check=True
    )
    silhouette_iou, volume = read_table(out / "silhouette_iou.csv"), read_table(out / "volume.csv")
    iou = np.nanmean([v for k, v in silhouette_iou.items() if k not in ("frame", "subject")])
    return iou, np.nanmean(volume["volume_litres"]), read_table(out / "joints.csv") if pose else None


def joint_error_mm(joints, truth, first):
    names = [k[:-2] for k in joints if k.endswith("_x")]
    n = np.arange(len(joints["frame"]))
    apart = [np.sqrt(sum((joints[f"{j}_{a}"] - truth[f"{j}_{a}"][n + first]) ** 2 for a in "xyz")) for j in names]
    return 1000 * float(np.nanmean(apart))


def try_process(arguments, sequence, session, parts, folder, frames):
    """The aligned session against the original sequence, at the same instants."""
    first, last = max(p[0] for p in parts), min(p[-1] for p in parts)
    frames = min(frames, last - first + 1)
    whole = write_session(
        folder / f"{sequence.name}-whole", sequence, [range(first, last + 1)] * len(parts), sequence.session.fps
    )
    truth_file = sequence.session.truth / "joints.csv"
    pose = arguments.pose and truth_file.is_file()
    rows = {}
    for name, file in (("original", whole), ("aligned", session)):
        iou, litres, joints = process(arguments.process, file, folder / f"{sequence.name}-{name[:2]}", frames, pose)
        error = joint_error_mm(joints, read_table(truth_file), first) if pose else float("nan")
        rows[name] = (iou, litres, error)
        print(
            f"{sequence.name:10} {name:10} silhouette IoU {iou:.4f}, {litres:6.2f} litres"
            + (f", joints {error:.1f} mm" if pose else "")
        )
    (iou, litres, error), (iou2, litres2, error2) = rows["original"], rows["aligned"]
    return iou2 > iou - 0.005 and abs(litres2 / litres - 1) < 0.02 and not error2 > 1.05 * error + 1


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sync", required=True, type=Path)
    parser.add_argument("--process", type=Path)
    parser.add_argument("--pose", action="store_true", help="compare joints as well")
    parser.add_argument("--sequences", default=",".join(SEQUENCES))
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--movement", action="store_true", help="also without extrinsics; no bound")
    parser.add_argument("--max-error", type=float, default=0.5, help="frames")
    parser.add_argument(
        "--quick",
        action="store_true",
        help="a seed of walk, its first frames through `process`, a wrong one, user errors",
    )
    arguments = parser.parse_args()
    if not (data_folder() / "studio" / "walk" / "session.toml").is_file():
        print(f"skipped: no test data in {data_folder()}")
        return 77
    names = ["walk"] if arguments.quick else arguments.sequences.split(",")
    good, sequences = True, {}
    folder = Path(tempfile.mkdtemp(prefix="kinevox-sync-"))
    try:
        print(
            f"{'sequence':10} {'shifts':6} {'seed':>4} {'by':10} {'common s':>7} {'error':>7} {'+-':>8} {'ms':>8} "
            f"{'evidence':>8} {'next':>6} {'took s':>6}"
        )
        for name in names:
            if not (data_folder() / SEQUENCES[name]).is_dir():
                print(f"{name}: not there")
                continue
            sequence = sequences[name] = Sequence(name, folder)
            for seed in range(1 if arguments.quick else arguments.seeds):
                for step in (1, 2):
                    for extrinsics in (True, False) if arguments.movement else (True,):
                        error, session, parts = try_shift(arguments, sequence, seed, step, extrinsics, folder)
                        good = good and (not extrinsics or (error is not None and error <= arguments.max_error))
                        if arguments.process and error is not None and extrinsics and step == 1 and seed == 0:
                            frames = 40 if arguments.quick else 10**6
                            good = try_process(arguments, sequence, session, parts, folder, frames) and good
            previous = [s for s in sequences.values() if s is not sequence and s.sizes() == sequence.sizes()]
            if previous:
                good = try_wrong(arguments, sequence, previous[-1], [1, 2], folder) and good
                good = try_wrong(arguments, previous[-1], sequence, [3], folder) and good
                shutil.rmtree(previous[-1].folder)
                del sequences[previous[-1].name]
        if arguments.quick:
            good = try_user(arguments, sequences["walk"], folder) and good
            good = try_wrong(arguments, sequences["walk"], Sequence("gesture", folder, [2]), [2], folder) and good
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    print("good" if good else "NOT good")
    return 0 if good else 1


if __name__ == "__main__":
    os.environ.setdefault("OPENCV_LOG_LEVEL", "ERROR")
    sys.exit(main())
