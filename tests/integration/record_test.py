#!/usr/bin/python3
"""A session through the daemon, recorded, processed again and exported. usage: record_test.py BUILD_FOLDER

`kinevox process` on the recording gives the tables that it gives on the session itself, byte for byte, twice; the
recorded volumes are those of `process`; what the daemon exports is what the tool writes on the files. Skips (77) without
the test data."""
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent.parent
sys.path[:0] = [str(REPOSITORY / "tests/bench"), str(REPOSITORY / "tests/integration")]
import motion_files  # noqa: E402
from films import pictures_of  # noqa: E402
from process_runs import data_folder  # noqa: E402
from recording_daemon import Daemon, frames_of  # noqa: E402

FRAMES = 40   # of the session that `process` takes; enough for somebody to be tracked


def check(what, good, found=""):
    print(f"{'ok' if good else 'FAILED'}: {what}{f' ({found})' if found != '' else ''}", flush=True)
    if not good:
        sys.exit(1)


def process(tools, session, out, *options):
    run = subprocess.run([tools.process, str(session), "--out", str(out), "--quiet", "--frames", str(FRAMES), *options],
                         capture_output=True, text=True)
    check(f"process on {session.parent.name}", run.returncode == 0, run.stderr.strip())
    return {name: (out / name).read_bytes() for name in ("joints.csv", "angles.csv", "volume.csv", "track.csv", "agreement.csv")}


def ply_points(file):
    head, _, body = file.read_bytes().partition(b"end_header\n")
    count = int(next(line for line in head.splitlines() if line.startswith(b"element vertex")).split()[-1])
    points = np.frombuffer(body, dtype=np.dtype([("p", "<f4", 3), ("c", "u1", 3)]), count=count)
    return points["p"]


def check_anonymous_export(tools, daemon, folder, recordings):
    """The files that the tool writes (what is in them: anonymous_export_test), and refusals."""
    ours, theirs = folder / "passed_on", folder / "tool" / "passed_on"
    daemon.client("export", "--session", "walk", "--anonymous", "--out", str(ours))
    subprocess.run([tools.export, str(recordings / "walk"), "--anonymous", "--out", str(theirs), "--quiet"], check=True)
    names = sorted(file.name for file in theirs.iterdir())
    check("an anonymous export over the network has the tool's files", sorted(file.name for file in ours.iterdir()) == names,
          len(names))
    for name in names:
        if name.endswith((".mkv", ".mp4")):   # whose containers have identifiers of their own
            same = np.array_equal(pictures_of(ours / name), pictures_of(theirs / name))
        elif name.endswith(".index"):
            same = (ours / name).stat().st_size == (theirs / name).stat().st_size
        else:
            same = (ours / name).read_bytes() == (theirs / name).read_bytes()
        if not same:
            check(f"{name} over the network is the tool's", False)
    check("and each is the tool's", True)
    daemon.client("export", "--session", "walk", "--anonymous", "--format", "c3d", "--out", str(folder / "walk.c3d"))
    check("a table with --anonymous has no name of the recording", b"walk" not in (folder / "walk.c3d").read_bytes().lower())
    for words, why in ((["--format", "session"], "anonymous"), (["--anonymous", "--frames", "0-5"], "whole"), ([], "--format")):
        done = daemon.client("export", "--session", "walk", *words, "--out", str(folder / "refused"), check=False)
        check(f"export {' '.join(words)}: refused in a line", done.returncode in (1, 2) and done.stderr.count("\n") == 1 and
              why in done.stderr and not (folder / "refused").exists(), f"{done.returncode}: {done.stderr.strip()}")


def check_exports(tools, daemon, folder, recordings):
    out = folder / "exports"
    for form in ("trc", "mot", "c3d", "bvh", "csv"):
        options = ["--hold"] if form == "bvh" else []
        daemon.client("export", "--session", "walk", "--format", form, "--out", str(out / f"walk.{form}"), *options)
        subprocess.run([tools.export, str(recordings / "walk"), "--format", form, "--out", str(folder / "tool" / f"walk.{form}"),
                        "--quiet", *options], check=True)
        check(f"{form} over the network is the tool's", (out / f"walk.{form}").read_bytes() ==
              (folder / "tool" / f"walk.{form}").read_bytes())
    trc, c3d = motion_files.read_trc(out / "walk.trc"), motion_files.read_c3d(out / "walk.c3d")
    check("trc and c3d are read back", trc is not None and c3d is not None)
    daemon.client("export", "--session", "walk", "--format", "mp4", "--out", str(out / "walk.mp4"), "--frames", "10-29")
    pictures = pictures_of(out / "walk.mp4")
    check("the film has the pictures asked for", len(pictures) == 20 and pictures[0].shape == (960, 1280, 3),
          f"{len(pictures)} of {pictures[0].shape if pictures else None}")
    daemon.client("export", "--session", "walk", "--format", "mp4", "--camera", "cam2", "--out", str(out / "cam2.mp4"),
                  "--frames", "10-29")
    film = cv2.VideoCapture(str(out / "cam2.mp4"))
    check("a single camera's film is its size", film.read()[1].shape == (480, 640, 3))
    wrong = daemon.client("export", "--session", "walk", "--format", "mp4", "--camera", "cam9", "--out", str(out / "x.mp4"),
                          check=False)
    check("an unknown camera is refused", wrong.returncode == 1 and "cam1, cam2" in wrong.stderr and not (out / "x.mp4").exists(),
          wrong.stderr.strip())
    daemon.client("export", "--session", "walk", "--format", "ply", "--out", str(out / "volumes"), "--frames", "0-39")
    check_anonymous_export(tools, daemon, folder, recordings)
    check("nothing is left behind", not list(recordings.glob(".export-*")))
    return out / "volumes"


def main():
    build = Path(sys.argv[1])
    tools = SimpleNamespace(daemon=str(build / "server/daemon/kinevoxd"), client=str(build / "client/cli/kinevox"),
                            process=str(build / "server/tools/kinevox-process"), export=str(build / "server/tools/kinevox-export"),
                            sequence="walk")
    session = data_folder() / "studio/walk/session.toml"
    if not session.exists():
        print(f"skipped: {session} is not here")
        sys.exit(77)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary)
        # Nothing may be dropped, however much slower this machine encodes than it measures.
        daemon = Daemon(tools, folder, "as_fast_as_possible", 'queue_mb = 2000\nleast_free_mb = 0\n', loop=False, autostart=False)
        try:
            daemon.client("record", "start", "--name", "walk")
            check("a recording waits for the capture", daemon.json("record", "status")["state"] == "waiting")
            daemon.client("start")
            status = daemon.wait_until_idle()
            last = status["last"]
            check("it ended with the capture", "capture ended" in last["end_reason"], last["end_reason"])
            check("every frame set is there", last["dropped"] == last["lost"] == 0 and last["frames"] > FRAMES, last["frames"])
            check("it has all that belongs to it", last["has_background"] and last["has_poses"] and last["has_volumes"])
            recorded = daemon.recordings / "walk/session.toml"
            original = process(tools, session, folder / "original")
            first = process(tools, recorded, folder / "first", "--save", "volumes")
            second = process(tools, recorded, folder / "second")
            for name, text in original.items():
                check(f"{name} of the recording is the session's", first[name] == text)
                check(f"{name} is the same twice", second[name] == first[name])
            check("frames.csv has a line a frame set", len(frames_of(recorded.parent)) == last["frames"])
            volumes = check_exports(tools, daemon, folder, daemon.recordings)
            for frame in (10, 25, 39):
                ours, theirs = ply_points(volumes / f"{frame:06}.ply"), ply_points(folder / "first/volumes" / f"{frame:06}.ply")
                check(f"the recorded volume of frame {frame} is that of process", np.array_equal(ours, theirs), len(ours))
            daemon.client("record", "delete", "walk")
            check("a deleted recording is gone", not recorded.parent.exists() and daemon.json("record", "list")["recordings"] == [])
        finally:
            ended = daemon.stop()
        check("the daemon ends as it should", ended == 0, ended)
        check("nothing but recordings is left", not list(daemon.recordings.iterdir()), list(daemon.recordings.iterdir()))


if __name__ == "__main__":
    main()
