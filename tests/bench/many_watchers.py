#!/usr/bin/python3
"""Many subscribers to one daemon: the capture rate they cost and the latency of their messages.

usage: many_watchers.py [--poses 25] [--volumes 25] [--stalled 0] [--source walk|studio] [--fps 30] [--seconds 20]
                        [--lossless] [--grpc] [--fast] [--max-latency-ms MS] [--max-delivery-ms MS] [--min-rate N] [--nice N]
                        [--results FOLDER] [--name many_watchers]

Starts kinevoxd on a studio sequence from shared/data at its own speed (or on the daemon's own virtual studio with small
images at --fps, for higher rates than the sequence's), measures its rate without subscribers, then with all of them
(tests/bench/watchers, each with its own connection, on the same machine; --grpc: with gRPC's client library, which takes
more CPU time than the daemon does). Latency is from the capture to the decoded message, delivery from its publication by
the daemon. Bounds: the rate falls by less than 10 %, the 99th percentile of the latency is at most --max-latency-ms (200)
and of the delivery --max-delivery-ms, no subscriber gets fewer than --min-rate messages per second. Appends to NAME.md.
--fast: as fast as possible; no CPU time is left for subscribers on the same machine, so no bound applies."""
import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from process_runs import REPOSITORY, RESULTS, data_folder

MAX_RATE_DROP = 0.10
BUILD = REPOSITORY / "build/release"


def source_of(arguments):
    if arguments.source == "studio":
        return (
            f'kind = "studio"\n[source.studio]\nmotion = "walk"\ncamera_count = 2\nwidth_px = 240\nheight_px = 180\n'
            f"fps = {arguments.fps}\n[pipeline]\nvoxel_mm = 20.0\n"
        )
    session = data_folder() / "studio" / arguments.source / "session.toml"
    pacing = "as_fast_as_possible" if arguments.fast else "real_time"
    return f'kind = "session"\nsession_file = "{session}"\npacing = "{pacing}"\nloop = true\n'


def status(address):
    run = subprocess.run(
        [BUILD / "client/cli/kinevox", "status", "--json", "--server", address, "--timeout", "20"],
        capture_output=True,
        text=True,
        check=True,
    )
    return json.loads(run.stdout)


def rate_over(address, seconds):
    """Results per second between two status requests, and the second status."""
    first, begin = status(address), time.monotonic()
    time.sleep(seconds)
    last, end = status(address), time.monotonic()
    return (int(last["result_count"]) - int(first.get("result_count", 0))) / (end - begin), last


def rss_mb(pid):
    text = Path(f"/proc/{pid}/status").read_text()
    return int(text.split("VmRSS:")[1].split()[0]) / 1024


def watchers(address, arguments, seconds):
    command = [
        BUILD / "tests/bench/watchers",
        "--server",
        address,
        "--poses",
        str(arguments.poses),
        "--volumes",
        str(arguments.volumes),
        "--stalled",
        str(arguments.stalled),
        "--seconds",
        str(seconds),
        "--warm-up",
        str(3 + arguments.poses / 200),
    ]
    return command + [f"--{name}" for name in ("lossless", "grpc") if getattr(arguments, name)]


def row(name, of):
    behind, delivery = of["behind_ms"], of["delivery_ms"]
    return (
        f"| {of['watchers']} {name} | {of['per_second']:.1f} | {of['min_per_second']:.1f} | {of['missed']} | {of['gaps']} "
        f"| {of['ended']} | {behind['p50']:.0f} | {behind['p99']:.0f} | {behind['max']:.0f} | {delivery['p50']:.1f} "
        f"| {delivery['p99']:.1f} | {delivery['max']:.1f} |"
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--poses", type=int, default=25)
    parser.add_argument("--volumes", type=int, default=25)
    parser.add_argument("--stalled", type=int, default=0)
    parser.add_argument("--source", default="walk")
    parser.add_argument("--fps", type=float, default=60.0)
    parser.add_argument("--seconds", type=float, default=20)
    parser.add_argument("--lossless", action="store_true")
    parser.add_argument("--grpc", action="store_true")
    parser.add_argument("--max-latency-ms", type=float, default=200.0)
    parser.add_argument("--max-delivery-ms", type=float, default=float("inf"))
    parser.add_argument("--min-rate", type=float, default=0)
    parser.add_argument("--nice", type=int, help="the daemon's priority; deploy/systemd gives -15")
    parser.add_argument("--fast", action="store_true")
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--name", default="many_watchers")
    arguments = parser.parse_args()
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder) / "kinevoxd.toml"
        config.write_text(
            '[server]\nlisten = "127.0.0.1:0"\n[pose]\ndatabase_file = ""\nauto_fit_body = false\n[calibration]\nfolder = ""\n'
            f'[recording]\nfolder = ""\n[log]\nlevel = "warning"\n[source]\n{source_of(arguments)}'
        )
        priority = ["nice", "-n", str(arguments.nice)] if arguments.nice is not None else []
        daemon = subprocess.Popen(
            [*priority, BUILD / "server/daemon/kinevoxd", "--config", config], stdout=subprocess.PIPE, text=True
        )
        try:
            address = daemon.stdout.readline().split()[-1]
            time.sleep(5)
            alone, _ = rate_over(address, min(arguments.seconds, 20))
            before_mb = rss_mb(daemon.pid)
            run = subprocess.Popen(watchers(address, arguments, arguments.seconds), stdout=subprocess.PIPE, text=True)
            time.sleep(3 + arguments.poses / 200)
            begun_mb = rss_mb(daemon.pid)
            watched, last = rate_over(address, max(arguments.seconds - 1, 1))
            during_mb = rss_mb(daemon.pid)
            got = json.loads(run.communicate()[0])
        finally:
            daemon.terminate()
            daemon.wait()
    fall = 1 - watched / alone
    lines = [
        f"{arguments.source}{', as fast as possible' if arguments.fast else ''}, "
        f"{len(os.sched_getaffinity(0))} cores for daemon and subscribers, {arguments.seconds:.0f} s, "
        f"{'lossless' if arguments.lossless else 'latest only'}, {arguments.stalled} stalled: {alone:.1f} results per second alone, "
        f"**{watched:.1f}** with subscribers ({100 * fall:+.1f} % less), {last.get('lost_frame_set_count', 0)} frame sets lost; memory {before_mb:.0f} MB "
        f"alone, {begun_mb:.1f} MB after all subscribed, {during_mb:.1f} MB at the end.",
        "",
        "| subscribers | messages/s | min per subscriber | missed | gaps | ended | latency p50, ms | p99 | max | delivery p50, ms | p99 | max |",
        "| --- |" + " ---: |" * 11,
    ]
    lines += [row(name, got[name]) for name in ("poses", "volumes") if got[name]["watchers"]]
    text = "\n".join(lines)
    print(text)
    arguments.results.mkdir(parents=True, exist_ok=True)
    with open(arguments.results / f"{arguments.name}.md", "a") as file:
        file.write(f"\n`tests/bench/many_watchers.py {' '.join(sys.argv[1:])}`\n\n{text}\n")
    failures = []
    if not arguments.fast:
        if fall > MAX_RATE_DROP:
            failures.append(f"the capture rate falls by {100 * fall:.1f} %")
        for name in [name for name in ("poses", "volumes") if got[name]["watchers"]]:
            behind, delivery = got[name]["behind_ms"]["p99"], got[name]["delivery_ms"]["p99"]
            if behind > arguments.max_latency_ms:
                failures.append(f"{name} have a latency of {behind:.0f} ms")
            if delivery > arguments.max_delivery_ms:
                failures.append(f"{name} take {delivery:.1f} ms to be delivered")
            if got[name]["min_per_second"] < arguments.min_rate:
                failures.append(f"one subscriber gets {got[name]['min_per_second']:.1f} {name} per second")
    failures += [
        f"{got[name]['ended']} subscriptions to {name} ended: {got[name]['why']}"
        for name in ("poses", "volumes")
        if got[name]["ended"]
    ]
    for failure in failures:
        print("FAILED:", failure)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
