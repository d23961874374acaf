"""A session whose images are the exact silhouettes, so that segmentation has no part in the errors of its result."""
import shutil

import cv2
import numpy as np

from session_data import Session, tomllib

BACKGROUND, BODY = (90, 90, 90), (40, 200, 240)  # BGR
BACKGROUND_FRAMES = 30


def _write_lossless(file, fps, images):
    height, width = images[0].shape[:2]
    video = cv2.VideoWriter(str(file), cv2.VideoWriter_fourcc(*"FFV1"), fps, (width, height))
    if not video.isOpened():
        raise SystemExit(f"{file}: OpenCV cannot write lossless video (FFV1)")
    for image in images:
        video.write(image)
    video.release()


def write_mask_session(source, folder):
    """Writes the session of `source` (a session.toml with truth/masks_CAMERA.zip) to `folder`, unless it is there; its file."""
    file = folder / "session.toml"
    if file.exists():
        return file
    session = Session(source)
    data = tomllib.loads(source.read_text(encoding="utf-8"))
    folder.mkdir(parents=True, exist_ok=True)
    lines = [f'name = "{session.name}"', f"fps = {session.fps}", f'calibration = "{data["calibration"]}"']
    for camera in session.cameras:
        plain = np.full((camera.height, camera.width, 3), BACKGROUND, np.uint8)
        _write_lossless(folder / f"{camera.name}_background.mkv", session.fps, [plain] * BACKGROUND_FRAMES)
        images = [np.where(m[..., None], np.array(BODY, np.uint8), plain) for m in session.true_masks(camera)]
        _write_lossless(folder / f"{camera.name}.mkv", session.fps, images)
        lines += ["", "[[camera]]", f'name = "{camera.name}"', f'video = "{camera.name}.mkv"']
        lines += [f'background = "{camera.name}_background.mkv"']
    shutil.copy(source.parent / data["calibration"], folder / data["calibration"])
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return file
