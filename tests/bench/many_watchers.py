#!/usr/bin/python3
"""Many watchers on one daemon: what the capture loses by them and how late they get their messages.

usage: many_watchers.py [--poses 25] [--volumes 25] [--stalled 0] [--source walk|studio] [--fps 30] [--seconds 20]
                        [--lossless] [--grpc] [--fast] [--most-behind MS] [--most-delivery MS] [--fewest N] [--nice N]
                        [--results FOLDER] [--name many_watchers]

Starts kinevoxd on a studio sequence from shared/data at its own speed (or on the daemon's own virtual studio with small
pictures at --fps, where poses are wanted faster than the sequence has them), reads its rate with nobody watching, then
with all of them (tests/bench/watchers, each on a connection of its own, on the same machine; --grpc: with the client of
gRPC's own library, which takes more of the processor than the daemon spends on it). "Behind" counts from the
capture to the message decoded in the watcher; "delivery" from the moment the daemon had it ready. Bounds: the rate falls by
less than 10 %, 99 of 100 messages are at most --most-behind (200) and delivered within --most-delivery, nobody gets fewer
than --fewest a second. Appends to NAME.md. --fast: the recording as fast as it
goes; the daemon has then no processor time to spare for watchers on the same machine, so no bound is asked for."""
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

MOST_FALL = 0.10
BUILD = REPOSITORY / "build/release"


def source_of(arguments):
    if arguments.source == "studio":
        return (f'kind = "studio"\n[source.studio]\nmotion = "walk"\ncameras = 2\nwidth = 240\nheight = 180\n'
                f'fps = {arguments.fps}\n[pipeline]\nvoxel_mm = 20.0\n')
    session = data_folder() / "studio" / arguments.source / "session.toml"
    pacing = "as_fast_as_possible" if arguments.fast else "real_time"
    return f'kind = "session"\nsession = "{session}"\npacing = "{pacing}"\nloop = true\n'


def status(address):
    run = subprocess.run([BUILD / "client/cli/kinevox", "status", "--json", "--server", address, "--timeout", "20"],
                         capture_output=True, text=True, check=True)
    return json.loads(run.stdout)


def rate_over(address, seconds):
    """Results a second between two looks, and the status of the second."""
    first, begin = status(address), time.monotonic()
    time.sleep(seconds)
    last, end = status(address), time.monotonic()
    return (int(last["results"]) - int(first.get("results", 0))) / (end - begin), last


def rss_mb(pid):
    text = Path(f"/proc/{pid}/status").read_text()
    return int(text.split("VmRSS:")[1].split()[0]) / 1024


def watchers(address, arguments, seconds):
    command = [BUILD / "tests/bench/watchers", "--server", address, "--poses", str(arguments.poses), "--volumes",
               str(arguments.volumes), "--stalled", str(arguments.stalled), "--seconds", str(seconds), "--warm-up",
               str(3 + arguments.poses / 200)]
    return command + [f"--{name}" for name in ("lossless", "grpc") if getattr(arguments, name)]


def row(name, of):
    behind, delivery = of["behind_ms"], of["delivery_ms"]
    return (f"| {of['watchers']} {name} | {of['per_second']:.1f} | {of['fewest_per_second']:.1f} | {of['missed']} | {of['gaps']} "
            f"| {of['ended']} | {behind['p50']:.0f} | {behind['p99']:.0f} | {behind['max']:.0f} | {delivery['p50']:.1f} "
            f"| {delivery['p99']:.1f} | {delivery['max']:.1f} |")


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
    parser.add_argument("--most-behind", type=float, default=200.0)
    parser.add_argument("--most-delivery", type=float, default=float("inf"))
    parser.add_argument("--fewest", type=float, default=0)
    parser.add_argument("--nice", type=int, help="the daemon's priority; deploy/systemd gives -15")
    parser.add_argument("--fast", action="store_true")
    parser.add_argument("--results", type=Path, default=RESULTS)
    parser.add_argument("--name", default="many_watchers")
    arguments = parser.parse_args()
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    resource.setrlimit(resource.RLIMIT_NOFILE, (hard, hard))
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder) / "kinevoxd.toml"
        config.write_text('[server]\nlisten = "127.0.0.1:0"\n[pose]\ndatabase = ""\nfit_body = false\n[calibration]\nfolder = ""\n'
                          f'[recording]\nfolder = ""\n[log]\nlevel = "warning"\n[source]\n{source_of(arguments)}')
        priority = ["nice", "-n", str(arguments.nice)] if arguments.nice is not None else []
        daemon = subprocess.Popen([*priority, BUILD / "server/daemon/kinevoxd", "--config", config], stdout=subprocess.PIPE, text=True)
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
    lines = [f"{arguments.source}{', as fast as it goes' if arguments.fast else ''}, "
             f"{len(os.sched_getaffinity(0))} cores for daemon and watchers, {arguments.seconds:.0f} s, "
             f"{'lossless' if arguments.lossless else 'latest only'}, {arguments.stalled} stalled: {alone:.1f} results a second alone, "
             f"**{watched:.1f}** watched ({100 * fall:+.1f} % less), {last.get('lost', 0)} frame sets lost; memory {before_mb:.0f} MB "
             f"alone, {begun_mb:.1f} MB when all had begun, {during_mb:.1f} MB at the end.", "",
             "| watchers | messages/s | fewest of one | missed | gaps | ended | behind p50, ms | p99 | max | delivery p50, ms | p99 | max |",
             "| --- |" + " ---: |" * 11]
    lines += [row(name, got[name]) for name in ("poses", "volumes") if got[name]["watchers"]]
    text = "\n".join(lines)
    print(text)
    arguments.results.mkdir(parents=True, exist_ok=True)
    with open(arguments.results / f"{arguments.name}.md", "a") as file:
        file.write(f"\n`tests/bench/many_watchers.py {' '.join(sys.argv[1:])}`\n\n{text}\n")
    failures = []
    if not arguments.fast:
        if fall > MOST_FALL:
            failures.append(f"the capture rate falls by {100 * fall:.1f} %")
        for name in [name for name in ("poses", "volumes") if got[name]["watchers"]]:
            behind, delivery = got[name]["behind_ms"]["p99"], got[name]["delivery_ms"]["p99"]
            if behind > arguments.most_behind:
                failures.append(f"{name} are {behind:.0f} ms behind")
            if delivery > arguments.most_delivery:
                failures.append(f"{name} take {delivery:.1f} ms to be delivered")
            if got[name]["fewest_per_second"] < arguments.fewest:
                failures.append(f"one gets {got[name]['fewest_per_second']:.1f} {name} a second")
    failures += [f"{got[name]['ended']} subscriptions to {name} ended: {got[name]['why']}" for name in ("poses", "volumes")
                 if got[name]["ended"]]
    for failure in failures:
        print("FAILED:", failure)
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
