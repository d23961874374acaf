#!/usr/bin/env python3
"""Several people in `kinevox process --max-subjects`: joints of each person, identities, people missing and invented.

usage: people.py [--kinevox-process PROGRAM] [--session FILE | --scene NAME --kinevox-studio PROGRAM] [--results FOLDER] [--max-mm N] [--max-apart-mm N] [--max-silent N]
                 [--max-swaps N] [--max-absent N] [--followed NAME] [-- OPTION ...]

--scene renders people/NAME.toml. A session's truth has joints_NAME.csv and masks_NAME_CAMERA.zip per person (default: shared/data/studio/pair). In each frame,
subjects and people are paired with the smallest sum of distances of their trunks, at most 0.6 m each. Rows: mean joint error
over all frames and over those in which the masks of the people touch in no camera (mm), silent errors as in rates.py, values
within 1, 2 and 3 standard deviations, withheld joints; then identity swaps (a person's subject changes), and people missing and
invented for more than 0.3 s. --followed: the session again with one subject to follow, this person, whose values have the same
bounds. --results keeps the results, and uses them again where they are there. Exit status 77 without the
shared test data."""
import argparse
import itertools
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from pose import DATA, JOINTS, points
from rates import SILENT_M, SILENT_STD
from session_data import Session, process_program, read_table

SCENES = Path(__file__).resolve().parent / "people"
MAX_PAIRED_M = 0.6
MAX_ABSENT_S = 0.3
MARGIN_PX = 4
MIN_VIEWS, MIN_INSIDE = 3, 0.7  # cameras, each with this fraction of the joints in its image
TRUNK = [JOINTS.index(j) for j in ("root", "sacroiliac", "skullbase", "hip_l", "hip_r", "shoulder_l", "shoulder_r")]


def well_seen(cameras, joints):
    """Of joints (frames, joints, 3): whether enough cameras show most of them, so that a person must be followed; who is in
    one or two views only is masked out."""
    views = np.zeros(len(joints), int)
    for camera in cameras:
        pixels = camera.project(joints.reshape(-1, 3)).reshape(*joints.shape[:2], 2)
        inside = ((pixels >= 0) & (pixels < (camera.width, camera.height))).all(2)  # false for NaN, behind the camera
        views += inside.mean(1) >= MIN_INSIDE
    return views >= min(MIN_VIEWS, len(cameras))


def frames_apart(session, people, count):
    """Per frame, whether the people's masks touch in no camera."""
    apart = np.ones(count, bool)
    kernel = np.ones((2 * MARGIN_PX + 1, 2 * MARGIN_PX + 1), np.uint8)
    for camera in session.cameras:
        masks = [list(session.true_masks(camera, p)) for p in people]
        for n in range(count):
            for a, b in itertools.combinations(masks, 2):
                apart[n] &= not np.any((cv2.dilate(a[n].astype(np.uint8), kernel) > 0) & b[n])
    return apart


def pair(measured, truth):
    """Of (subjects, joints, 3) and (people, joints, 3): per person the subject's index, None if it has none."""
    trunk = lambda p: np.nanmean(p[:, TRUNK], axis=1)
    distance = np.linalg.norm(trunk(measured)[:, None] - trunk(truth)[None], axis=2)  # subject, person
    distance = np.where(np.isfinite(distance) & (distance <= MAX_PAIRED_M), distance, 10)
    padded = list(range(len(measured))) + [None] * len(truth)
    cost = lambda choice: sum(10 if s is None else distance[s, p] for p, s in enumerate(choice))
    best = min(itertools.permutations(padded, len(truth)), key=cost)
    return [None if s is None or distance[s, p] >= 10 else s for p, s in enumerate(best)]


def longest(flags):
    """The longest run of true values."""
    return max((sum(1 for _ in run) for value, run in itertools.groupby(flags) if value), default=0)


class People:
    """What one session's results show of its people. `sequence_frames`: as in rates.py."""

    def __init__(self, session_file, results, only=None, sequence_frames=None):
        session = Session(session_file)
        truth_folder = session.truth
        self.names = sorted(f.stem.split("_")[1] for f in truth_folder.glob("joints_*.csv"))
        truth = np.stack([points(read_table(truth_folder / f"joints_{n}.csv"), JOINTS) for n in self.names], 1)
        found, stated = read_table(results / "joints.csv"), read_table(results / "uncertainty.csv")
        row_frames = np.rint(found["time_s"] * session.fps).astype(int)
        if sequence_frames is not None:
            row_frames = sequence_frames[found["frame"].astype(int)]
        measured = points(found, JOINTS)
        std = np.stack([stated[f"{j}_std_m"] for j in JOINTS], 1)
        count = min(len(truth), row_frames.max() + 1)
        self.fps, self.apart = session.fps, frames_apart(session, self.names, count)
        shape = (count, len(self.names), len(JOINTS))
        self.offset, self.std = np.full((*shape, 3), np.nan), np.full(shape, np.nan)
        self.subject = np.zeros((count, len(self.names)), int)  # 0: missing
        self.invented = np.zeros(count, int)
        self.there = np.isfinite(truth[:count]).all(axis=(2, 3))
        if sequence_frames is not None:  # who is not in a lost frame set is not missing
            self.there &= np.isin(np.arange(count), row_frames)[:, None]
        self.followable = self.there & np.stack(
            [well_seen(session.cameras, np.nan_to_num(truth[:count, p])) for p in range(len(self.names))], 1
        )
        for n in range(count):
            rows = np.flatnonzero((row_frames == n) & np.isfinite(measured[:, TRUNK]).any(axis=(1, 2)))
            if not len(rows):
                continue
            chosen = pair(measured[rows], np.where(self.there[n][:, None, None], truth[n], 1e3))
            self.invented[n] = len(rows) - sum(s is not None for s in chosen)
            for person, s in enumerate(chosen):
                if s is None:
                    continue
                self.offset[n, person] = measured[rows[s]] - truth[n, person]
                self.std[n, person] = std[rows[s]]
                self.subject[n, person] = found["subject"][rows[s]]
        if only:
            column = [self.names.index(only)]
            self.names = [only]
            self.offset, self.std = self.offset[:, column], self.std[:, column]
            self.subject, self.there = self.subject[:, column], self.there[:, column]
            self.followable = self.followable[:, column]

    def row(self, frames, person=slice(None)):
        there = self.there[frames, person]
        offset, std = self.offset[frames, person][there], self.std[frames, person][there]
        error = np.linalg.norm(offset, axis=-1)
        known = np.isfinite(error)
        silent = known & (error > SILENT_M) & (error > SILENT_STD * std)
        ratio = (np.abs(offset) / std[..., None])[known]
        return {
            "mean_mm": 1000 * float(np.mean(error[known])) if known.any() else float("nan"),
            "silent": 100 * float(silent.sum()) / max(1, error.size),
            **{f"within_{k}": 100 * float(np.mean(ratio < k)) if known.any() else float("nan") for k in (1, 2, 3)},
            "withheld": 100 * float(np.mean(~known)) if known.size else float("nan"),
        }

    def swaps(self):
        count = 0
        for ids in self.subject.T:
            ids = ids[ids > 0]
            count += int(np.sum(ids[1:] != ids[:-1]))
        return count

    def absent_s(self):
        """The longest time that a person whom enough cameras show is missing, and that one is invented."""
        return (
            max(longest((ids == 0) & seen) for ids, seen in zip(self.subject.T, self.followable.T)) / self.fps,
            longest(self.invented > 0) / self.fps,
        )


def text(label, row):
    return (
        f"{label:14s}{row['mean_mm']:9.1f}{row['silent']:10.2f}"
        + "".join(f"{row[f'within_{k}']:8.1f}" for k in (1, 2, 3))
        + f"{row['withheld']:9.1f}"
    )


def processed(arguments, results, max_subjects, options):
    if not (results / "run.toml").exists():
        program = arguments.kinevox_process or process_program()
        most = ["--max-subjects", str(max_subjects)]
        subprocess.run([program, arguments.session, "--out", results, "--quiet", *most, *options], check=True)
    return results


def main():
    argv = sys.argv[1:]
    options = argv[argv.index("--") + 1 :] if "--" in argv else []
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kinevox-process", type=Path)
    parser.add_argument("--session", type=Path, default=DATA / "studio" / "pair" / "session.toml")
    parser.add_argument("--scene", choices=sorted(f.stem for f in SCENES.glob("*.toml")))
    parser.add_argument("--kinevox-studio", type=Path)
    parser.add_argument("--results", type=Path)
    parser.add_argument("--followed", metavar="NAME")
    for bound in ("mm", "apart-mm", "silent", "swaps", "absent"):
        parser.add_argument(f"--max-{bound}", type=float, default=np.inf)
    arguments = parser.parse_args(argv[: argv.index("--")] if "--" in argv else argv)
    if not arguments.session.exists():
        print(f"people: {arguments.session} is not there; skipped")
        return 77
    with tempfile.TemporaryDirectory() as temporary:
        results = arguments.results or Path(temporary) / "results"
        if arguments.scene:
            folder = Path(temporary) / arguments.scene
            scene = SCENES / f"{arguments.scene}.toml"
            subprocess.run([arguments.kinevox_studio, "--scene", scene, "--out", folder], check=True)
            arguments.session = folder / "session.toml"
        people = People(arguments.session, processed(arguments, results, 4, options))
        if arguments.followed:
            followed = processed(arguments, results.with_name(results.name + "_followed"), 1, options)
            one = People(arguments.session, followed, arguments.followed)
    every = np.ones(len(people.apart), bool)
    print(f"{'':14s}{'mean mm':>9s}{'silent %':>10s}{'1 std':>8s}{'2 std':>8s}{'3 std':>8s}{'none %':>9s}")
    for person, name in enumerate(people.names):
        print(text(f"person {name}", people.row(every, person)))
    whole, apart = people.row(every), people.row(people.apart)
    print(text("all", whole))
    print(text(f"apart ({people.apart.sum()})", apart))
    missing_s, invented_s = people.absent_s()
    print(f"identity swaps {people.swaps()}, missing {missing_s:.2f} s, invented {invented_s:.2f} s at a time")
    checks = [("all", whole, people.swaps(), max(missing_s, invented_s))]
    if arguments.followed:
        alone, absent_s = one.row(slice(None)), one.absent_s()[0]
        print(text(f"{arguments.followed} followed", alone))
        print(f"identity swaps {one.swaps()}, missing {absent_s:.2f} s at a time")
        checks.append((f"{arguments.followed} followed", alone, one.swaps(), absent_s))
    failed = [
        f"{label}: {line}"
        for label, row, swaps, absent in checks
        for line, value, bound in (
            ("mean of all frames, mm", row["mean_mm"], arguments.max_mm),
            ("silent errors, %", row["silent"], arguments.max_silent),
            ("identity swaps", swaps, arguments.max_swaps),
            ("missing or invented, s", absent, arguments.max_absent),
        )
        if not value <= bound
    ]
    if people.apart.any() and not apart["mean_mm"] <= arguments.max_apart_mm:
        failed.append("mean of frames apart, mm")
    for line in failed:
        print(f"FAILED {line}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
