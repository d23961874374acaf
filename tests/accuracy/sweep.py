#!/usr/bin/env python3
"""Random trials of the virtual studio through `kinevox process`, compared with their truth: a test that nothing can be tuned to.

usage: sweep.py [--trials N] [--seed S] [--jobs N] [--out FOLDER] [--keep] [--masks] [--lossless] [--true-masks] [--first N] [--short]
                [--ci [--update]] [--kinevox-process PROGRAM] [--kinevox-studio PROGRAM]

sweep_scene.py draws each trial from seed and number: body, clothes, room, light, cameras, rate and motion; every third one is
camouflaged. The default seed is today's date, so that every night has new trials; a trial is repeated with --seed S --first N
--trials 1. Printed and kept in OUT (sweep.json, report.txt): the distribution of the trials and the worst ten, with contact
sheets in OUT/worst. Other options of `kinevox process` follow --.

--keep leaves the trials' folders (scene.toml, session.toml, truth, results) in OUT/trials. --masks only renders them, for
who tunes the segmentation, with the true masks also as truth/masks_CAMERA.zip, and lists them in OUT/masks.csv.
--lossless renders videos without the codec's noise, as live cameras have none.
--true-masks replaces the images by the exact silhouettes: what remains are errors of tracking, body and pose.
--ci runs a fixed, short set and compares it with sweep_bounds.toml: measured value plus 15 %; --update writes it.

mean mm: mean joint error; silent: share of joints that are reported more than 100 mm and 3 stated standard deviations off;
1, 2, 3 std: share of the joints' coordinates within 1, 2, 3 of them; IoU: sharp silhouettes against the true masks."""
import argparse
import datetime
import json
import math
import os
import shutil
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

from bounds import Judgement
from mask_session import write_mask_session
from session_data import process_program
from sweep_judge import judge
from sweep_scene import draw_scene, scene_toml
from sweep_sheet import draw_sheet

WORST = 10
CI = {"seed": 7, "trials": (0, 9, 11, 12)}  # of 640 x 480 px, four cameras, 48 frame sets
BOUNDS = Path(__file__).with_name("sweep_bounds.toml")
TIMEOUT_S = 1800


def run(command, log):
    """The error's last line, or nothing."""
    try:
        done = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, timeout=TIMEOUT_S)
    except subprocess.TimeoutExpired:
        return f"{Path(command[0]).name}: no end after {TIMEOUT_S} s"
    log.write_text(done.stderr, encoding="utf-8")
    return "" if done.returncode == 0 else (done.stderr.strip().splitlines() or ["no message"])[-1]


def zip_masks(truth):
    """The true masks as the accuracy scripts' other sequences have them."""
    for folder in sorted(truth.glob("masks_*/")):
        with zipfile.ZipFile(truth / f"{folder.name}.zip", "w") as archive:
            for file in sorted(folder.glob("*.png")):
                archive.write(file, file.name)


class Sweep:
    def __init__(self, arguments, out):
        self.arguments, self.out = arguments, out
        self.process = arguments.kinevox_process or process_program()
        self.studio = arguments.kinevox_studio or self.process.parent / "kinevox-studio"
        if not self.studio.exists():
            raise SystemExit(f"{self.studio} does not exist; build kinevox-studio, or give --kinevox-studio")
        self.trials, self.worst = out / "trials", out / "worst"
        for folder in (self.trials, self.worst):
            folder.mkdir(parents=True, exist_ok=True)

    def scene(self, trial):
        options = self.arguments
        if options.ci:
            return draw_scene(options.seed, trial, cameras=4, size=(640, 480), short=True, frames=48)
        scene = draw_scene(options.seed, trial, short=options.short)
        return scene | {"crf": 0} if options.lossless else scene

    def render(self, trial):
        """The trial's folder and its scene; an error, or nothing."""
        folder, scene = self.trials / f"{trial:04d}", self.scene(trial)
        if (folder / "session.toml").exists():
            return folder, scene, ""
        shutil.rmtree(folder, ignore_errors=True)
        text = self.trials / f"{trial:04d}.toml"
        text.write_text(scene_toml(scene), encoding="utf-8")
        problem = run([self.studio, "--scene", text, "--out", folder], self.trials / f"{trial:04d}.log")
        if not problem:
            text.rename(folder / "scene.toml")
        return folder, scene, problem

    def one(self, trial):
        folder, scene, problem = self.render(trial)
        result = {"trial": trial, "seed": self.arguments.seed, "scene": scene, "problem": problem}
        if problem or self.arguments.masks:
            if not problem:
                zip_masks(folder / "truth")
            return result
        results, session = folder / "results", folder / "session.toml"
        if self.arguments.true_masks:
            zip_masks(folder / "truth")
            session = write_mask_session(session, folder / "masks")
        threads = max(1, (os.cpu_count() or 1) // self.arguments.jobs)
        command = [self.process, session, "--out", results, "--overwrite", "--quiet", "--save"]
        command += ["silhouettes", "--threads", str(threads), *self.arguments.options]
        result["problem"] = run(command, folder / "process.log")
        result["metrics"] = judge(folder / "session.toml", results, scene)
        draw_sheet(folder / "session.toml", results, result["metrics"], title(result), self.worst / f"{trial:04d}.png")
        (folder / "metrics.json").write_text(json.dumps(result, indent=1), encoding="utf-8")
        if not self.arguments.keep:
            shutil.rmtree(folder)
        print(row(result), flush=True)
        return result


def title(result):
    scene, m = result["scene"], result["metrics"]
    return (
        f"seed {result['seed']} trial {result['trial']}: {scene['motion']['name']} x {scene['motion']['speed']}, {scene['fps']:g} Hz, "
        f"{len(scene['camera'])} cameras, {scene['subject']['stature_m']} m, camouflage {scene['camouflage'] or 'none'}: "
        f"{m['mean_mm']:.0f} mm, silent {100 * m['silent']:.1f} %, withheld {100 * m['withheld']:.1f} %"
    )


HEADING = (
    f"{'trial':>5s} {'motion':13s}{'Hz':>5s}{'cams':>5s} {'camouflage':10s}{'mean mm':>8s}{'p95':>6s}{'silent':>8s}{'none':>7s}"
    f"{'1 std':>7s}{'2 std':>7s}{'3 std':>7s}{'IoU':>7s}{'worst':>7s}{'stature':>9s}{'lengths':>9s}"
)


def row(result):
    scene, m = result["scene"], result["metrics"]
    iou = list(m["cameras_iou"].values()) or [math.nan]
    lengths = [abs(v) for v in m["lengths"].values()] or [math.nan]
    return f"{result['trial']:5d} {scene['motion']['name']:13s}{scene['fps']:5g}{len(scene['camera']):5d} " f"{scene['camouflage'] or '-':10s}{m['mean_mm']:8.1f}{m['p95_mm']:6.0f}{100 * m['silent']:7.2f}%{100 * m['withheld']:6.1f}%" + "".join(
        f"{100 * m[f'within_{n}']:6.1f}%" for n in (1, 2, 3)
    ) + f"{np.mean(iou):7.3f}{min(iou):7.3f}{100 * m['stature']:+8.1f}%{100 * max(lengths):8.1f}%" + (
        f"  {result['problem']}" if result["problem"] else ""
    )


def summary(results):
    """The distribution over the trials."""
    judged = [r["metrics"] for r in results if "metrics" in r]
    values = lambda name: np.array([m[name] for m in judged], float)
    mean, iou = values("mean_mm"), [list(m["cameras_iou"].values()) for m in judged]
    lengths = [abs(v) for m in judged for v in m["lengths"].values()] or [math.nan]
    return {
        "median_mean_mm": float(np.nanmedian(mean)),
        "p95_mean_mm": float(np.nanpercentile(mean, 95)),
        "silent_percent": 100 * float(np.mean(values("silent"))),
        "withheld_percent": 100 * float(np.mean(values("withheld"))),
        **{f"within_{n}_std_fraction": float(np.nanmean(values(f"within_{n}"))) for n in (1, 2, 3)},
        "mean_iou": float(np.mean([v for camera in iou for v in camera])),
        "median_worst_camera_iou": float(np.median([min(camera) for camera in iou if camera])),
        "p5_worst_camera_iou": float(np.percentile([min(camera) for camera in iou if camera], 5)),
        "median_stature_percent": 100 * float(np.nanmedian(np.abs(values("stature")))),
        "p95_stature_percent": 100 * float(np.nanpercentile(np.abs(values("stature")), 95)),
        "median_length_percent": 100 * float(np.nanmedian(lengths)),
        "p95_length_percent": 100 * float(np.nanpercentile(lengths, 95)),
        "failed_trials": sum(bool(r["problem"]) for r in results),
    }


def badness(result):
    """Of a trial, for the worst ten: certain and wrong before uncertain and wrong before withheld."""
    m = result.get("metrics")
    if m is None:
        return math.inf
    return (0 if math.isnan(m["mean_mm"]) else m["mean_mm"]) + 2000 * m["silent"] + 300 * m["withheld"]


def report(sweep, results):
    ranked = sorted(results, key=badness, reverse=True)
    for result in ranked[WORST:]:
        (sweep.worst / f"{result['trial']:04d}.png").unlink(missing_ok=True)
    lines = [f"{len(results)} trials of seed {sweep.arguments.seed}", "", HEADING]
    lines += [row(r) if "metrics" in r else f"{r['trial']:5d} {r['problem']}" for r in results]
    lines += ["", *(f"{name:26s}{value:9.3f}" for name, value in summary(results).items())]
    groups = {
        "camouflaged": lambda s: bool(s["camouflage"]),
        "not camouflaged": lambda s: not s["camouflage"],
        "below 20 Hz": lambda s: s["fps"] < 20,
        "20 Hz and more": lambda s: s["fps"] >= 20,
        "three cameras": lambda s: len(s["camera"]) == 3,
    }
    for name, member in groups.items():
        members = [r for r in results if "metrics" in r and member(r["scene"])]
        if members:
            s = summary(members)
            lines.append(
                f"{name}: {len(members)} trials, median {s['median_mean_mm']:.1f} mm, 95th percentile {s['p95_mean_mm']:.1f} mm, "
                f"silent {s['silent_percent']:.2f} %, IoU {s['mean_iou']:.3f}"
            )
    lines += ["", f"worst {min(WORST, len(results))} (sheets in {sweep.worst}):"]
    lines += [
        f"{row(r)}  {', '.join(r['metrics']['worst_joints'])}" if "metrics" in r else f"{r['trial']:5d} {r['problem']}"
        for r in ranked[:WORST]
    ]
    (sweep.out / "report.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (sweep.out / "sweep.json").write_text(
        json.dumps({"summary": summary(results), "trials": results}, indent=1), encoding="utf-8"
    )
    print("\n".join(lines[lines.index(HEADING) + len(results) + 1 :]))


def list_masks(sweep, results):
    lines = ["trial,session,camouflage,motion,fps,problem"]
    for r in results:
        scene, session = r["scene"], sweep.trials / f"{r['trial']:04d}" / "session.toml"
        lines.append(
            f"{r['trial']},{session},{scene['camouflage']},{scene['motion']['name']},{scene['fps']},{r['problem']}"
        )
    (sweep.out / "masks.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{sweep.out / 'masks.csv'}: {len(results)} trials")


def judge_ci(results, update):
    judgement = Judgement(BOUNDS)
    values = summary(results)
    if values.pop("failed_trials"):
        print("FAILED", *(r["problem"] for r in results if r["problem"]), sep="\n")
        return 1
    values.pop("within_1_std_fraction")  # neither higher nor lower is better
    judgement.measure("ci", values, "sweep")
    if update:
        judgement.update()
        return 0
    return judgement.finish()


def parse():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="Number of the first trial")
    parser.add_argument("--seed", type=int, default=int(datetime.date.today().strftime("%Y%m%d")))
    parser.add_argument("--jobs", type=int, default=max(1, (os.cpu_count() or 1) // 2), help="Trials at a time")
    parser.add_argument("--out", type=Path, help="Folder of the report, the sheets and the trials")
    parser.add_argument("--keep", action="store_true", help="Keep the trials' folders")
    parser.add_argument("--masks", action="store_true", help="Only render, and keep the trials' folders")
    parser.add_argument("--lossless", action="store_true", help="Render lossless videos")
    parser.add_argument("--true-masks", action="store_true", help="Exact silhouettes instead of the images")
    parser.add_argument("--short", action="store_true", help="At most 60 frame sets each")
    parser.add_argument("--ci", action="store_true", help="The fixed set, compared with sweep_bounds.toml")
    parser.add_argument("--update", action="store_true", help="With --ci: write the bounds")
    parser.add_argument("--kinevox-process", type=Path)
    parser.add_argument("--kinevox-studio", type=Path)
    parser.add_argument("options", nargs="*", help="Of kinevox process, after --")
    arguments = parser.parse_args()
    if arguments.ci:
        arguments.seed = CI["seed"]
    return arguments


def main():
    arguments = parse()
    cv2.setNumThreads(1)
    trials = CI["trials"] if arguments.ci else range(arguments.first, arguments.first + arguments.trials)
    with tempfile.TemporaryDirectory() as scratch, ThreadPoolExecutor(arguments.jobs) as pool:
        sweep = Sweep(arguments, arguments.out or Path(scratch))
        if not arguments.masks:
            print(HEADING, flush=True)
        results = list(pool.map(sweep.one, trials))
        if arguments.masks:
            list_masks(sweep, results)
            return int(any(r["problem"] for r in results))
        report(sweep, results)
        return judge_ci(results, arguments.update) if arguments.ci else 0


if __name__ == "__main__":
    sys.exit(main())
