#!/usr/bin/python3
"""Sessions through the daemon, recorded, processed again and exported. usage: record_test.py BUILD_FOLDER

`kinevox process` on a recording writes the same tables as on the session itself, byte for byte, twice; every recorded
volume of walk and gesture equals that of `process`; the daemon exports what the tool writes from the files. Skips (77)
without the test data."""
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent.parent
sys.path[:0] = [str(REPOSITORY / "tests/bench"), str(REPOSITORY / "tests/integration")]
import motion_files  # noqa: E402
from video_images import images_of  # noqa: E402
from process_runs import data_folder  # noqa: E402
from recording_daemon import Daemon, frames_of  # noqa: E402

FRAMES = 20  # of the session that `process` reads; enough to track the subject and to fit the body


def check(what, good, found=""):
    print(f"{'ok' if good else 'FAILED'}: {what}{f' ({found})' if found != '' else ''}", flush=True)
    if not good:
        sys.exit(1)


def process(tools, session, out, *options):
    run = subprocess.run(
        [tools.process, str(session), "--out", str(out), "--quiet", "--frames", str(FRAMES), *options],
        capture_output=True,
        text=True,
    )
    check(f"process on {session.parent.name}", run.returncode == 0, run.stderr.strip())
    return {
        name: (out / name).read_bytes()
        for name in ("joints.csv", "angles.csv", "volume.csv", "track.csv", "silhouette_iou.csv")
    }


def ply_points(file):
    head, _, body = file.read_bytes().partition(b"end_header\n")
    count = int(next(line for line in head.splitlines() if line.startswith(b"element vertex")).split()[-1])
    points = np.frombuffer(body, dtype=np.dtype([("p", "<f4", 3), ("c", "u1", 3)]), count=count)
    return points["p"]


def record_beginning(daemon):
    """Records the first seconds of the session as "brief": an anonymous export always contains all frames."""
    daemon.client("record", "start", "brief")
    daemon.client("start")
    while daemon.json("record", "status")["current"].get("frame_set_count", 0) < FRAMES:
        time.sleep(0.1)
    daemon.client("record", "stop")
    daemon.client("stop")


def check_anonymous_export(tools, daemon, folder, recordings):
    """The same files as from the tool (anonymous_export_test checks their contents), and refusals."""
    ours, theirs = folder / "anonymous", folder / "tool" / "anonymous"
    record_beginning(daemon)
    daemon.client("record", "export", "brief", "--anonymous", "--out", str(ours))
    subprocess.run(
        [tools.export, str(recordings / "brief"), "--anonymous", "--out", str(theirs), "--quiet"], check=True
    )
    daemon.client("record", "delete", "brief", "--yes")
    names = sorted(file.name for file in theirs.iterdir())
    check(
        "an anonymous export over the network has the tool's files",
        sorted(file.name for file in ours.iterdir()) == names,
        len(names),
    )
    for name in names:
        if name.endswith((".mkv", ".mp4")):  # containers with random identifiers
            same = np.array_equal(images_of(ours / name), images_of(theirs / name))
        elif name.endswith(".index"):
            same = (ours / name).stat().st_size == (theirs / name).stat().st_size
        else:
            same = (ours / name).read_bytes() == (theirs / name).read_bytes()
        if not same:
            check(f"{name} over the network is the tool's", False)
    check("and each is the tool's", True)
    daemon.client("record", "export", "walk", "--anonymous", "--format", "c3d", "--out", str(folder / "walk.c3d"))
    check(
        "a table with --anonymous does not name the recording",
        b"walk" not in (folder / "walk.c3d").read_bytes().lower(),
    )
    for words, why in (
        (["--format", "session"], "anonymous"),
        (["--anonymous", "--range", "0-5"], "all frames"),
        ([], "--format"),
    ):
        done = daemon.client("record", "export", "walk", *words, "--out", str(folder / "refused"), check=False)
        check(
            f"export {' '.join(words)}: refused in one line",
            done.returncode in (1, 2)
            and done.stderr.count("\n") == 1
            and why in done.stderr
            and not (folder / "refused").exists(),
            f"{done.returncode}: {done.stderr.strip()}",
        )


def check_exports(tools, daemon, folder, recordings):
    out = folder / "exports"
    for form in ("trc", "mot", "c3d", "bvh", "csv"):
        options = ["--hold-withheld"] if form == "bvh" else []
        daemon.client("record", "export", "walk", "--format", form, "--out", str(out / f"walk.{form}"), *options)
        subprocess.run(
            [
                tools.export,
                str(recordings / "walk"),
                "--format",
                form,
                "--out",
                str(folder / "tool" / f"walk.{form}"),
                "--quiet",
                *options,
            ],
            check=True,
        )
        check(
            f"{form} over the network is the tool's",
            (out / f"walk.{form}").read_bytes() == (folder / "tool" / f"walk.{form}").read_bytes(),
        )
    trc, c3d = motion_files.read_trc(out / "walk.trc"), motion_files.read_c3d(out / "walk.c3d")
    check("trc and c3d are read back", trc is not None and c3d is not None)
    daemon.client("record", "export", "walk", "--format", "mp4", "--out", str(out / "walk.mp4"), "--range", "10-29")
    images = images_of(out / "walk.mp4")
    check(
        "the video has the requested images",
        len(images) == 20 and images[0].shape == (960, 1280, 3),
        f"{len(images)} of {images[0].shape if images else None}",
    )
    daemon.client(
        "record",
        "export",
        "walk",
        "--format",
        "mp4",
        "--camera",
        "cam2",
        "--out",
        str(out / "cam2.mp4"),
        "--range",
        "10-29",
    )
    video = cv2.VideoCapture(str(out / "cam2.mp4"))
    check("a single camera's video has its size", video.read()[1].shape == (480, 640, 3))
    wrong = daemon.client(
        "record", "export", "walk", "--format", "mp4", "--camera", "cam9", "--out", str(out / "x.mp4"), check=False
    )
    check(
        "an unknown camera is refused",
        wrong.returncode == 1 and "cam1, cam2" in wrong.stderr and not (out / "x.mp4").exists(),
        wrong.stderr.strip(),
    )
    check_anonymous_export(tools, daemon, folder, recordings)
    check("no temporary export is left", not list(recordings.glob(".export-*")))


def check_volumes(tools, daemon, folder, name, session):
    """Every volume that the daemon recorded equals that of `kinevox process` on the session."""
    recorded, processed = folder / f"{name}_recorded", folder / f"{name}_processed"
    daemon.client("record", "export", name, "--format", "ply", "--out", str(recorded))
    run = subprocess.run(
        [tools.process, str(session), "--out", str(processed), "--quiet", "--no-pose", "--save", "volumes"],
        capture_output=True,
        text=True,
    )
    check(f"process on all of {name}", run.returncode == 0, run.stderr.strip())
    ours, theirs = ({f.name: f for f in d.glob("*.ply")} for d in (recorded, processed / "volumes"))
    check(f"{name}: as many volumes", ours.keys() == theirs.keys() and len(ours) > 100, f"{len(ours)}, {len(theirs)}")
    differ = [n for n in sorted(ours) if not np.array_equal(ply_points(ours[n]), ply_points(theirs[n]))]
    check(
        f"{name}: every recorded volume is that of process",
        not differ,
        f"{len(differ)} of {len(ours)} differ: {differ[:10]}",
    )


def record(tools, folder, name, use):
    """Records a sequence of the studio from start to end; calls use(daemon, status of the recording)."""
    tools.sequence = name
    # A large queue, so that no frame set is dropped on machines that encode slowly.
    daemon = Daemon(
        tools, folder, "as_fast_as_possible", "max_queue_mb = 2000\nmin_free_disk_mb = 0\n", loop=False, autostart=False
    )
    try:
        daemon.client("record", "start", name)
        check("a recording waits for the capture", daemon.json("record", "status")["state"] == "waiting")
        daemon.client("start")
        latest = daemon.wait_until_idle()["latest"]
        check(
            f"{name}: recorded until the capture ended", "capture ended" in latest["end_reason"], latest["end_reason"]
        )
        check(
            f"{name}: every frame set is recorded",
            latest["dropped_frame_set_count"] == latest["lost_frame_set_count"] == 0
            and latest["frame_set_count"] > FRAMES,
            latest["frame_set_count"],
        )
        use(daemon, latest)
        daemon.client("record", "delete", name, "--yes")
        listed = daemon.json("record", "list")["recordings"]
        files = sorted(str(p.relative_to(daemon.recordings)) for p in daemon.recordings.glob("[!.]*"))
        check(
            "a deleted recording is in the bin",
            listed == [] and files == ["deleted"] and (daemon.recordings / "deleted" / name / "session.toml").exists(),
            (listed, files),
        )
    finally:
        ended = daemon.stop()
    check("the daemon exits with status 0", ended == 0, ended)
    check(
        "no other file is left",
        [p.name for p in daemon.recordings.iterdir()] == ["deleted"],
        list(daemon.recordings.iterdir()),
    )


def main():
    build = Path(sys.argv[1])
    tools = SimpleNamespace(
        daemon=str(build / "server/daemon/kinevoxd"),
        client=str(build / "client/cli/kinevox"),
        process=str(build / "server/tools/kinevox-process"),
        export=str(build / "server/tools/kinevox-export"),
        sequence="walk",
    )
    sessions = {name: data_folder() / f"studio/{name}/session.toml" for name in ("walk", "gesture")}
    for session in sessions.values():
        if not session.exists():
            print(f"skipped: {session} is not here")
            sys.exit(77)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)

        def check_walk(daemon, latest):
            check(
                "it has all optional parts", latest["has_background"] and latest["has_poses"] and latest["has_volumes"]
            )
            listed = daemon.json("record", "list")["recordings"][0]
            check(
                "list and status report one size",
                listed["size_bytes"] == latest["size_bytes"],
                (listed["size_bytes"], latest["size_bytes"]),
            )
            recorded = daemon.recordings / "walk/session.toml"
            original = process(tools, sessions["walk"], folder / "original")
            first, second = (process(tools, recorded, folder / name) for name in ("first", "second"))
            for name, text in original.items():
                check(f"{name} of the recording is the session's", first[name] == text)
                check(f"{name} is the same twice", second[name] == first[name])
            check("frames.csv has a line per frame set", len(frames_of(recorded.parent)) == latest["frame_set_count"])
            check_exports(tools, daemon, folder, daemon.recordings)
            check_volumes(tools, daemon, folder, "walk", sessions["walk"])

        record(tools, folder, "walk", check_walk)
        (folder / "gesture").mkdir()
        record(
            tools,
            folder / "gesture",
            "gesture",
            lambda daemon, _: check_volumes(tools, daemon, folder, "gesture", sessions["gesture"]),
        )


if __name__ == "__main__":
    main()
