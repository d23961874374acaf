"""The certificate's page: the verdict, big; the figures; the room from above; each camera's picture."""
import textwrap

import numpy as np
from matplotlib.patches import FancyBboxPatch, Rectangle

from .room_plan import draw_plan
from .sheet import FAINT, HEIGHT_MM, INK, INNER_MM, MARGIN_MM, LEFT, PANEL, RULE, SOFT, Sheet

COLOURS = {"GO": "#1f8a4c", "CARE": "#c98a00", "NO-GO": "#c0392b"}
SAID = {"GO": "Ready to record.", "CARE": "Usable, with care.", "NO-GO": "Do not record with this."}
MADE_BY = {"board": "from a board moved through the space", "wand": "from a wand waved through the space",
           "person": "from the silhouettes of a person", "check": "checked on the silhouettes of a person",
           "floor": "floor and origin set anew", "lenses": "lenses", "import": "imported"}
FLOOR_BY = {"board": "a board on the floor", "points": "clicked points", "person": "a person's feet"}
RIGHT_MM = MARGIN_MM + INNER_MM


def said(certificate):
    """What the verdict means for what to do now."""
    if certificate.verdict != "NO-GO" and not certificate.placed():
        return "Lenses. Places come next."
    if certificate.verdict != "NO-GO" and not certificate.world_is_set:
        return "Set the floor, then record."
    return SAID[certificate.verdict]


def words(number, form, unit=""):
    return "–" if number is None else f"{number:{form}}{unit}"


def verdict_band(sheet, certificate, y):
    """GO, CARE or NO-GO, why and what to do. Returns where it ends."""
    colour = COLOURS[certificate.verdict]
    told = [f for f in certificate.findings if f["verdict"] != "GO"]
    lines = []
    for finding in told[:4]:
        reason = finding["reason"][:1].upper() + finding["reason"][1:]
        if finding["verdict"] != certificate.verdict:
            reason = f"{finding['verdict']}: {reason}"
        lines.append((textwrap.wrap(reason + ".", 62),
                      textwrap.wrap("→ " + finding["remedy"][:1].upper() + finding["remedy"][1:] + ".", 74)))
    if not lines:
        checked = ["The checks that this evidence allows found nothing wrong."]
        if certificate.placed() and not certificate.world_is_set:
            checked.append("The floor is not set yet: kinevox calibrate floor does it.")
        if certificate.made_by in ("board", "wand") and certificate.placed() and certificate.height is None:
            checked.append(f"Lengths are as true as what was told of the {certificate.made_by}'s size:")
            checked.append("compare the height of a person, kinevox calibrate check.")
        lines = [([line], []) for line in checked]
    height = max(30, 11 + sum(4.3 * len(a) + 4.0 * len(b) + 2.2 for a, b in lines) + (4 if len(told) > 4 else 0))
    area = sheet.drawing(MARGIN_MM, y, INNER_MM, height)
    area.add_patch(FancyBboxPatch((0, 0), INNER_MM, height, boxstyle="round,pad=0,rounding_size=2.5", fc=colour, ec="none"))
    area.text(6, 18.5, certificate.verdict, size=40 if certificate.verdict != "NO-GO" else 30, weight="bold", color="white",
              va="baseline")
    area.text(6, 25, said(certificate), size=9, color="white", va="baseline")
    at = 9
    for reason, remedy in lines:
        for line in reason:
            area.text(51, at, line, size=9, weight="bold", color="white", va="baseline")
            at += 4.3
        for line in remedy:
            area.text(51, at, line, size=8.5, color="white", va="baseline")
            at += 4.0
        at += 2.2
    if len(told) > 4:
        area.text(51, at, f"and {len(told) - 4} more, see the certificate's file", size=7.5, color="white", va="baseline")
    return y + height


def tiles(sheet, certificate, y):
    """The figures, each with what is good."""
    shown = []
    if certificate.placed() and (certificate.held_out_px or certificate.fit_px):
        held = certificate.held_out_px is not None
        shown.append((words(certificate.held_out_px if held else certificate.fit_px, ".2f", " px"),
                      "points kept out of the fit" if held else "points fitted", "miss by; below 0.5 is good"))
    if certificate.scale:
        shown.append((f"{certificate.scale['bias'] + 0.0:+.1f} mm/m".replace("-0.0", "0.0").replace("+0.0", "0.0"), f"scale; spread {certificate.scale['spread']:.1f} mm/m",
                      "within ± 2 is good"))
    if certificate.volume:
        shown.append((f"{100 * certificate.volume['seen_by_three_cameras']:.0f} %",
                      f"of it in 3 cameras, {100 * certificate.volume['seen_by_two_cameras']:.0f} % in 2",
                      "of the working volume"))
        if len(certificate.seen):
            shown.append((f"{100 * certificate.volume['calibrated']:.0f} %", "of the working volume was shown", "above 80 % is good"))
    if certificate.hull:
        before = f"; before {certificate.hull_before['mean_iou']:.2f}" if certificate.hull_before else ""
        shown.append((words(certificate.hull["mean_iou"], ".2f"), "hull and silhouettes agree" + before,
                      "1 is all; above 0.8 is good"))
    if certificate.height is not None:
        shown.append((f"{certificate.height:.2f} m", "tall is the person", "compare it with a ruler"))
    if certificate.floor:
        tilt = certificate.floor.get("tilt_std_deg")
        flat = certificate.floor.get("flat_rms_mm")
        off = certificate.floor.get("rms_px")
        value = (f"± {tilt:.2f}°" if tilt is not None else f"{flat:.0f} mm" if flat is not None else words(off, ".2f", " px"))
        what = "floor's tilt" if tilt is not None else "floor's flatness" if flat is not None else "floor's points miss by"
        shown.append((value, what, "from " + FLOOR_BY.get(certificate.floor["made_by"], "?")))
    shown = shown[:6]
    if not shown:
        return y
    width = (INNER_MM - 3 * (len(shown) - 1)) / len(shown)
    for i, (value, what, good) in enumerate(shown):
        area = sheet.drawing(MARGIN_MM + i * (width + 3), y, width, 18)
        area.add_patch(FancyBboxPatch((0, 0), width, 18, boxstyle="round,pad=0,rounding_size=1.5", fc=PANEL, ec="none"))
        area.text(2.5, 7.6, value, size=13 if len(shown) < 5 else 10.5, weight="bold", va="baseline")
        # Two short lines below rather than one that runs over.
        for k, line in enumerate(textwrap.wrap(what, max(12, int(width / 1.18)))[:2]):
            area.text(2.5, 11.2 + 2.6 * k, line, size=6, color=SOFT, va="baseline")
        area.text(2.5, 16.6, good, size=5.5, color=FAINT, va="baseline")
    return y + 18


def camera_picture(sheet, camera, x, y, width, height, arrows):
    """Where in its picture the camera saw what was shown, and by how much it misses, `arrows` times enlarged."""
    scale = min(width / camera.size[0], height / camera.size[1])
    wide, high = scale * camera.size
    axes = sheet.axes(x, y, wide, high)
    axes.set_xlim(-0.5, camera.size[0] - 0.5)
    axes.set_ylim(camera.size[1] - 0.5, -0.5)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_facecolor("#fbfcfd")
    for spine in axes.spines.values():
        spine.set_color(RULE)
    if camera.counts is not None:
        cell = camera.size / [8, 6]
        for row in range(6):
            for column in range(8):
                if camera.counts[row, column] > 0:
                    axes.add_patch(Rectangle((column * cell[0] - 0.5, row * cell[1] - 0.5), *cell, fc="#dcebe3", ec="white", lw=0.4))
    if len(camera.misses):
        long = np.hypot(camera.misses[:, 2], camera.misses[:, 3])
        bad = long > 1.0
        shown = camera.misses.copy()   # what would run through the whole picture ends early
        shown[:, 2:] *= np.minimum(1, 0.16 * camera.size[0] / arrows / np.maximum(long, 1e-9))[:, None]
        for choice, colour in ((~bad, LEFT), (bad, "#c0392b")):
            if choice.any():
                axes.quiver(*shown[choice].T, angles="xy", scale_units="xy", scale=1 / arrows, width=0.004,
                            color=colour, headwidth=3, headlength=3.5, headaxislength=3)
    return high


def caption_of(camera):
    px = camera.held_out_px if camera.held_out_px is not None else camera.fit_px
    parts = [words(px, ".2f", " px")] if px is not None else []
    if camera.focal_std_px is not None:
        parts.append(f"focal length {camera.focal[0]:.0f} ± {camera.focal_std_px:.0f} px")
    if camera.views is not None:
        parts.append(f"{camera.views} views")
    if camera.coverage is not None:
        parts.append(f"{100 * camera.coverage:.0f} % covered")
    return "  ·  ".join(parts)


def columns_for(count):
    return 4 if count <= 8 else 6


def fitting(count, aspect, room):
    """Columns, width and height that make `count` pictures largest in `room` mm of height, captions below."""
    best = None
    for columns in range(min(count, 2), 9):
        width = (INNER_MM - 4 * (columns - 1)) / columns
        height = min(aspect * width, room / -(-count // columns) - 9)
        if best is None or height > best[2]:
            best = columns, width, height
    return best


def draw_cameras(sheet, certificate, y, bottom):
    """A picture a camera, as large as there is room. Returns where they end."""
    shown = [c for c in certificate.cameras if c.counts is not None or len(c.misses)]
    if not shown:
        return y
    named = {f.get("camera"): f["verdict"] for f in reversed(certificate.findings) if f["verdict"] != "GO"}
    columns, width, height = fitting(len(shown), max(c.size[1] / c.size[0] for c in shown), bottom - y - 5)
    rows = -(-len(shown) // columns)
    usual = np.median([np.median(np.hypot(*c.misses[:, 2:].T)) for c in shown if len(c.misses)] or [1])
    wanted = 0.05 * max(c.size[0] for c in shown) / max(usual, 1e-3)
    arrows = next((n for n in (200, 100, 50, 20, 10, 5, 2) if n <= wanted), 1)
    sheet.heading(MARGIN_MM, y, "What each camera saw", INNER_MM,
                  "green: seen there" + (f";  arrows: misses, {arrows} times enlarged;  red: more than 1 px"
                                         if any(len(c.misses) for c in shown) else ""))
    y += 5
    for i, camera in enumerate(shown):
        x, top = MARGIN_MM + i % columns * (width + 4), y + i // columns * (height + 9)
        high = camera_picture(sheet, camera, x, top, width, height, arrows)
        colour = COLOURS.get(named.get(camera.name), INK)
        sheet.text(x, top + high + 3.4, camera.name, size=7.5, weight="bold", color=colour)
        sheet.text(x, top + high + 6.4, caption_of(camera), size=6, color=SOFT)
    return y + rows * (height + 9)


def draw_agreement(sheet, certificate, y, height):
    """Silhouette against hull, one moment, all cameras."""
    names = list(certificate.pictures)[:8]
    sheet.heading(MARGIN_MM, y, "Do the cameras agree about the person?", INNER_MM)
    sheet.text(RIGHT_MM, y, "white: silhouette and hull   orange: silhouette alone   blue: hull alone", size=6.5, color=SOFT,
               ha="right")
    y += 4
    width = min((INNER_MM - 3 * (len(names) - 1)) / len(names), height * 0.75)
    gap = 3 if len(names) < 2 else min(8, (INNER_MM - width * len(names)) / (len(names) - 1))
    for i, name in enumerate(names):
        axes = sheet.axes(MARGIN_MM + i * (width + gap), y, width, width / 0.75)
        axes.imshow(certificate.pictures[name], interpolation="lanczos", aspect="auto")
        axes.set_axis_off()
        iou = (certificate.hull or {}).get("cameras", {}).get(name)
        sheet.text(MARGIN_MM + i * (width + gap), y + width / 0.75 + 3.2, name + (f"  {iou:.2f}" if iou is not None else ""), size=7,
                   weight="bold")
    return y + width / 0.75 + 6


def make_certificate_page(certificate):
    sheet = Sheet()
    sheet.text(MARGIN_MM, 19, "Camera calibration" if certificate.placed() else "Camera lenses", size=19, weight="bold")
    parts = [f"{len(certificate.cameras)} cameras", MADE_BY.get(certificate.made_by, certificate.made_by)]
    if certificate.made_at:
        parts.append(certificate.made_at + " UTC")
    parts.append("/".join(certificate.file.absolute().parts[-2:]))
    sheet.text(MARGIN_MM, 24.5, "  ·  ".join(parts)[:130], size=7, color=SOFT)
    sheet.text(RIGHT_MM, 19, "kinevox", size=10, weight="bold", color=FAINT, ha="right")
    y = verdict_band(sheet, certificate, 28.5) + 4
    y = tiles(sheet, certificate, y) + 8

    bottom = HEIGHT_MM - 18
    has_cameras = any(c.counts is not None or len(c.misses) for c in certificate.cameras)
    if certificate.placed():
        rows = -(-len(certificate.cameras) // columns_for(len(certificate.cameras)))
        taken = (rows * 51 + 5 if has_cameras else 0) + (58 if certificate.pictures else 0)
        height = min(INNER_MM * 0.74, max(62, bottom - y - taken - 6))
        sheet.heading(MARGIN_MM, y, "The room from above" if certificate.world_is_set else "The room from above, floor not set",
                      INNER_MM)
        y = draw_plan(sheet, certificate, MARGIN_MM, y + 4, INNER_MM, height) + 8
    if certificate.pictures:
        y = draw_agreement(sheet, certificate, y, 46 if has_cameras else min(80, bottom - y - 12)) + 4
    if has_cameras:
        draw_cameras(sheet, certificate, y, bottom)
    sheet.line(MARGIN_MM, HEIGHT_MM - 13, INNER_MM)
    sheet.text(MARGIN_MM, HEIGHT_MM - 9, "Points kept out of the fit measure it: the fit did not see them. A calibration holds until "
               "a camera is touched; kinevox calibrate check tells.", size=6, color=FAINT)
    return sheet
