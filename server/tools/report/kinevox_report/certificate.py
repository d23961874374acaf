"""A calibration's certificate, as `kinevox calibrate` wrote it: what the page draws, checked."""
import base64
import binascii
import json
from pathlib import Path

import cv2
import numpy as np

from .trial import ReportError

VERDICTS = ("GO", "CARE", "NO-GO")


class CameraPart:
    """One camera: lens, place, quality. Lengths in m, world; pixels as OpenCV counts them."""

    def __init__(self, name, section):
        self.name = name
        self.size = np.array(section["size_px"], float).reshape(2)
        self.focal = np.array(section["focal_px"], float).reshape(2)
        self.middle = np.array(section["middle_px"], float).reshape(2)
        place = section["camera_from_world"]
        self.rotation = cv2.Rodrigues(np.array(place["rotation_vector"], float).reshape(3))[0]   # camera from world
        self.centre = np.array(section["centre_m"], float).reshape(3)
        lens = section.get("lens", {})
        shown = section if "coverage_counts" in section else lens
        self.views = section.get("views", lens.get("views_used"))
        self.coverage = shown.get("coverage")
        counts = shown.get("coverage_counts") or []
        self.counts = np.array(counts, float).reshape(6, 8) if counts else None
        self.misses = np.array(section.get("misses_px") or [], float).reshape(-1, 4)
        self.held_out_px, self.fit_px = section.get("held_out_rms_px"), section.get("fit_rms_px")
        parameter = lens.get("parameters", {}).get("fx_px", {})
        self.focal_std_px = parameter.get("std")
        if self.fit_px is None:
            self.fit_px, self.held_out_px = lens.get("rms_px"), lens.get("held_out_rms_px")

    def rays(self, pixels):
        """Directions in the world through pixels (n, 2), distortion left out; depth 1."""
        flat = (np.asarray(pixels, float) - self.middle) / self.focal
        return np.column_stack([flat, np.ones(len(flat))]) @ self.rotation


class Certificate:
    def __init__(self, file):
        self.file = Path(file)
        try:
            data = json.loads(self.file.read_text(encoding="utf-8"))
            self.verdict = data["verdict"]
            if self.verdict not in VERDICTS:
                raise ValueError(f"'{str(self.verdict)[:20]}' is no verdict")
            self.findings = sorted((dict(f) for f in data["findings"]), key=lambda f: -VERDICTS.index(f["verdict"]))
            for finding in self.findings:
                finding["reason"], finding["remedy"] = str(finding["reason"]), str(finding.get("remedy", ""))
                camera = str(finding.get("camera", ""))
                if camera and camera not in finding["reason"]:
                    finding["reason"] = f"camera {camera}: {finding['reason']}"
            self.made_by, self.made_at = str(data["made_by"]), str(data.get("made_at", ""))
            self.cameras = [CameraPart(name, section) for name, section in data["cameras"].items()]
            self.held_out_px, self.fit_px = data.get("held_out_rms_px"), data.get("fit_rms_px")
            self.scale = data.get("scale_error_mm_per_m")
            self.volume, self.floor, self.hull = data.get("volume"), data.get("floor"), data.get("hull_agreement")
            self.hull_before, self.height = data.get("hull_agreement_before"), data.get("subject_height_m")
            self.world_is_set = bool(data["world_is_set"])
            self.seen = np.array(data.get("seen_points_m") or [], float).reshape(-1, 3)
            self.pictures = {name: self._picture(text) for name, text in data.get("pictures", {}).items()}
        except FileNotFoundError:
            raise ReportError(f"{file}: no such file; check the path") from None
        except (OSError, KeyError, TypeError, ValueError, AttributeError, binascii.Error, cv2.error) as error:
            raise ReportError(f"{file}: is no certificate of a calibration: {type(error).__name__}: "
                              f"{str(error).splitlines()[0][:120] if str(error) else ''}") from None
        if not self.cameras:
            raise ReportError(f"{file}: has no cameras; there is nothing to draw")

    @staticmethod
    def _picture(text):
        picture = cv2.imdecode(np.frombuffer(base64.b64decode(text), np.uint8), cv2.IMREAD_COLOR)
        if picture is None:
            raise ValueError("a picture is broken")
        return cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)

    def placed(self):
        """Whether the cameras have places at all: lenses alone have none."""
        return len({tuple(c.centre) for c in self.cameras}) > 1
