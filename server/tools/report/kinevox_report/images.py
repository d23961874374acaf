"""The cameras' images of a session, and the projection of joints into them."""
from pathlib import Path

import cv2
import numpy as np

from .trial import ReportError, read_toml


class Camera:
    def __init__(self, section, file):
        try:
            self.name = section["name"]
            self.width, self.height = (int(v) for v in section["size"])
            self.matrix = np.array(section["matrix"], float).reshape(3, 3)
            self.distortion = np.array(section["distortions"], float)
            self.rodrigues = np.array(section["rotation"], float).reshape(3)
            self.translation = np.array(section["translation"], float).reshape(3)
        except (KeyError, TypeError, ValueError) as error:
            raise ReportError(f"{file}: not a calibration in the layout of Pose2Sim: {error}") from None

    def project(self, points):
        """World points (n, 3), m -> pixels (n, 2); NaN for NaN and behind the camera."""
        pixels = np.full((len(points), 2), np.nan)
        rotation = cv2.Rodrigues(self.rodrigues)[0]
        in_camera = points @ rotation.T + self.translation
        seen = in_camera[:, 2] > 0.05  # NaN is not
        if seen.any():
            pixels[seen] = cv2.projectPoints(
                points[seen], self.rodrigues, self.translation, self.matrix, self.distortion
            )[0].reshape(-1, 2)
        return pixels


class Session:
    """Cameras by name and their videos, from session.toml; the calibration that `process` used is in its folder.
    `first_image_index`: {camera: index of its image of frame 0}, if the videos were not started together."""

    def __init__(self, file, folder, first_image_index=None):
        self.file = Path(file)
        self.first = first_image_index if isinstance(first_image_index, dict) else {}
        data = read_toml(self.file)
        try:
            self.name = str(data.get("name", self.file.parent.name))
            self.videos = {c["name"]: self.file.parent / c["video"] for c in data["camera"]}
            used = Path(folder) / "calibration.toml"
            calibration = used if used.is_file() else self.file.parent / data["calibration"]
        except (KeyError, TypeError) as error:
            raise ReportError(f"{self.file}: not a session: {error} is missing") from None
        if calibration.suffix != ".toml":
            raise ReportError(f"{calibration}: a report needs the calibration as TOML, which `kinevox process` writes")
        sections = read_toml(calibration)
        self.cameras = {
            s["name"]: Camera(s, calibration)
            for s in sections.values()
            if isinstance(s, dict) and s.get("name") in self.videos
        }
        if not self.cameras:
            raise ReportError(f"{calibration}: contains none of the cameras of {self.file}")

    def image_reader(self, camera):
        return ImageReader(self.videos[camera], self.first.get(camera, 0))


class ImageReader:
    """Images by index, RGB, in increasing order: a video is decoded sequentially, since seeking is not exact in every
    container. Index 0 is the file's image `first`."""

    def __init__(self, path, first=0):
        self.path, self.next, self.first = path, 0, first
        if not path.exists():
            raise ReportError(f"{path}: no such video; if the session was moved, give --session")
        self.files = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else None
        self.video = None if self.files is not None else cv2.VideoCapture(str(path))

    def read(self, number):
        image = None
        number += self.first
        if self.files is not None:
            image = cv2.imread(str(self.files[number])) if number < len(self.files) else None
        else:
            while self.next < number and self.video.grab():
                self.next += 1
            if self.next == number:
                good, image = self.video.read()
                self.next += 1
                image = image if good else None
        if image is None:
            raise ReportError(f"{self.path}: has no image {number}; check that the results belong to this session")
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)


def choose_frames(joints, count):
    """Indices, evenly spread over the trial, each the nearest one in which most of the body is measured."""
    measured = np.mean([np.isfinite(p[:, 0]) for p in joints.values()], axis=0)
    good = np.flatnonzero(measured >= 0.7)
    if not len(good):
        good = np.flatnonzero(measured > 0)
    if not len(good):
        return []
    targets = np.linspace(good[0], good[-1], count)
    return sorted({int(good[np.abs(good - t).argmin()]) for t in targets})


def choose_camera(session, joints, frames):
    """The one that shows the complete body largest in most of the frames."""

    def score(camera):
        heights = []
        for frame in frames:
            pixels = camera.project(np.array([p[frame] for p in joints.values()]))
            pixels = pixels[np.isfinite(pixels[:, 0])]
            if not len(pixels):
                heights.append(0.0)
                continue
            inside = ((pixels >= 0) & (pixels <= [camera.width - 1, camera.height - 1])).all(1).mean()
            heights.append(np.ptp(pixels[:, 1]) / camera.height * inside**4)
        return float(np.mean(heights))

    return max(session.cameras.values(), key=score)
