"""A calibration's certificate, as `kinevox calibrate` writes it, checked for drawing."""
import base64
import binascii
import json
from pathlib import Path

import cv2
import numpy as np

from .trial import ReportError

VERDICTS = ("GO", "CAUTION", "NO-GO")


class CertifiedCamera:
    """One camera: intrinsics, pose, quality. Lengths in m, world; pixels as in OpenCV."""

    def __init__(self, name, section):
        self.name = name
        self.size = np.array(section["size_px"], float).reshape(2)
        self.focal = np.array(section["focal_px"], float).reshape(2)
        self.principal_point = np.array(section["principal_point_px"], float).reshape(2)
        pose = section["camera_from_world"]
        self.rotation = cv2.Rodrigues(np.array(pose["rotation_vector"], float).reshape(3))[0]  # camera from world
        self.centre = np.array(section["centre_m"], float).reshape(3)
        intrinsics = section.get("intrinsics", {})
        shown = section if "coverage_counts" in section else intrinsics
        self.views = section.get("views", intrinsics.get("views_used"))
        self.coverage = shown.get("coverage")
        counts = shown.get("coverage_counts") or []
        self.counts = np.array(counts, float).reshape(6, 8) if counts else None
        self.residuals = np.array(section.get("residuals_px") or [], float).reshape(-1, 4)
        self.held_out_px, self.fit_px = section.get("held_out_reprojection_rms_px"), section.get(
            "fit_reprojection_rms_px"
        )
        parameter = intrinsics.get("parameters", {}).get("fx_px", {})
        self.focal_std_px = parameter.get("std")
        if self.fit_px is None:
            self.fit_px, self.held_out_px = intrinsics.get("rms_px"), intrinsics.get("held_out_rms_px")

    def rays(self, pixels):
        """Directions in the world through pixels (n, 2), without distortion; depth 1."""
        flat = (np.asarray(pixels, float) - self.principal_point) / self.focal
        return np.column_stack([flat, np.ones(len(flat))]) @ self.rotation


class Certificate:
    def __init__(self, file):
        self.file = Path(file)
        try:
            data = json.loads(self.file.read_text(encoding="utf-8"))
            self.verdict = data["verdict"]
            if self.verdict not in VERDICTS:
                raise ValueError(f"'{str(self.verdict)[:20]}' is not a verdict")
            self.findings = sorted((dict(f) for f in data["findings"]), key=lambda f: -VERDICTS.index(f["verdict"]))
            for finding in self.findings:
                finding["reason"], finding["remedy"] = str(finding["reason"]), str(finding.get("remedy", ""))
                camera = str(finding.get("camera", ""))
                if camera and camera not in finding["reason"]:
                    finding["reason"] = f"camera {camera}: {finding['reason']}"
            self.method, self.create_time = str(data["method"]), str(data.get("create_time", ""))
            self.cameras = [CertifiedCamera(name, section) for name, section in data["cameras"].items()]
            self.held_out_px, self.fit_px = data.get("held_out_reprojection_rms_px"), data.get(
                "fit_reprojection_rms_px"
            )
            self.scale = data.get("scale_error_mm_per_m")
            self.volume, self.floor, self.hull = data.get("volume"), data.get("floor"), data.get("hull_iou")
            self.hull_before, self.stature = data.get("hull_iou_before"), data.get("stature_m")
            self.world_defined = bool(data["world_defined"])
            self.target_points = np.array(data.get("target_points_m") or [], float).reshape(-1, 3)
            self.overlays = {name: self._image(text) for name, text in data.get("overlay_images", {}).items()}
        except FileNotFoundError:
            raise ReportError(f"{file}: no such file; check the path") from None
        except (OSError, KeyError, TypeError, ValueError, AttributeError, binascii.Error, cv2.error) as error:
            raise ReportError(
                f"{file}: not a calibration certificate: {type(error).__name__}: "
                f"{str(error).splitlines()[0][:120] if str(error) else ''}"
            ) from None
        if not self.cameras:
            raise ReportError(f"{file}: has no cameras")

    @staticmethod
    def _image(text):
        image = cv2.imdecode(np.frombuffer(base64.b64decode(text), np.uint8), cv2.IMREAD_COLOR)
        if image is None:
            raise ValueError("an image is damaged")
        return cv2.cvtColor(image, cv2.COLOR_BGR2RGB)

    def has_extrinsics(self):
        """False for a calibration of intrinsics only."""
        return len({tuple(c.centre) for c in self.cameras}) > 1
