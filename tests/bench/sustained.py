#!/usr/bin/python3
"""The whole daemon at full speed: kinevoxd on a recording, as fast as possible, with one subscriber.

usage: sustained.py [--daemon kinevoxd] [--client kinevox] [--sequence walk] [--stream angles] [--seconds 20]
                    [--builds-beside] [--results FOLDER]

Starts kinevoxd on a studio sequence that loops, decoding included, and `kinevox stream`; after a warm-up reads
the daemon's statistics for --seconds. The CPU time of the threads shows how the cores are used.
The pose database and the body fit, which run once, are excluded unless --builds-beside. Bound: 50 frame sets per
second. Writes sustained.md."""
import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from process_runs import REPOSITORY, RESULTS, data_folder

MIN_RATE = 50.0
WARM_UP_S = 6
STAGES = ["decode", "segmentation", "tracking", "hull", "colouring", "pose", "total"]


def thread_times(pid):
    """{thread name: CPU seconds}, summed over threads of one name."""
    times = {}
    for task in Path(f"/proc/{pid}/task").iterdir():
        try:
            text = (task / "stat").read_text()
        except OSError:
            continue
        name = text[text.index("(") + 1 : text.rindex(")")]
        fields = text[text.rindex(")") + 2 :].split()
        times[name] = times.get(name, 0) + (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
    return times


def status(client, address):
    run = subprocess.run([client, "status", "--json", "--server", address], capture_output=True, text=True, check=True)
    return json.loads(run.stdout)


def measure(arguments, folder):
    session = data_folder() / "studio" / arguments.sequence / "session.toml"
    pose = "" if arguments.builds_beside else '[pose]\ndatabase_file = ""\nauto_fit_body = false\n'
    if arguments.builds_beside:
        pose = '[pose]\ndatabase_file = "poses.kvxposes"\n'
    config = Path(folder) / "kinevoxd.toml"
    config.write_text(
        f'[server]\nlisten = "127.0.0.1:0"\n[source]\nkind = "session"\nsession_file = "{session}"\n'
        f'pacing = "as_fast_as_possible"\nloop = true\n{pose}[log]\nlevel = "warning"\n'
    )
    daemon = subprocess.Popen([arguments.daemon, "--config", str(config)], stdout=subprocess.PIPE, text=True)
    try:
        address = daemon.stdout.readline().split()[-1]
        out = Path(folder) / "stream.jsonl"
        with open(out, "w") as file:
            stream = subprocess.Popen([arguments.client, "stream", arguments.stream, "--server", address], stdout=file)
        try:
            time.sleep(WARM_UP_S)
            first, cpu, begin = status(arguments.client, address), thread_times(daemon.pid), time.monotonic()
            lines_before = len(out.read_text().splitlines())
            time.sleep(arguments.seconds)
            seconds, last = time.monotonic() - begin, status(arguments.client, address)
            used = {name: (spent - cpu.get(name, 0)) / seconds for name, spent in thread_times(daemon.pid).items()}
        finally:
            stream.terminate()
            stream.wait()
        received = out.read_text().splitlines()[lines_before:]
    finally:
        daemon.terminate()
        daemon.wait()
    return first, last, seconds, used, received


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--daemon", default=str(REPOSITORY / "build/release/server/daemon/kinevoxd"))
    parser.add_argument("--client", default=str(REPOSITORY / "build/release/client/cli/kinevox"))
    parser.add_argument("--sequence", default="walk")
    parser.add_argument("--stream", default="angles", choices=["angles", "joints", "volumes"])
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--builds-beside", action="store_true")
    parser.add_argument("--results", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        first, last, seconds, used, received = measure(arguments, folder)
    number = lambda state, key: int(state.get(key, 0))
    rate = (number(last, "result_count") - number(first, "result_count")) / seconds
    missed = sum(
        int(json.loads(line).get("missed_count", 0)) for line in received if line.startswith("{") and line.endswith("}")
    )
    median = last["median_stage_times"]
    lines = [
        f"{arguments.sequence}, {len(os.sched_getaffinity(0))} cores, one subscriber to {arguments.stream}, "
        f"{seconds:.0f} s: **{rate:.1f} frame sets per second**, {number(last, 'lost_frame_set_count') - number(first, 'lost_frame_set_count')} lost; "
        f"the subscriber got {len(received) / seconds:.1f} per second and missed {missed}.",
        "",
        "| " + " | ".join(f"{stage}, ms" for stage in STAGES) + " | p99 total, ms |",
        "| " + "---: | " * (len(STAGES) + 1),
        "| "
        + " | ".join(f"{median.get(stage + '_ms', 0):.2f}" for stage in STAGES)
        + f" | {last['total_p99_ms']:.1f} |",
        "",
        f"CPU time, cores: {sum(used.values()):.2f} in total; "
        + ", ".join(
            f"{name} {cores:.2f}" for name, cores in sorted(used.items(), key=lambda item: -item[1]) if cores >= 0.01
        )
        + ".",
    ]
    text = "\n".join(lines)
    print(text)
    arguments.results.mkdir(parents=True, exist_ok=True)
    name = "sustained.md"
    command = "tests/bench/sustained.py " + " ".join(sys.argv[1:])
    (arguments.results / name).write_text(
        f"# The daemon at full speed\n\nMedians of the stages; `{command.strip()}`\n\n{text}\n"
    )
    if rate < MIN_RATE:
        print(f"FAILED: {rate:.1f} frame sets per second; at least {MIN_RATE:.0f} are required")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
