#!/usr/bin/python3
"""Four fake GigE Vision cameras, 640x480 at 30 images per second over loopback, and a daemon.

usage: live_cameras.py [--minutes 10] [--restarts 5] [--loss 0.01] [--jitter-ms 50] [--only source|steady|restarts|losses ...]
                       [--full] [--results FOLDER]

Four tests, one after the other:
  source    --minutes of the camera source only, without the pipeline
  steady    the whole daemon, --minutes without a fault: no frame set lost, skew known, constant memory
  restarts  one camera is unplugged and plugged in again --restarts times, while packets of all cameras are lost and delayed
  losses    no pipeline, a test pattern: every byte of every image is compared with the sent one, with delayed, reordered
            and lost packets, and with lost images
The scene is the studio's walk; the background is learned live. Without --full there are no poses and voxels are 20 mm, so that
the results measure the cameras and not the pipeline. Exits with 1 if a bound is not met. Writes live_cameras.md."""
import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
from live_rig import (
    BUILD,
    Daemon,
    FakeCamera,
    cameras_toml,
    event_time_ns,
    in_a_namespace,
    resident_mb,
    wait_until,
)  # noqa: E402

sys.path.insert(0, str(Path(__file__).resolve().parent))
from process_runs import RESULTS, data_folder  # noqa: E402

NAMES = ["cam1", "cam2", "cam3", "cam4"]
PERIOD_S = 1 / 30
LIGHT = "[pipeline]\nvoxel_mm = 20\n[pose]\nenabled = false\n"
FULL = '[pose]\ndatabase_file = ""\nauto_fit_body = false\n'
CAMERAS = 'trigger = "external"\npixel_format = "BayerRG8"\nexposure_us = 4000\n'
WAYS = [
    "image_count",
    "lost_image_count",
    "incomplete_image_count",
    "late_image_count",
    "unmatched_image_count",
    "warmup_image_count",
]


class Bounds:
    def __init__(self):
        self.rows, self.failed = [], []

    def add(self, proof, what, seen, bound, kept):
        self.rows.append(f"| {proof} | {what} | {seen} | {bound} | {'yes' if kept else '**no**'} |")
        print(f"{'ok  ' if kept else 'FAIL'} {proof}: {what}: {seen} ({bound})", flush=True)
        if not kept:
            self.failed.append(what)


def number(value):
    return int(value or 0)


def start_all(arguments, folder, options):
    session = data_folder() / "studio/walk/session.toml"
    empty = Path(folder) / "empty"
    empty.touch()
    cameras = [
        FakeCamera(arguments.fake, n, ["--session", session, "--camera", name, "--empty-while", empty, *options])
        for n, name in enumerate(NAMES, 1)
    ]
    text = cameras_toml(NAMES, session.parent / "calibration.toml", CAMERAS) + (FULL if arguments.full else LIGHT)
    daemon = Daemon(folder, text, arguments.daemon, arguments.client)
    wait_until("all cameras deliver", lambda: all(link and link["connected"] for link in daemon.connections()), 60)
    daemon.kinevox("learn-background", "--frames", "30")
    empty.unlink()
    wait_until("a subject is tracked", lambda: daemon.status().get("subjects"), 60)
    return cameras, daemon


def steady(arguments, bounds):
    with tempfile.TemporaryDirectory() as folder:
        cameras, daemon = start_all(arguments, folder, [])
        before, begin, memory, tracked = daemon.status(), time.monotonic(), [], []
        while time.monotonic() - begin < arguments.minutes * 60:
            time.sleep(2)
            memory.append((time.monotonic() - begin, daemon.resident_mb()))
            tracked.append(bool(daemon.status().get("subjects")))
        after, seconds = daemon.status(), time.monotonic() - begin
        daemon.stop()
        for camera in cameras:
            camera.vanish()
    sets = number(after["result_count"]) - number(before["result_count"])
    lost = number(after["lost_frame_set_count"]) - number(before["lost_frame_set_count"])
    bounds.add("steady", f"frame sets lost of {sets + lost} in {seconds / 60:.1f} minutes", lost, "0", lost == 0)
    links = list(zip(before["cameras"], after["cameras"]))
    for way in WAYS[1:5]:
        grown = sum(number(new["connection"][way]) - number(old["connection"][way]) for old, new in links)
        bounds.add("steady", f"{way}", grown, "0", grown == 0)
    skews = [new["connection"]["max_abs_skew_ms"] for _, new in links]
    bounds.add(
        "steady",
        "max skew of the latest 128 sets, ms, per camera",
        ", ".join(f"{s:.2f}" for s in skews),
        "known",
        all(s is not None for s in skews),
    )
    drifts = [new["connection"]["clock_drift_ppm"] for _, new in links]
    bounds.add(
        "steady", "estimated clock drift, ppm (true: 20, 40, 60, 80)", ", ".join(f"{d:.0f}" for d in drifts), "-", True
    )
    memory_bound(bounds, "steady", memory, seconds)
    bounds.add(
        "steady", "status requests with a tracked subject, %", f"{100 * sum(tracked) / len(tracked):.1f}", "-", True
    )


def source(arguments, bounds):
    """The camera source only, without the pipeline."""
    session, seconds = data_folder() / "studio/walk/session.toml", arguments.minutes * 60
    with tempfile.TemporaryDirectory() as folder:
        cameras = [
            FakeCamera(arguments.fake, n, ["--session", session, "--camera", name]) for n, name in enumerate(NAMES, 1)
        ]
        config = Path(folder) / "cameras.toml"
        config.write_text(cameras_toml(NAMES, session.parent / "calibration.toml", CAMERAS))
        begin, memory = time.monotonic(), []
        probe = subprocess.Popen(
            [arguments.probe, config, "--seconds", str(seconds)], stdout=subprocess.PIPE, text=True
        )
        while probe.poll() is None:
            time.sleep(1)
            if resident := resident_mb(probe.pid):
                memory.append((time.monotonic() - begin, resident))
        seen = json.loads(probe.stdout.read().splitlines()[-1])
        for camera in cameras:
            camera.vanish()
    sets, gaps = seen["sets"], seen["gaps"]
    bounds.add("source", f"frame sets lost of {sets + gaps} in {seconds / 60:.1f} minutes", gaps, "0", gaps == 0)
    begin_sets = 15  # until all four have connected and their clocks are known
    bounds.add(
        "source",
        f"sets with a missing image, after the first {begin_sets}",
        max(0, sets - seen["complete"] - begin_sets),
        "0",
        sets - seen["complete"] <= begin_sets,
    )
    links = seen["cameras"]
    bounds.add(
        "source",
        "max skew of the latest 128 sets, ms, per camera",
        ", ".join(f"{link['max_abs_skew_ms']:.2f}" for link in links),
        "known",
        True,
    )
    bounds.add(
        "source",
        "estimated clock drift, ppm (true: 20, 40, 60, 80)",
        ", ".join(f"{link['clock_drift_ppm']:.0f}" for link in links),
        "-",
        True,
    )
    memory_bound(bounds, "source", memory, seconds)
    accounted(bounds, "source", cameras, links)


def memory_bound(bounds, proof, memory, seconds):
    later = [mb for at, mb in memory if at >= min(60, seconds / 2)]
    growth = max(later) - later[0]
    bounds.add(
        proof, f"memory growth after the first minute, MB, of {later[0]:.0f}", f"{growth:.1f}", "< 10", growth < 10
    )


def restarts(arguments, bounds):
    options = ["--loss", arguments.loss, "--jitter-ms", arguments.jitter_ms]
    named, rejoined, pauses = [], [], []
    with tempfile.TemporaryDirectory() as folder:
        cameras, daemon = start_all(arguments, folder, options)
        victim = cameras[2]
        for _ in range(arguments.restarts):
            at_ns = time.time_ns()
            victim.vanish()
            wait_until(
                "the disconnection is reported",
                lambda: any(event_time_ns(e) > at_ns for e in daemon.events("camera_disconnected")),
                10,
            )
            named.append(
                (
                    min(event_time_ns(e) for e in daemon.events("camera_disconnected") if event_time_ns(e) > at_ns)
                    - at_ns
                )
                / 1e9
            )
            pauses.append(max_pause(daemon, 2))
            at_ns = time.time_ns()
            victim.start()
            wait_until(
                "the camera is reconnected",
                lambda: any(event_time_ns(e) > at_ns for e in daemon.events("camera_reconnected")),
                30,
            )
            rejoined.append(
                (min(event_time_ns(e) for e in daemon.events("camera_reconnected") if event_time_ns(e) > at_ns) - at_ns)
                / 1e9
            )
            time.sleep(3)
        end = daemon.status()
        events = daemon.events()
        daemon.stop()
        for camera in cameras:
            camera.vanish()
    bounds.add(
        "restarts", "disconnection reported after, s", ", ".join(f"{s:.2f}" for s in named), "< 1", max(named) < 1
    )
    bounds.add(
        "restarts", "reconnected after its return, s", ", ".join(f"{s:.1f}" for s in rejoined), "automatically", True
    )
    bounds.add(
        "restarts",
        "max time without a result meanwhile, s",
        ", ".join(f"{s:.2f}" for s in pauses),
        "< 1: the others continue",
        max(pauses) < 1,
    )
    order = [e["kind"] for e in events if e["kind"] in ("camera_disconnected", "camera_reconnected")]
    bounds.add(
        "restarts",
        "events disconnected, reconnected, ...",
        f"{len(order)} events",
        "in this order",
        order == ["camera_disconnected", "camera_reconnected"] * arguments.restarts,
    )
    others = [e for e in events if e["kind"] == "camera_disconnected" and e["camera"] != "cam3"]
    bounds.add("restarts", "other cameras reported as disconnected", len(others), "0", not others)
    accounted(bounds, "restarts", cameras, [camera["connection"] for camera in end["cameras"]])
    # Without the unplugged camera: packets in flight at that time cannot be resent.
    complete_fraction(
        bounds, "restarts", [camera["connection"] for camera in end["cameras"] if camera["name"] != "cam3"]
    )
    victim_link = end["cameras"][2]["connection"]
    bounds.add(
        "restarts",
        "images of the unplugged camera: complete / incomplete / late / lost",
        " / ".join(
            str(number(victim_link[way]))
            for way in ("image_count", "incomplete_image_count", "late_image_count", "lost_image_count")
        ),
        "-",
        True,
    )


def max_pause(daemon, seconds):
    """The longest time between two results, from repeated status requests."""
    end, longest = time.monotonic() + seconds, 0.0
    results, since = number(daemon.status()["result_count"]), time.monotonic()
    while time.monotonic() < end:
        now = number(daemon.status()["result_count"])
        longest = max(longest, time.monotonic() - since)
        if now != results:
            results, since = now, time.monotonic()
    return longest


def accounted(bounds, proof, cameras, links):
    """Every sent image is counted once, except a few that were in flight when a camera or the daemon ended."""
    sent = [camera.total("taken") for camera in cameras]
    counted = [sum(number(link[way]) for way in WAYS) for link in links]
    slack = [10 * len(camera.counts) + camera.total("under_way") for camera in cameras]
    bounds.add(
        proof,
        "images sent / counted, per camera",
        ", ".join(f"{s}/{c}" for s, c in zip(sent, counted)),
        "equal except images in flight at the end",
        all(0 <= s - c <= most for s, c, most in zip(sent, counted, slack)),
    )


def complete_fraction(bounds, proof, links):
    whole = sum(
        number(link["image_count"]) + number(link["unmatched_image_count"]) + number(link["warmup_image_count"])
        for link in links
    )
    every = sum(number(link[way]) for link in links for way in WAYS)
    resent = sum(number(link["resent_packet_count"]) for link in links)
    bounds.add(
        proof,
        f"images complete, %, of {every}, with {resent} packets resent",
        f"{100 * whole / every:.3f}",
        ">= 99.9",
        whole >= 0.999 * every,
    )


def losses(arguments, bounds):
    seconds = max(10, min(30, arguments.minutes * 60 / 5))
    cases = [
        ("loss", ["--loss", arguments.loss], True),
        ("loss and jitter", ["--loss", arguments.loss, "--jitter-ms", arguments.jitter_ms], True),
        ("loss and packets out of order by 10 ms", ["--loss", arguments.loss, "--reorder-ms", 10], True),
        ("5 % of the images lost completely", ["--lost-images", 0.05, "--first-block", 65400], False),
    ]
    for proof, options, resend_helps in cases:
        with tempfile.TemporaryDirectory() as folder:
            cameras = [FakeCamera(arguments.fake, n, options) for n in range(1, 5)]
            config = Path(folder) / "cameras.toml"
            config.write_text(
                cameras_toml(
                    NAMES,
                    data_folder() / "studio/walk/calibration.toml",
                    'trigger = "external"\npixel_format = "Mono8"\n',
                )
            )
            run = subprocess.run(
                [arguments.probe, config, "--pattern", "--seconds", str(seconds)],
                capture_output=True,
                text=True,
                check=True,
            )
            for camera in cameras:
                camera.vanish()
        seen = json.loads(run.stdout.splitlines()[-1])
        links = seen["cameras"]
        bounds.add(
            proof,
            f"images with a wrong byte, of {sum(link['image_count'] for link in links)}",
            seen["wrong"],
            "0",
            seen["wrong"] == 0,
        )
        accounted(bounds, proof, cameras, links)
        if resend_helps:
            complete_fraction(bounds, proof, links)
        else:
            gone, lost = sum(c.total("gone") for c in cameras), sum(link["lost_image_count"] for link in links)
            bounds.add(
                proof,
                "images never sent / counted as lost",
                f"{gone}/{lost}",
                "equal except the last ones",
                0 <= gone - lost <= 4,
            )


def write(file, proof, command, rows):
    """Replaces the section of this test; the others are kept."""
    file.parent.mkdir(parents=True, exist_ok=True)
    sections = {}
    if file.exists():
        for section in file.read_text().split("\n## ")[1:]:
            sections[section.split("\n", 1)[0]] = "\n## " + section.rstrip("\n") + "\n"
    sections[proof] = (
        f"\n## {proof}\n\n`{command}`, {len(os.sched_getaffinity(0))} cores, load {os.getloadavg()[1]:.0f}\n\n"
        "| test | quantity | measured | bound | met |\n| --- | --- | --- | --- | --- |\n" + "\n".join(rows) + "\n"
    )
    file.write_text(
        "# Live cameras\n\nFour fake GigE Vision cameras, 640x480 at 30 images per second, over loopback. A load "
        "above the number of cores includes other programs.\n"
        + "".join(sections[name] for name in ("source", "steady", "restarts", "losses") if name in sections)
    )


def main():
    in_a_namespace()
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10)
    parser.add_argument("--restarts", type=int, default=5)
    parser.add_argument("--loss", type=float, default=0.01)
    parser.add_argument("--jitter-ms", type=float, default=50)
    parser.add_argument("--only", choices=["source", "steady", "restarts", "losses"], action="append")
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--daemon", default=str(BUILD / "server/daemon/kinevoxd"))
    parser.add_argument("--client", default=str(BUILD / "client/cli/kinevox"))
    parser.add_argument("--fake", default=str(BUILD / "tests/support/fake_gige/kinevox-fake-gige"))
    parser.add_argument("--probe", default=str(BUILD / "tests/live_probe"))
    parser.add_argument("--results", type=Path, default=RESULTS)
    arguments = parser.parse_args()
    command, failed = "tests/bench/live_cameras.py " + " ".join(sys.argv[1:]), False
    for proof in (source, steady, restarts, losses):
        if arguments.only is None or proof.__name__ in arguments.only:
            bounds = Bounds()
            proof(arguments, bounds)
            failed |= bool(bounds.failed)
            write(arguments.results / "live_cameras.md", proof.__name__, command.strip(), bounds.rows)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
