#!/usr/bin/env python3
"""Random trials of two to four people through `kinevox process --max-subjects 4`, compared with their truth.

usage: people_sweep.py [--trials N] [--first N] [--seed S] [--out FOLDER] [--kinevox-process PROGRAM] [--kinevox-studio PROGRAM] [-- OPTION ...]

sweep_scene.py draws each trial from seed and number: two to four people, their bodies, clothes, motions and positions, who enters
and leaves, room, light and four to eight cameras of 640 x 480; in every third one of them is camouflaged. The default seed is
today's date. Columns as in people.py, over all people and frames; swap: identity swaps; missing, invented: the longest time of
each, s; then the worst person. OUT keeps the trials, which are used again where they are there, and a contact sheet NNNN.png
of each: the frame with the largest error and two more. Options of `kinevox process` follow --."""
import argparse
import datetime
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

from people import People, processed, text
from pose import JOINTS, points
from session_data import Session, process_program, read_table
from sweep_scene import draw_group, scene_toml
from sweep_sheet import draw_skeleton

COLOURS = ((0, 0, 255), (255, 80, 0), (255, 0, 255), (0, 220, 255), (255, 255, 0), (255, 255, 255))
MAX_CAMERAS = 4
GREEN = (0, 200, 0)


def trial_session(arguments, out, trial):
    """The session of a trial, rendered if it is not there yet."""
    folder = out / f"{trial:04d}"
    if not (folder / "session.toml").exists():
        scene = out / f"{trial:04d}.toml"
        scene.write_text(scene_toml(draw_group(arguments.seed, trial)), encoding="utf-8")
        command = [arguments.kinevox_studio, "--scene", scene, "--out", folder]
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    return folder / "session.toml"


def draw_sheet(people, session_file, results, title, file):
    """Images with the true skeletons (green) and the found ones, a colour for each subject's number."""
    session, found = Session(session_file), read_table(results / "joints.csv")
    frames_of_rows, measured = np.rint(found["time_s"] * session.fps).astype(int), points(found, JOINTS)
    truth = [points(read_table(session.truth / f"joints_{n}.csv"), JOINTS) for n in people.names]
    error = np.linalg.norm(people.offset, axis=-1)
    error = np.where(people.there[..., None] & ~np.isfinite(error), 0.3, error)
    count = len(error)
    frames = sorted({int(np.argmax(np.nansum(error, axis=(1, 2)))), count // 5, 4 * count // 5})
    rows = {frame: [] for frame in frames}
    for camera in session.cameras[:MAX_CAMERAS]:
        video = cv2.VideoCapture(str(session.videos[session.cameras.index(camera)]))
        for frame in range(max(frames) + 1):
            image = video.read()[1]
            if frame not in rows:
                continue
            for joints in truth:
                draw_skeleton(image, camera.project(joints[frame]), {"l": GREEN, "r": GREEN, "m": GREEN}, 1)
            for row in np.flatnonzero(frames_of_rows == frame):
                if np.isfinite(found["subject"][row]):
                    colour = COLOURS[int(found["subject"][row] - 1) % len(COLOURS)]
                    draw_skeleton(image, camera.project(measured[row]), {"l": colour, "r": colour, "m": colour}, 2)
            label = f"{camera.name} frame {frame}"
            cv2.putText(image, label, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 1, cv2.LINE_AA)
            rows[frame].append(image)
    sheet = np.vstack([np.hstack(row) for row in rows.values()])
    cv2.putText(sheet, title, (8, 470), cv2.FONT_HERSHEY_SIMPLEX, 0.8, (255, 255, 255), 2, cv2.LINE_AA)
    cv2.imwrite(str(file), sheet)


def main():
    argv = sys.argv[1:]
    options = argv[argv.index("--") + 1 :] if "--" in argv else []
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=int(datetime.date.today().strftime("%Y%m%d")))
    parser.add_argument("--out", type=Path)
    parser.add_argument("--results", default="results", help="Name of the trials' folders of results")
    parser.add_argument("--kinevox-process", type=Path)
    parser.add_argument("--kinevox-studio", type=Path)
    arguments = parser.parse_args(argv[: argv.index("--")] if "--" in argv else argv)
    arguments.kinevox_process = arguments.kinevox_process or process_program()
    arguments.kinevox_studio = arguments.kinevox_studio or arguments.kinevox_process.parent / "kinevox-studio"
    columns = f"{'mean mm':>9s}{'silent %':>10s}{'1 std':>8s}{'2 std':>8s}{'3 std':>8s}{'none %':>9s}{'swap':>6s}{'missing':>9s}{'invented':>9s}"
    print(f"{'':14s}{columns}  worst mm")
    rows = []
    with tempfile.TemporaryDirectory() as scratch:
        out = arguments.out or Path(scratch)
        out.mkdir(parents=True, exist_ok=True)
        for trial in range(arguments.first, arguments.first + arguments.trials):
            arguments.session = trial_session(arguments, out, trial)
            results = processed(arguments, arguments.session.parent / arguments.results, 4, options)
            people = People(arguments.session, results)
            row = people.row(slice(None))
            row["swap"], (row["missing"], row["invented"]) = people.swaps(), people.absent_s()
            alone = [people.row(slice(None), p)["mean_mm"] for p in range(len(people.names))]
            label = f"{trial} {len(people.names)}p {len(Session(arguments.session).cameras)}c"
            line = f"{text(label, row)}{row['swap']:6d}{row['missing']:9.2f}{row['invented']:9.2f}  {people.names[int(np.nanargmax(alone))]} {np.nanmax(alone):.0f}"
            print(line, flush=True)
            draw_sheet(people, arguments.session, results, line, out / f"{trial:04d}.png")
            rows.append(row)
    mean = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
    longest = {key: max(row[key] for row in rows) for key in ("missing", "invented")}
    swaps = sum(row["swap"] for row in rows)
    print(f"{text('mean', mean)}{swaps:6d}{longest['missing']:9.2f}{longest['invented']:9.2f}")
    median, p95 = np.percentile([row["mean_mm"] for row in rows], (50, 95))
    print(f"median {median:.1f}, 95th percentile {p95:.1f} mm")
    return 0


if __name__ == "__main__":
    sys.exit(main())
