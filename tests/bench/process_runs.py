"""Runs of kinevox-process for the bench scripts: stage times of one run, sessions with fewer cameras."""
import csv
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "accuracy"))
from session_data import REPOSITORY, Session, data_folder, process_program  # noqa: E402,F401

STAGES = ["segmentation_ms", "tracking_ms", "hull_ms", "colouring_ms", "total_ms"]
RESULTS = REPOSITORY / "tests" / "bench" / "results"


def stage_times(program, session, *options):
    """{stage: times of every frame set in ms} of one run to the coloured volume; the first ten frame sets, which warm
    up, are excluded."""
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run(
            [str(program), str(session), "--out", folder + "/out", "--quiet", "--no-pose", *map(str, options)],
            check=True,
        )
        with open(folder + "/out/timing.csv", newline="") as f:
            rows = list(csv.DictReader(f))[10:]
    return {stage: np.array([float(row[stage]) for row in rows]) for stage in STAGES}


def quietest(program, session, repeats, *options):
    """The run with the smallest median, least disturbed by other programs."""
    runs = [stage_times(program, session, *options) for _ in range(repeats)]
    return min(runs, key=lambda run: np.median(run["total_ms"]))


def with_cameras(session_file, keep, folder):
    """A session file in `folder` with only the cameras whose numbers (from 0) are in `keep`."""
    session = Session(session_file)
    import tomllib

    with open(session_file, "rb") as f:
        data = tomllib.load(f)
    base = Path(session_file).resolve().parent
    lines = [f'name = "{session.name}"', f"fps = {session.fps}", f'calibration = "{base / data["calibration"]}"']
    for n in keep:
        camera = data["camera"][n]
        lines += [
            "",
            "[[camera]]",
            f'name = "{camera["name"]}"',
            f'video = "{base / camera["video"]}"',
            f'background = "{base / camera["background"]}"',
        ]
    file = Path(folder) / f"session_{len(keep)}.toml"
    file.write_text("\n".join(lines) + "\n")
    return file
