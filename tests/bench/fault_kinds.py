"""Faults injected by tests/bench/faults.py. Each raises Violated or returns recovered_s and a note."""
import contextlib
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from pathlib import Path

from fault_rig import Watched, demand
from live_rig import Daemon as CameraDaemon, FakeCamera, cameras_toml, wait_until
from recording_daemon import frames_of
from service import HeldThread, free_port

HOUR_S = 3600


@contextlib.contextmanager
def recorded(daemon, name):
    """Records meanwhile; no frame set may be dropped, and the recording must open afterwards."""
    daemon.client.recordings.start(name)
    yield
    written = daemon.client.recordings.stop()
    demand(
        f"recording {name} dropped frame sets", written.dropped_frame_set_count == 0, written.dropped_frame_set_count
    )
    demand(f"recording {name} ended by itself", not written.end_reason, written.end_reason)
    frames = daemon.check_recording(name)
    demand(f"recording {name} has too little", len(frames) > 5 and len(frames) == written.frame_set_count, len(frames))
    daemon.forget(name)


def quiet(rig, seconds):
    with recorded(rig.main, "quiet"):
        time.sleep(seconds)
    return {}


def spinners(rig, seconds):
    """Two busy loops per core, at default priority."""
    loops = [
        subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2 * len(os.sched_getaffinity(0)))
    ]
    try:
        with recorded(rig.main, "contended"):
            time.sleep(seconds)
    finally:
        for loop in loops:
            loop.kill()
            loop.wait()
    return {"note": f"{len(loops)} busy loops"}


def clock_steps(rig, seconds):
    """The clock is stepped by an hour in both directions, and back, during recordings."""
    latest = []
    for step_s in rig.random.sample((HOUR_S, -HOUR_S), 2):
        with recorded(rig.main, "stepped"):
            time.sleep(seconds / 8)
            rig.step_clock(step_s)
            time.sleep(seconds / 8)
            before = rig.main.client.status().message.latest_capture_time_ns
            demand(
                "stream times do not follow the clock",
                abs(before / 1e9 - time.time() - step_s) < 5 * rig.times_slower,
                before / 1e9 - time.time(),
            )
            time.sleep(seconds / 8)
            rig.step_clock(0)
            time.sleep(seconds / 8)
        latest.append(rig.main.wait_measuring())
    return {"recovered_s": max(latest)}


def full_disk(rig, seconds):
    """The disk fills up during a recording."""
    main, filler = rig.main, rig.disk / "filler"
    main.client.recordings.start("full")
    time.sleep(seconds / 4)
    with contextlib.suppress(OSError), open(filler, "wb", buffering=0) as full:  # until the disk is full
        while full.write(bytes(2**20)):
            pass
    end = time.monotonic() + 30 * rig.times_slower
    while main.client.recordings.status().state != "idle":
        demand("the recording does not end on a full disk", time.monotonic() < end)
        time.sleep(0.05)
    last = main.client.recordings.status().latest
    demand("end_reason lacks the reason", "free some space" in last.end_reason, last.end_reason)
    frames = main.check_recording("full")
    demand("the recording lost what was written", len(frames) == last.frame_set_count > 5, len(frames))
    main.wait_measuring()
    filler.unlink()
    begin = time.monotonic()
    main.forget("full")
    with recorded(main, "again"):
        recovered_s = time.monotonic() - begin
        time.sleep(seconds / 4)
    demand("the log lacks the reason", "free some space" in Path(main.service.log.name).read_text())
    return {"recovered_s": recovered_s, "note": f"{len(frames)} frame sets kept"}


@contextlib.contextmanager
def another(rig, more="", watchdog_s=20.0):
    """A separate daemon, for faults that end it."""
    with tempfile.TemporaryDirectory() as folder:
        daemon = Watched(
            rig, folder, Path(folder) / "recordings", more, watchdog_s, {"KINEVOX_GPU_FAILS_IN": f"{folder}/gpu"}
        )
        daemon.folder = Path(folder)
        try:
            daemon.wait_measuring()
            yield daemon
            status = daemon.close()
            demand("the daemon does not exit with status 0", status == 0, status)
        finally:
            if daemon.service.process.poll() is None:
                daemon.close()


def ended_in_a_recording(daemon, seen, ended, begin):
    """After the restart: the daemon answers, and the recording "lost" lacks at most one second."""
    daemon.service.wait_ready(2)
    daemon.wait_measuring()
    recovered_s = time.monotonic() - begin
    frames = daemon.check_recording("lost")
    held = [asked for asked, sequence in seen if sequence <= frames[-1][1]]
    lacks_s = ended - (held[-1] if held else seen[0][0])
    demand("the recording lacks more than a second", lacks_s <= 1.0, f"{lacks_s:.2f} s")
    return {"recovered_s": recovered_s, "note": f"lacks {lacks_s:.2f} s of the recording"}


def watch(daemon, seconds):
    seen, end = [], time.monotonic() + seconds
    while time.monotonic() < end:
        asked = time.monotonic()
        seen.append((asked, int(daemon.client.status().message.latest_sequence)))
    return seen


def killed(rig, seconds):
    """kill -9 during a recording."""
    with another(rig) as daemon:
        daemon.client.recordings.start("lost")
        seen = watch(daemon, rig.random.uniform(1.5, 1.5 + seconds / 4))
        begin = time.monotonic()
        daemon.service.kill()
        found = ended_in_a_recording(daemon, seen, begin, begin)
        demand("it ended for another reason", daemon.service.ends == [(-signal.SIGKILL, "kill")], daemon.service.ends)
        return found


def hung(rig, seconds):
    """One thread of the pipeline, or the whole process, is stopped."""
    victim = rig.random.choice(("posing", "reconstructing", "all"))
    with another(rig, watchdog_s=4.0) as daemon:  # a frame set that takes half of it is a hang
        daemon.client.recordings.start("lost")
        seen = watch(daemon, rig.random.uniform(1.5, 1.5 + seconds / 4))
        begin = time.monotonic()
        for attempt in range(10):  # a thread stopped while it waits for a frame set is no hang
            begin = time.monotonic()
            if attempt == 8:  # never stopped with a frame set
                victim = "all"
            thread = None if victim == "all" else HeldThread(daemon.service.process.pid, victim)
            if thread is None or not thread.held:  # ptrace is not permitted
                victim = "all"
                daemon.service.process.send_signal(signal.SIGSTOP)
            while (
                daemon.service.hangs == 0
                and time.monotonic() - begin < (6 if victim == "all" else 3) * rig.times_slower
            ):
                time.sleep(0.02)
            if thread:
                thread.release()
            if daemon.service.hangs:
                break
            seen += watch(daemon, 0.5)
        demand("the hang was not detected", daemon.service.hangs == 1, daemon.service.hangs)
        found = ended_in_a_recording(daemon, seen, begin, begin)
        demand("it ended for another reason", [why for _, why in daemon.service.ends] == ["hang"], daemon.service.ends)
        return {**found, "note": f"{found['note']}; {victim}"}


def gpu_fails(rig, seconds):
    """A CUDA error in a random stage during a recording."""
    port, stage = free_port(), rig.random.choice(("segmentation", "hull", "colouring"))
    with another(rig, f'[metrics]\nlisten = "127.0.0.1:{port}"\n') as daemon:

        def metric(name):
            text = urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10).read().decode()
            return float(re.search(rf"^{re.escape(name)} (\S+)$", text, re.M)[1])

        device = 'kinevox_compute_device{device="cuda:0",gpu="a GPU made to fail"}'
        demand("the GPU does not compute", metric(device) == 1)
        with recorded(daemon, "gpu"):
            time.sleep(seconds / 8)
            begin = time.monotonic()
            (daemon.folder / "gpu").write_text(stage)
            while "the CPU computes since" not in (said := daemon.client.status().message.state_message):
                demand("the status does not report the GPU's failure", time.monotonic() - begin < 10, said)
                time.sleep(0.01)
            recovered_s = time.monotonic() - begin
            daemon.wait_measuring()
            time.sleep(seconds / 8)
        wait_until("the service manager is notified", lambda: "the GPU cuda:0 failed" in daemon.service.status)
        demand(
            "the metrics do not report it",
            metric("kinevox_gpu_failures_total") == 1 and metric('kinevox_compute_device{device="cpu"}') == 1,
        )
        with daemon.client.events(history=100, idle_timeout_s=10) as events:
            reported = next(event.message for event in events if "the GPU" in event.message)
        demand(
            "the event lacks cause or remedy",
            "failed: CUDA: " in reported and "restart the daemon" in reported,
            reported,
        )
        return {"recovered_s": recovered_s, "note": stage}


def cameras_vanish(rig, seconds):
    """Fake GigE cameras disconnect during a recording, first one, then all, and return."""
    with tempfile.TemporaryDirectory() as folder, contextlib.ExitStack() as ends:
        cameras = []
        ends.callback(
            lambda: [camera.process.kill() or camera.process.communicate() for camera in cameras if camera.process]
        )
        empty = Path(folder) / "empty"
        empty.touch()
        names = ["cam1", "cam2", "cam3"]
        for n, name in enumerate(names, 1):
            cameras.append(
                FakeCamera(
                    rig.build / "tests/support/fake_gige/kinevox-fake-gige",
                    n,
                    ["--session", rig.session, "--camera", name, "--empty-while", empty],
                )
            )
        text = cameras_toml(
            names, rig.session.parent / "calibration.toml", 'trigger = "external"\npixel_format = "BayerRG8"\n'
        )
        daemon = CameraDaemon(
            folder,
            f"{text}[pipeline]\nvoxel_mm = 30\n[pose]\nenabled = false\n[recording]\n"
            f'folder = "{folder}/recordings"\nmin_free_disk_mb = 0\n',
            rig.build / "server/daemon/kinevoxd",
            rig.build / "client/cli/kinevox",
        )
        ends.callback(lambda: daemon.process.poll() is None and daemon.stop())
        wait_until("all cameras deliver", lambda: all(link and link["connected"] for link in daemon.connections()))
        daemon.kinevox("learn-background", "--frames", "10")
        empty.unlink()
        wait_until("a subject is tracked", lambda: daemon.status().get("subjects"))
        daemon.kinevox("record", "start", "vanishing")
        gone = rig.random.sample(cameras, 1)
        results = lambda: int(daemon.status()["result_count"])  # noqa: E731
        at_start = results()
        gone[0].vanish()
        before = results()
        wait_until("the others continue", lambda: results() > before + 10)
        for camera in cameras:
            if camera.process:
                camera.vanish()
        wait_until("all are disconnected", lambda: not any(link["connected"] for link in daemon.connections()))
        begin = time.monotonic()
        for camera in cameras:
            camera.start()
        wait_until("they are reconnected", lambda: all(link["connected"] for link in daemon.connections()))
        before = results()
        wait_until("it continues with all", lambda: results() > before + 10)
        wait_until("a subject is tracked again", lambda: daemon.status().get("subjects"))
        recovered_s = time.monotonic() - begin
        computed = results() - at_start
        daemon.kinevox("record", "stop")
        run = subprocess.run(
            [
                rig.build / "server/tools/kinevox-process",
                f"{folder}/recordings/vanishing/session.toml",
                "--out",
                f"{folder}/out",
                "--quiet",
                "--frames",
                "3",
                "--no-pose",
            ],
            capture_output=True,
            text=True,
        )
        demand("the recording does not open", run.returncode == 0, run.stderr.strip())
        frames = frames_of(f"{folder}/recordings/vanishing")
        # All results computed meanwhile, except those in the pipeline at its start.
        demand("the recording has too little", len(frames) >= computed - 3 > 15, f"{len(frames)} of {computed}")
        daemon.stop()
        demand("the daemon does not exit with status 0", daemon.process.returncode == 0, daemon.process.returncode)
        return {"recovered_s": recovered_s, "note": f"{len(frames)} frame sets"}


FAULTS = {
    "kill -9": killed,
    "hang": hung,
    "full disk": full_disk,
    "clock steps": clock_steps,
    "cameras vanish": cameras_vanish,
    "CUDA error": gpu_fails,
    "busy cores": spinners,
}
