#!/usr/bin/python3
"""`kinevox export --anonymous` removes images and names. usage: anonymous_export_test.py BUILD_FOLDER

On the studio's walk and on a real trial: the silhouettes are those of `kinevox process`, of its main subject; the video has
only flat greys and the skeleton's colours; no file contains the name of session, folder or camera; the folder is a recording
that can be exported and processed again. Skips (77) without the test data."""
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

REPOSITORY = Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(REPOSITORY / "tests/bench"))
from video_images import images_of  # noqa: E402
from process_runs import data_folder  # noqa: E402

SEQUENCES = {
    "studio/walk/session.toml": 12,
    "balancing/session.toml": 6,
}  # and the number of frames; the second ones are large
NAME = "Erika_Mustermann"
DETAIL = 2.5  # grey levels: std of a flat area in H.264


def check(what, good, found=""):
    print(f"{'ok' if good else 'FAILED'}: {what}{f' ({found})' if found != '' else ''}", flush=True)
    if not good:
        sys.exit(1)


def named_session(original, folder):
    """The session with a person's name in every place for one; it refers to the original videos."""
    folder.mkdir(parents=True)
    lines = []
    for line in original.read_text().splitlines():
        key, _, value = line.partition("=")
        key, value = key.strip(), value.split("#")[0].strip()
        if key in ("video", "background"):
            line = f'{key} = "{original.parent / value.strip(chr(34))}"'
        elif key == "name" and value.strip('"').startswith("cam"):
            line = f'name = "{NAME}_{value.strip(chr(34))}"'
        elif key == "name":
            line = f'name = "{NAME}"'
        elif key == "calibration":
            cameras = (original.parent / value.strip('"')).read_text().replace("[cam", f"[{NAME}_cam")
            (folder / "calibration.toml").write_text(cameras)
            line = 'calibration = "calibration.toml"'
        lines.append(line)
    (folder / "session.toml").write_text("\n".join(lines) + "\n")
    return folder / "session.toml"


def check_silhouettes(results, anonymous, cameras, frames):
    for n, camera in enumerate(cameras):
        ours = images_of(anonymous / f"cam_{n + 1:02}.mkv")
        check(f"{camera}: one silhouette per frame", len(ours) == frames, len(ours))
        fractions = []
        for frame, image in enumerate(ours):
            theirs = cv2.imread(str(results / "silhouettes" / camera / f"{frame:06}.png"), cv2.IMREAD_GRAYSCALE) > 0
            if not set(np.unique(image)) <= {0, 255} or np.ptp(image, axis=2).any():
                check(f"{camera}: white on black", False, f"frame {frame}")
            mine = image[..., 0] > 0
            if (mine & ~theirs).any():
                check(f"{camera}: only pixels that process finds", False, f"frame {frame}")
            fractions.append(mine.sum() / max(theirs.sum(), 1))
        check(
            f"{camera}: the silhouettes are those of process, of the main subject",
            np.median(fractions) > 0.9,
            f"{min(fractions):.3f}",
        )
        background = images_of(anonymous / f"cam_{n + 1:02}_background.mkv")
        check(f"{camera}: the background is black", len(background) == 1 and not background[0].any())


def check_video(video, silhouettes, source, frames):
    """Flat apart from the skeleton and edges; `source`: the original images, which are not."""
    images = images_of(video)
    check("the video has all frames", len(images) == frames, len(images))
    disk = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (7, 7))
    inside, outside = [], []
    for image, silhouette, original in zip(images, silhouettes, source):
        spread = np.ptp(image.astype(int), axis=2)
        drawn = cv2.dilate(((spread > 20) | (image.max(2) > 140) | (image.max(2) < 12)).astype(np.uint8), disk) > 0
        person = cv2.erode(silhouette[..., 0], disk) > 0
        room = cv2.dilate(silhouette[..., 0], disk) == 0
        for where, levels, found in ((person & ~drawn, 112, inside), (room & ~drawn, 28, outside)):
            if where.sum() < 200:
                continue
            values = image[where].astype(float)
            found.append((np.abs(np.median(values) - levels), values.std(), original[where].astype(float).std()))
    for what, found in (("person", inside), ("room", outside)):
        off, std, original = np.max(np.array(found), axis=0)
        check(
            f"the {what} is flat grey in the video",
            len(found) >= frames // 2 and off <= 3 and std < DETAIL < original,
            f"{std:.1f} of {original:.1f} levels in {len(found)} frames",
        )


def check_names(folder):
    for file in folder.iterdir():
        if b"mustermann" in file.read_bytes().lower() or "mustermann" in file.name.lower():
            check("no name is in any file", False, file.name)
    check("no name is in any file", True)
    text = (folder / "README.txt").read_text()
    check("README.txt lists what is removed and what identifies", "Removed" in text and "What still identifies" in text)


def run(*command):
    return subprocess.run([str(word) for word in command], capture_output=True, text=True)


def check_sequence(tools, original, folder, frames):
    session = named_session(original, folder / NAME)
    cameras = [line.split('"')[1] for line in session.read_text().splitlines() if line.startswith(f'name = "{NAME}_')]
    results, anonymous = folder / f"{NAME}_results", folder / "anonymous"
    # A second run would not be kept: these silhouettes lack nothing.
    done = run(
        tools / "kinevox-process",
        session,
        "--out",
        results,
        "--frames",
        frames,
        "--save",
        "silhouettes",
        "--single-run",
        "--quiet",
    )
    check("process", done.returncode == 0, done.stderr.strip())
    done = run(tools / "kinevox-export", results, "--anonymous", "--out", anonymous, "--quiet")
    check("export --anonymous", (done.returncode, done.stderr) == (0, ""), done.stderr)
    check_names(anonymous)
    check_silhouettes(results, anonymous, cameras, frames)

    first = images_of(anonymous / "cam_01.mkv")
    video_file = folder / "video.mp4"
    done = run(
        tools / "kinevox-export",
        results,
        "--anonymous",
        "--format",
        "mp4",
        "--camera",
        cameras[0],
        "--video-width",
        first[0].shape[1],
        "--out",
        video_file,
        "--quiet",
    )
    check("a video alone", done.returncode == 0 and not list(folder.glob(".kinevox-*")), done.stderr)
    video = next(line.split('"')[1] for line in session.read_text().splitlines() if line.startswith("video"))
    check_video(video_file, first, images_of(video, frames), frames)

    done = run(tools / "kinevox-export", anonymous, "--format", "c3d", "--out", folder / "again.c3d")
    check("the folder is a recording: c3d of it", done.returncode == 0, done.stderr.strip())
    done = run(tools / "kinevox-export", anonymous, "--format", "ply", "--out", folder / "volumes")
    check("and its volumes", done.returncode == 0, done.stderr.strip())
    done = run(tools / "kinevox-process", anonymous / "session.toml", "--out", folder / "again", "--no-pose", "--quiet")
    check("and process reads it", done.returncode == 0, done.stderr.strip())
    return session, results


def check_refusals(tools, folder, session, results):
    out = folder / "refused"
    done = run(tools / "kinevox-export", results, "--format", "session", "--out", out)
    check(
        "a session with images is not exported",
        done.returncode == 1 and "anonymous" in done.stderr,
        done.stderr.strip(),
    )
    done = run(tools / "kinevox-export", results, "--anonymous", "--range", "0-5", "--out", out)
    check("nor part of it", done.returncode == 1 and "all frames" in done.stderr, done.stderr.strip())
    session.write_text(
        "\n".join(line for line in session.read_text().splitlines() if not line.startswith("background"))
    )
    done = run(tools / "kinevox-export", results, "--anonymous", "--out", out)
    check(
        "without a background it is refused in one line",
        done.returncode == 1 and done.stderr.count("\n") == 1 and "background" in done.stderr,
        done.stderr.strip(),
    )
    check("and nothing is left", not out.exists() and not list(folder.glob(".refused*")))


def main():
    tools = Path(sys.argv[1]) / "server/tools"
    sequences = {data_folder() / name: frames for name, frames in SEQUENCES.items()}
    missing = [str(file) for file in sequences if not file.exists()]
    if missing:
        print(f"skipped: {missing[0]} is not here")
        sys.exit(77)
    with tempfile.TemporaryDirectory() as temporary:
        for number, (sequence, frames) in enumerate(sequences.items()):
            folder = Path(temporary) / str(number)
            made = check_sequence(tools, sequence, folder, frames)
        check_refusals(tools, folder, *made)


if __name__ == "__main__":
    main()
