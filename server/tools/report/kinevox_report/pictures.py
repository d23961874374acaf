"""The cameras' pictures of a session, and where the joints lie in them."""
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
            raise ReportError(f"{file}: is no calibration in the layout of Pose2Sim: {error}") from None

    def project(self, points):
        """World points (n, 3), m -> pixels (n, 2); NaN for NaN and behind the camera."""
        pixels = np.full((len(points), 2), np.nan)
        rotation = cv2.Rodrigues(self.rodrigues)[0]
        in_camera = points @ rotation.T + self.translation
        seen = in_camera[:, 2] > 0.05   # NaN is not
        if seen.any():
            pixels[seen] = cv2.projectPoints(points[seen], self.rodrigues, self.translation, self.matrix,
                                             self.distortion)[0].reshape(-1, 2)
        return pixels


class Session:
    """Cameras by name and their videos, from session.toml; the calibration that `process` used stands in its folder.
    `first_pictures`: {camera: number of its picture in frame 0}, where the videos did not begin together."""

    def __init__(self, file, folder, first_pictures=None):
        self.file = Path(file)
        self.first = first_pictures if isinstance(first_pictures, dict) else {}
        data = read_toml(self.file)
        try:
            self.name = str(data.get("name", self.file.parent.name))
            self.videos = {c["name"]: self.file.parent / c["video"] for c in data["camera"]}
            beside = Path(folder) / "calibration.toml"
            calibration = beside if beside.is_file() else self.file.parent / data["calibration"]
        except (KeyError, TypeError) as error:
            raise ReportError(f"{self.file}: is no session: {error} is missing") from None
        if calibration.suffix != ".toml":
            raise ReportError(f"{calibration}: a report needs the calibration as TOML, which `kinevox process` writes")
        sections = read_toml(calibration)
        self.cameras = {s["name"]: Camera(s, calibration) for s in sections.values()
                        if isinstance(s, dict) and s.get("name") in self.videos}
        if not self.cameras:
            raise ReportError(f"{calibration}: has none of the cameras of {self.file}")

    def picture_reader(self, camera):
        return PictureReader(self.videos[camera], self.first.get(camera, 0))


class PictureReader:
    """Pictures by number, RGB, in rising order: a video is decoded on from where it stands, since seeking is not exact
    in every container. Number 0 is the file's picture `first`."""

    def __init__(self, path, first=0):
        self.path, self.next, self.first = path, 0, first
        if not path.exists():
            raise ReportError(f"{path}: no such video; was the session moved? Give --session")
        self.files = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else None
        self.video = None if self.files is not None else cv2.VideoCapture(str(path))

    def read(self, number):
        picture = None
        number += self.first
        if self.files is not None:
            picture = cv2.imread(str(self.files[number])) if number < len(self.files) else None
        else:
            while self.next < number and self.video.grab():
                self.next += 1
            if self.next == number:
                good, picture = self.video.read()
                self.next += 1
                picture = picture if good else None
        if picture is None:
            raise ReportError(f"{self.path}: has no picture {number}; are the results of this session?")
        return cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)


def choose_frames(joints, count):
    """Indices, evenly spread over the trial, each the nearest one in which most of the body was measured."""
    measured = np.mean([np.isfinite(p[:, 0]) for p in joints.values()], axis=0)
    good = np.flatnonzero(measured >= 0.7)
    if not len(good):
        good = np.flatnonzero(measured > 0)
    if not len(good):
        return []
    targets = np.linspace(good[0], good[-1], count)
    return sorted({int(good[np.abs(good - t).argmin()]) for t in targets})


def choose_camera(session, joints, frames):
    """The one that shows the body whole, and largest, in most of the frames."""
    def score(camera):
        heights = []
        for frame in frames:
            pixels = camera.project(np.array([p[frame] for p in joints.values()]))
            pixels = pixels[np.isfinite(pixels[:, 0])]
            if not len(pixels):
                heights.append(0.0)
                continue
            inside = ((pixels >= 0) & (pixels <= [camera.width - 1, camera.height - 1])).all(1).mean()
            heights.append(np.ptp(pixels[:, 1]) / camera.height * inside ** 4)
        return float(np.mean(heights))
    return max(session.cameras.values(), key=score)
