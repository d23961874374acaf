"""The page of `kinevox sync`: each camera's evidence by offset, and the movement before and after alignment."""
import json
from pathlib import Path

import numpy as np
from matplotlib.ticker import MaxNLocator

from .sheet import FAINT, HEIGHT_MM, INK, INNER_MM, MARGIN_MM, RULE, SOFT, Sheet
from .trial import ReportError

COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#7f6ab0", "#5b6675")
TABLE_MM, MOVEMENT_MM = 6, 62
ZOOM_S, ZOOM_MM, GUTTER_MM = 0.3, 46, 12


class Alignment:
    def __init__(self, file):
        try:
            data = json.loads(Path(file).read_text(encoding="utf-8"))
            self.session, self.fps = str(data["session"]), float(data["fps"])
            self.used_extrinsics = bool(data["used_extrinsics"])
            self.cameras = list(data["cameras"])
            if not self.cameras or not self.fps > 0:
                raise ValueError("it has no cameras or no rate")
            for camera in self.cameras:
                camera["evidence"] = np.array(camera["curve"]["evidence_nats"], float)
                camera["offsets_s"] = camera["curve"]["first_offset_s"] + np.arange(len(camera["evidence"])) / self.fps
                camera["changed"] = np.array(camera["changed_fraction_per_s"], float)
                for key in ("offset_s", "std_s", "runner_up_ratio", "runner_up_offset_s", "evidence_nats"):
                    camera[key] = float(camera[key])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ReportError(f"{file}: not an alignment of `kinevox sync`: {error}") from None


def is_alignment(file):
    try:
        return json.loads(Path(file).read_text(encoding="utf-8")).get("kind") == "alignment"
    except (OSError, ValueError, AttributeError):
        return False


def bare(axes):
    for side in ("top", "left", "right"):
        axes.spines[side].set_visible(False)
    axes.grid(axis="y", color=RULE, linewidth=0.5)
    axes.set_axisbelow(True)
    axes.xaxis.set_major_formatter(lambda v, _: f"{v:g}".replace("-", "−"))


def draw_curve(axes, camera, colour, low_s, high_s):
    offsets = camera["offset_s"] + camera["offsets_s"]
    shown = (offsets >= low_s) & (offsets <= high_s)
    axes.axvline(camera["offset_s"], color=FAINT, linewidth=0.7)
    axes.plot(offsets[shown], camera["evidence"][shown], color=colour, linewidth=1.1)
    axes.plot(
        [camera["offset_s"]], [np.interp(0, camera["offsets_s"], camera["evidence"])], "o", color=colour, markersize=3.5
    )
    axes.set_xlim(low_s, high_s)
    axes.yaxis.set_major_locator(MaxNLocator(3))
    bare(axes)


def span_of_evidence(camera):
    """Offsets at which the camera overlaps any other, s."""
    there = np.flatnonzero(camera["evidence"])
    offsets = camera["offset_s"] + camera["offsets_s"]
    return (offsets[there[0]], offsets[there[-1]]) if len(there) else (offsets[0], offsets[-1])


def draw_cameras(sheet, alignment, y, pitch):
    wide = INNER_MM - 12 - ZOOM_MM - GUTTER_MM
    low, high = zip(*(span_of_evidence(c) for c in alignment.cameras))
    for k, camera in enumerate(alignment.cameras):
        colour, top = COLOURS[k % len(COLOURS)], y + k * pitch
        offset = f"offset {camera['offset_s']:.4f} s  ± {camera['std_s']:.4f} s"
        runner_up = "no comparable runner-up"
        if camera["runner_up_ratio"] > 0:
            shift = f"{camera['runner_up_offset_s']:+.3f} s".replace("-", "−")
            runner_up = f"runner-up: {shift}, {100 * camera['runner_up_ratio']:.0f} % of the quality"
        sheet.text(MARGIN_MM, top + 3.2, camera["name"], size=8, weight="bold", color=colour)
        sheet.text(MARGIN_MM + 28, top + 3.2, offset, size=8, color=INK)
        sheet.text(MARGIN_MM + INNER_MM, top + 3.2, runner_up, size=6.5, color=SOFT, ha="right")
        axes = sheet.axes(MARGIN_MM + 12, top + TABLE_MM, wide, pitch - TABLE_MM - 6)
        draw_curve(axes, camera, colour, min(low), max(high))
        near = sheet.axes(MARGIN_MM + INNER_MM - ZOOM_MM, top + TABLE_MM, ZOOM_MM, pitch - TABLE_MM - 6)
        draw_curve(near, camera, colour, camera["offset_s"] - ZOOM_S, camera["offset_s"] + ZOOM_S)
        near.axvspan(
            camera["offset_s"] - camera["std_s"],
            camera["offset_s"] + camera["std_s"],
            color=colour,
            alpha=0.18,
            linewidth=0,
        )
        near.set_yticks([])
        near.xaxis.set_major_locator(MaxNLocator(4))


def draw_movement(axes, alignment, aligned):
    last = 0
    for k, camera in enumerate(alignment.cameras):
        time = np.arange(len(camera["changed"])) / alignment.fps + (camera["offset_s"] if aligned else 0)
        axes.plot(time, camera["changed"], color=COLOURS[k % len(COLOURS)], linewidth=0.9, label=camera["name"])
        last = max(last, time[-1] if len(time) else 0)
    axes.set_xlim(0, last or 1)
    axes.set_ylim(bottom=0)
    axes.yaxis.set_major_locator(MaxNLocator(3))
    bare(axes)


def make_alignment_page(alignment):
    sheet = Sheet()
    sheet.text(MARGIN_MM, 19, f"{alignment.session}: aligned in time", size=17, weight="bold")
    by = "silhouette motion and extrinsics" if alignment.used_extrinsics else "silhouette motion only"
    sheet.text(
        MARGIN_MM,
        24.5,
        f"{len(alignment.cameras)} cameras, {alignment.fps:g} frames per second, by {by}",
        size=7,
        color=SOFT,
    )
    top = 33
    sheet.heading(
        MARGIN_MM,
        top,
        "Evidence by offset",
        INNER_MM,
        "nats, of all pairs with this camera, the others as found; right: ± 0.3 s, band: standard deviation; " "x: s",
    )
    room = HEIGHT_MM - MARGIN_MM - MOVEMENT_MM - 6 - top - 4
    draw_cameras(sheet, alignment, top + 5, min(38, room / len(alignment.cameras)))
    y = HEIGHT_MM - MARGIN_MM - MOVEMENT_MM
    sheet.heading(
        MARGIN_MM,
        y,
        "Movement",
        INNER_MM,
        "fraction of the silhouette that changes per second; above: unaligned, " "below: aligned; x: s",
    )
    height = (MOVEMENT_MM - 14) / 2
    for k, aligned in enumerate((False, True)):
        draw_movement(sheet.axes(MARGIN_MM + 12, y + 5 + k * (height + 5), INNER_MM - 12, height), alignment, aligned)
    return sheet
