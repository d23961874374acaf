#!/usr/bin/python3
"""Fault injection on the studio's daemon, repeated in random order: lost data and recovery times.

usage: faults.py [--minutes 60] [--round] [--phase-s 16] [--fps 60] [--size 240x180] [--seed 1] [--only FAULT ...]
                 [--nice N] [--times-slower N] [--build build/release] [--results [FOLDER]]

A round contains each fault once: kill -9, a hang, a full disk, clock steps of an hour, vanishing cameras, a CUDA error, two busy
loops per core; and an undisturbed phase. One daemon runs through all rounds; faults that end it, and those with cameras,
use separate daemons. The script acts as the service manager: it receives sd_notify, restarts, and sets the unit's priority
if permitted. Bounds: every recording opens and is complete (after a kill except for the last second), no daemon ends
unexpectedly, each daemon delivers results again, and with --minutes: the 99th percentile of the latency from capture to
result next to busy loops is at most twice the undisturbed one, and resident memory does not grow. --round: one round
without these two bounds, as a test. --times-slower: factor on all time limits, for builds with sanitizers.
The GPU is simulated on the CPU and fails on demand; only the daemon's clock is stepped (CLOCK_REALTIME). Needs
network and mount namespaces; exit status 77 without. --results appends to faults.md."""
import argparse
import os
import random
import signal
import sys
import tempfile
import threading
import time
import traceback
from pathlib import Path

import numpy as np

REPOSITORY = Path(__file__).resolve().parents[2]
os.environ.setdefault("GRPC_ENABLE_FORK_SUPPORT", "0")
sys.path[:0] = [str(REPOSITORY / "tests/support"), str(Path(__file__).resolve().parent)]
from live_rig import in_a_namespace  # noqa: E402
from process_runs import RESULTS  # noqa: E402
from service import unit_nice  # noqa: E402

MOST_TIMES_QUIET = 2.0
MOST_GROWTH_MB_H, MOST_MORE_MB = 2.0, 4.0
SETTLE_S = 2.0  # after the start of a phase
WARM_UP = 2  # rounds excluded from the memory's trend


class Latency:
    """From capture to result, as in the header of each pose; both run on the same clock."""

    def __init__(self, client):
        self.seen = []  # (monotonic, ms)
        self.client = client
        self.thread = threading.Thread(target=self._read, daemon=True)
        self.thread.start()

    def _read(self):
        try:
            for pose in self.client.poses("latest", reconnect=True):
                self.seen.append((time.monotonic(), 1e-6 * (pose.header.publish_time_ns - pose.header.capture_time_ns)))
        except Exception:  # noqa: BLE001  the daemon has ended
            pass

    def between(self, begin, end):
        return np.array([ms for at, ms in list(self.seen) if begin <= at < end])


class Tally:
    def __init__(self):
        self.times, self.recovered, self.notes, self.latency, self.memory = {}, {}, {}, {}, []
        self.failed = []

    def add(self, kind, found, latency, at_s, memory_mb):
        self.times[kind] = self.times.get(kind, 0) + 1
        if "recovered_s" in found:
            self.recovered.setdefault(kind, []).append(found["recovered_s"])
        self.notes[kind] = found.get("note", "")
        self.latency.setdefault(kind, []).append(latency)
        self.memory.append((kind, at_s, memory_mb))

    def growth(self):
        """MB per hour, and the increase in MB from the first to the last phase. The slope is the median over all pairs of phases of a
        kind (Theil-Sen), because memory grows in pages of 2 MB and a single one is no trend."""
        seen, kept = {}, {}
        for kind, at_s, mb in self.memory:
            seen[kind] = seen.get(kind, 0) + 1
            if seen[kind] > WARM_UP:
                kept.setdefault(kind, []).append((at_s / 3600, mb))
        slopes, more = [], []
        for phases in kept.values():
            at_h, mb = np.array(phases).T
            before, after = np.triu_indices(len(at_h), 1)
            slopes.extend((mb[after] - mb[before]) / (at_h[after] - at_h[before]))
            more.append(mb[-1] - mb[0])
        return (float(np.median(slopes)), float(np.median(more))) if len(slopes) > 2 else None

    def p(self, kind, part):
        values = np.concatenate(self.latency.get(kind) or [np.array([])])
        return float(np.quantile(values, part)) if len(values) else float("nan")

    def table(self):
        lines = [
            "| fault | count | recovery, median s | max s | latency p50, ms | p99 | memory, MB | last note |",
            "| --- | ---: | ---: | ---: | ---: | ---: | ---: | --- |",
        ]
        for kind in self.times:
            back = self.recovered.get(kind)
            text = f"{np.median(back):.2f} | {max(back):.2f}" if back else " | "
            mine = [mb for k, _, mb in self.memory if k == kind]
            late = f"{self.p(kind, .5):.1f} | {self.p(kind, .99):.1f}" if kind in ("quiet", "busy cores") else " | "
            lines.append(
                f"| {kind} | {self.times[kind]} | {text} | {late} | {min(mine):.0f} to {max(mine):.0f} | "
                f"last: {self.notes[kind] or '-'} |"
            )
        return "\n".join(lines)


def phase(rig, tally, latency, kind, act, seconds, begun):
    at = time.monotonic()
    lives = len(rig.main.service.ends)
    try:
        found = act(rig, seconds)
        if len(rig.main.service.ends) != lives:
            raise RuntimeError(f"the main daemon has ended: {rig.main.service.ends}")
    except Exception as error:  # noqa: BLE001  each is a finding; the hour continues
        tally.failed.append(f"{kind}: {error}")
        print(f"FAILED {kind}: {type(error).__name__}: {error}", flush=True)
        if not type(error).__name__ == "Violated":
            traceback.print_exc()
        said = Path(rig.main.service.log.name).read_text().splitlines()
        print("\n".join(["the daemon's last log lines:", *said[-25:]]), flush=True)
        rig.repair()
        return
    tally.add(kind, found, latency.between(at + SETTLE_S, time.monotonic()), time.monotonic() - begun, rig.main_mb())
    text = ", ".join(f"{name} {value:.2f}" if isinstance(value, float) else f"{value}" for name, value in found.items())
    now = time.monotonic()
    print(f"{now - begun:6.0f} s  {kind:15} {now - at:5.1f} s  {rig.main_mb():5.0f} MB  {text}", flush=True)


def bounds(tally, with_figures):
    lines = []
    if with_figures and tally.times.get("busy cores") and tally.times.get("quiet"):
        ratio = tally.p("busy cores", 0.99) / tally.p("quiet", 0.99)
        lines.append(
            f"latency next to busy cores: 99th percentile {ratio:.2f} times the undisturbed one "
            f"(at most {MOST_TIMES_QUIET:g})"
        )
        if not ratio <= MOST_TIMES_QUIET:
            tally.failed.append(lines[-1])
    if with_figures and (growth := tally.growth()):
        slope, more = growth
        lines.append(
            f"resident memory: {slope:+.2f} MB per hour (at most {MOST_GROWTH_MB_H:g}), {more:+.1f} MB from "
            f"round {WARM_UP + 1} to the last (at most {MOST_MORE_MB:g})"
        )
        if slope > MOST_GROWTH_MB_H or more > MOST_MORE_MB:
            tally.failed.append(lines[-1])
    return lines


def run(arguments, folder):
    from fault_kinds import FAULTS, quiet  # they need the built client
    from fault_rig import Rig

    rig = Rig(
        arguments.build,
        folder,
        random.Random(arguments.seed),
        arguments.nice,
        arguments.size,
        arguments.fps,
        arguments.phase_s,
        arguments.times_slower,
    )
    tally, begun, rounds = Tally(), time.monotonic(), 0
    try:
        from kinevox import Client

        latency = Latency(Client(rig.main.service.address, timeout_s=30))
        while rounds == 0 or (not arguments.round and time.monotonic() - begun < 60 * arguments.minutes):
            kinds = [*(arguments.only or FAULTS), "quiet"]
            rig.random.shuffle(kinds)
            for kind in kinds:
                phase(rig, tally, latency, kind, quiet if kind == "quiet" else FAULTS[kind], arguments.phase_s, begun)
            rounds += 1
    finally:
        status = rig.close()
    if status != 0 or len(rig.main.service.ends) != 1:
        tally.failed.append(f"the main daemon ended with {rig.main.service.ends}")
    return tally, rounds, time.monotonic() - begun


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--round", action="store_true")
    parser.add_argument("--phase-s", type=float, default=16)
    parser.add_argument("--fps", type=float, default=60)
    parser.add_argument("--size", default="240x180", type=lambda text: tuple(int(part) for part in text.split("x")))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", action="append", help="name of a fault; repeatable")
    parser.add_argument("--times-slower", type=float, default=1)
    parser.add_argument("--nice", type=int, help="priority (default: the unit's)")
    parser.add_argument("--build", type=Path, default=REPOSITORY / "build/release")
    parser.add_argument("--results", type=Path, nargs="?", const=RESULTS)
    arguments = parser.parse_args()
    arguments.build = arguments.build.resolve()
    in_a_namespace(3, mounts=True)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # so that no daemon is left
    sys.path.insert(0, str(arguments.build / "client/python"))
    if arguments.nice is None:
        arguments.nice = unit_nice()
    load = os.getloadavg()[0]
    with tempfile.TemporaryDirectory() as folder:
        tally, rounds, seconds = run(arguments, folder)
    head = (
        f"{rounds} rounds in {seconds / 60:.1f} minutes, {len(os.sched_getaffinity(0))} cores, load {load:.1f} at the start; "
        f"3 cameras of {arguments.size[0]}x{arguments.size[1]} px, {arguments.fps:g} per second; "
        f"{'default priority' if arguments.nice is None else f'nice {arguments.nice}'}."
    )
    text = "\n".join(
        [
            head,
            "",
            tally.table(),
            "",
            *(f"- {line}" for line in bounds(tally, not arguments.round)),
            *(f"- **failed**: {what}" for what in tally.failed),
        ]
    )
    print(f"\n{text}")
    if arguments.results:
        arguments.results.mkdir(parents=True, exist_ok=True)
        file = arguments.results / "faults.md"
        command = " ".join([f"tests/bench/{Path(__file__).name}", *sys.argv[1:]])
        file.write_text((file.read_text() if file.exists() else "# Faults\n") + f"\n`{command}`\n\n{text}\n")
    return 1 if tally.failed else 0


if __name__ == "__main__":
    sys.exit(main())
