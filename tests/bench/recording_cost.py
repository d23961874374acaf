#!/usr/bin/python3
"""Cost of recording for the pipeline: rate, times and cores with and without it, on one source.

usage: recording_cost.py [--daemon kinevoxd] [--client kinevox] [--sequence walk] [--seconds 20] [--rounds 2]
                         [--codecs none,utvideo,ffv1,h264] [--pacing real_time] [--results FOLDER]

Runs kinevoxd on a studio sequence (4 x 640 x 480 at 30 frame sets per second, decoding included) that loops at its own
speed, alternately without and with a recording, and reads the daemon's statistics. Bound: with lossless recording the rate
falls by less than 15 %, and nothing is dropped. With --pacing as_fast_as_possible the pipeline uses all cores, and
the decrease of the rate shows the cost of the recording. Writes recording.md."""
import argparse
import os
import statistics
import sys
import tempfile
import time
from pathlib import Path

from process_runs import RESULTS
from recording_daemon import Daemon, add_arguments
from sustained import thread_times

MOST_FALL = 0.15
WARM_UP_S = 4


def measure(arguments, folder, codec):
    Path(folder).mkdir()
    recording = "" if codec == "none" else f'codec = "{codec}"\nmin_free_disk_mb = 0\n'
    daemon = Daemon(arguments, folder, pacing=arguments.pacing, recording=recording)
    try:
        daemon.wait_for_results()
        if codec != "none":
            daemon.client("record", "start", "cost")
        time.sleep(WARM_UP_S)
        first, cpu, begin = daemon.json("status"), thread_times(daemon.process.pid), time.monotonic()
        time.sleep(arguments.seconds)
        last, seconds = daemon.json("status"), time.monotonic() - begin
        used = sum(thread_times(daemon.process.pid).values()) - sum(cpu.values())
        row = {
            "codec": codec,
            "rate": (int(last["result_count"]) - int(first["result_count"])) / seconds,
            "cores": used / seconds,
            "total_ms": last["median_stage_times"]["total_ms"],
            "p99_ms": last["total_p99_ms"],
            "lost": int(last.get("lost_frame_set_count", 0)) - int(first.get("lost_frame_set_count", 0)),
            "dropped": 0,
            "mb_s": 0.0,
        }
        if codec != "none":
            stopped = daemon.json("record", "stop")["recording"]
            row["dropped"] = int(stopped.get("dropped_frame_set_count", 0))
            row["mb_s"] = int(stopped["size_bytes"]) / 1e6 / stopped["duration_s"]
            daemon.client("record", "delete", "cost", "--yes")
        return row
    finally:
        daemon.stop()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    add_arguments(parser)
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--codecs", default="none,utvideo,ffv1,h264")
    parser.add_argument("--pacing", default="real_time", choices=["real_time", "as_fast_as_possible"])
    parser.add_argument("--results", default=str(RESULTS))
    arguments = parser.parse_args()
    codecs = arguments.codecs.split(",")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for number in range(arguments.rounds):
            for codec in codecs:
                rows.append(measure(arguments, Path(folder) / f"{number}_{codec}", codec))
                print(rows[-1], flush=True)
    mean = {
        codec: {
            key: statistics.mean(row[key] for row in rows if row["codec"] == codec) for key in rows[0] if key != "codec"
        }
        for codec in codecs
    }
    lines = [
        f"Cost of recording: `tests/bench/recording_cost.py --seconds {arguments.seconds:g} --rounds {arguments.rounds}"
        f" --pacing {arguments.pacing}`, sequence {arguments.sequence}, {os.cpu_count()} cores; mean of the rounds. Load"
        f" at the end: {os.getloadavg()[0]:.1f}.",
        "",
        "| recording | frame sets per second | decrease | cores | total, median ms | total, p99 ms | lost before the recorder | dropped | MB/s |",
        "| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
    ]
    worst = 0.0
    for codec in codecs:
        m = mean[codec]
        fall = 1 - m["rate"] / mean[codecs[0]]["rate"]
        if codec == "utvideo":
            worst = fall
        lines.append(
            f"| {codec} | {m['rate']:.1f} | {100 * fall:.0f} % | {m['cores']:.2f} | {m['total_ms']:.1f} | {m['p99_ms']:.1f} |"
            f" {m['lost']:.0f} | {m['dropped']:.0f} | {m['mb_s']:.1f} |"
        )
    text = "\n".join(lines) + "\n"
    name = "recording.md" if arguments.pacing == "real_time" else "recording_full_speed.md"
    (Path(arguments.results) / name).write_text(text)
    print(text)
    return 1 if worst >= MOST_FALL else 0


if __name__ == "__main__":
    sys.exit(main())
