#!/usr/bin/env python3
"""The real trial (balancing): every frame set has a volume of 50 to 150 litres; fails otherwise.

usage: real_trial.py [--program kinevox-process] [--results FOLDER] [--image SHEET.png]

Also fails if the volume's top is not at the head's height (1.75 m, on a beam). Head, hands and feet are checked by eye:
--image writes overlay.py's sheet."""
import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np

from session_data import REPOSITORY, data_folder, process_program, read_table

LITRES = (50, 150)
FRAMES = 100


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--program", type=Path)
    parser.add_argument("--results", type=Path, help="keep the results here")
    parser.add_argument("--image", type=Path)
    arguments = parser.parse_args()
    session = data_folder() / "balancing" / "session.toml"
    if not session.exists():
        print(f"skipped: {session} is not here; set KINEVOX_TEST_DATA")
        return 77
    with tempfile.TemporaryDirectory() as folder:
        out = arguments.results or Path(folder)
        save = ["--save", "silhouettes,volumes"] if arguments.image else []
        subprocess.run(
            [str(arguments.program or process_program()), str(session), "--out", str(out), *save], check=True
        )
        volume, iou = read_table(out / "volume.csv"), read_table(out / "silhouette_iou.csv")
        if arguments.image:
            subprocess.run(
                [
                    sys.executable,
                    str(REPOSITORY / "tests/accuracy/overlay.py"),
                    str(session),
                    str(out),
                    str(arguments.image),
                    "--frames",
                    "0,33,66,99",
                    "--crop",
                ],
                check=True,
            )
    litres = volume["volume_litres"]
    print(
        f"{len(litres)} frame sets, {np.isfinite(litres).sum()} with a volume: {np.nanmin(litres):.1f} to "
        f"{np.nanmax(litres):.1f} litres, median {np.nanmedian(litres):.1f}"
    )
    print(
        f"top {np.nanmin(volume['max_z']):.2f} to {np.nanmax(volume['max_z']):.2f} m, "
        f"bottom {np.nanmin(volume['min_z']):.2f} to {np.nanmax(volume['min_z']):.2f} m"
    )
    for camera in list(iou)[2:]:
        print(f"silhouette IoU {camera}: median {np.nanmedian(iou[camera]):.3f}, min {np.nanmin(iou[camera]):.3f}")
    problems = []
    if len(litres) != FRAMES:
        problems.append(f"{len(litres)} frame sets instead of {FRAMES}")
    bad = np.flatnonzero(~((litres >= LITRES[0]) & (litres <= LITRES[1])))
    if len(bad):
        problems.append(f"{len(bad)} frame sets outside {LITRES[0]} to {LITRES[1]} litres: {bad[:10].tolist()}")
    if np.nanmin(volume["max_z"]) < 1.5 or np.nanmax(volume["max_z"]) > 2.1:
        problems.append("the top is not at the head's height")
    for problem in problems:
        print("FAILED:", problem)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
