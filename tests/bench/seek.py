#!/usr/bin/python3
"""From a seek to the frame set of all cameras, in a ten-minute recording: H.264 from the studio, over and over.

usage: seek.py [--seek-times seek_times] [--studio kinevox-studio] [--minutes 10] [--seeks 200] [--results FOLDER]

Renders ten seconds of the virtual studio, four cameras of 640 x 480 px at 30 a second with a key frame a second, repeats
them without encoding them anew, and seeks to frames drawn at random with kinevox's replay source, as the daemon does.
Bound: 200 ms. Writes seek.md. The time that the pipeline then needs for the frame set is not in it (speed.md)."""
import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from process_runs import REPOSITORY, RESULTS

BOUND_MS = 200
SECONDS = 10


def main():
    build = REPOSITORY / "build" / "release"
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--seek-times", default=build / "tests/bench/seek_times")
    parser.add_argument("--studio", default=build / "server/tools/kinevox-studio")
    parser.add_argument("--minutes", type=int, default=10)
    parser.add_argument("--seeks", type=int, default=200)
    parser.add_argument("--results", type=Path, default=RESULTS)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="kinevox-seek-") as name:
        folder = Path(name) / "session"
        subprocess.run([options.studio, "--motion", "walk", "--frames", str(30 * SECONDS), "--background-frames", "3",
                        "--no-masks", "--out", folder], check=True, stdout=subprocess.DEVNULL)
        for video in sorted(folder.glob("cam*.mp4")):
            whole = video.with_name("long_" + video.name)
            subprocess.run([options.seek_times, "--lengthen", video, str(options.minutes * 60 // SECONDS), whole], check=True)
            whole.rename(video)
        told = subprocess.run([options.seek_times, folder / "session.toml", str(options.seeks)], check=True, text=True,
                              capture_output=True).stdout.split()
    frames, seeks, median, most, worst = int(told[0]), int(told[1]), *map(float, told[2:])
    text = (f"# Seeking\n\nFrom a seek to the frame set, all cameras; `tests/bench/seek.py`. Bound: {BOUND_MS} ms.\n\n"
            f"Four cameras of 640 x 480 px, H.264 with a key frame every 30, {frames} frame sets, {seeks} seeks to frames "
            f"drawn at random:\n\n| median, ms | 95 of 100, ms | worst, ms |\n| ---: | ---: | ---: |\n"
            f"| {median:.0f} | {most:.0f} | {worst:.0f} |\n")
    options.results.mkdir(parents=True, exist_ok=True)
    (options.results / "seek.md").write_text(text)
    print(text, end="")
    return 0 if worst <= BOUND_MS else 1


if __name__ == "__main__":
    sys.exit(main())
