"""The certificate's page: verdict, statistics, plan of the room, residuals of each camera."""
import textwrap

import numpy as np
from matplotlib.patches import FancyBboxPatch, Rectangle

from .room_plan import draw_plan
from .sheet import FAINT, HEIGHT_MM, INK, INNER_MM, MARGIN_MM, LEFT, PANEL, RULE, SOFT, Sheet

COLOURS = {"GO": "#1f8a4c", "CAUTION": "#c98a00", "NO-GO": "#c0392b"}
MEANING = {"GO": "Ready to record.", "CAUTION": "Usable with caution.", "NO-GO": "Do not record with this."}
METHODS = {
    "intrinsics_board": "intrinsics from a board",
    "extrinsics_board": "extrinsics from a board",
    "extrinsics_wand": "extrinsics from a wand",
    "person": "silhouettes of a person",
    "check": "checked with the silhouettes of a person",
    "floor": "world frame redefined",
    "import": "imported",
}
FLOOR_METHODS = {"board": "a board on the floor", "points": "clicked points", "person": "a person's feet"}
RIGHT_MM = MARGIN_MM + INNER_MM


def next_step(certificate):
    """What the verdict means for the user."""
    if certificate.verdict != "NO-GO" and not certificate.has_extrinsics():
        return "Intrinsics. Next: extrinsics."
    if certificate.verdict != "NO-GO" and not certificate.world_defined:
        return "Define the floor, then record."
    return MEANING[certificate.verdict]


def words(number, form, unit=""):
    return "–" if number is None else f"{number:{form}}{unit}"


def verdict_band(sheet, certificate, y):
    """GO, CAUTION or NO-GO, with reasons and remedies. Returns its lower end."""
    colour = COLOURS[certificate.verdict]
    open_findings = [f for f in certificate.findings if f["verdict"] != "GO"]
    lines = []
    for finding in open_findings[:4]:
        reason = finding["reason"][:1].upper() + finding["reason"][1:]
        if finding["verdict"] != certificate.verdict:
            reason = f"{finding['verdict']}: {reason}"
        lines.append(
            (
                textwrap.wrap(reason + ".", 62),
                textwrap.wrap("→ " + finding["remedy"][:1].upper() + finding["remedy"][1:] + ".", 74),
            )
        )
    if not lines:
        checked = ["All checks that this data allows passed."]
        if certificate.has_extrinsics() and not certificate.world_defined:
            checked.append("The floor is not defined yet; use kinevox calibrate floor.")
        targets = {"extrinsics_board": "board", "extrinsics_wand": "wand"}
        if certificate.method in targets and certificate.has_extrinsics() and certificate.stature is None:
            checked.append(f"Scale depends on the given size of the {targets[certificate.method]}:")
            checked.append("check it with a person's stature, kinevox calibrate check.")
        lines = [([line], []) for line in checked]
    height = max(
        30, 11 + sum(4.3 * len(a) + 4.0 * len(b) + 2.2 for a, b in lines) + (4 if len(open_findings) > 4 else 0)
    )
    area = sheet.drawing(MARGIN_MM, y, INNER_MM, height)
    area.add_patch(
        FancyBboxPatch((0, 0), INNER_MM, height, boxstyle="round,pad=0,rounding_size=2.5", fc=colour, ec="none")
    )
    area.text(
        6,
        18.5,
        certificate.verdict,
        size={"GO": 40, "NO-GO": 30, "CAUTION": 24}[certificate.verdict],
        weight="bold",
        color="white",
        va="baseline",
    )
    area.text(6, 25, next_step(certificate), size=9, color="white", va="baseline")
    at = 9
    for reason, remedy in lines:
        for line in reason:
            area.text(51, at, line, size=9, weight="bold", color="white", va="baseline")
            at += 4.3
        for line in remedy:
            area.text(51, at, line, size=8.5, color="white", va="baseline")
            at += 4.0
        at += 2.2
    if len(open_findings) > 4:
        area.text(
            51,
            at,
            f"and {len(open_findings) - 4} more, see the certificate's file",
            size=7.5,
            color="white",
            va="baseline",
        )
    return y + height


def tiles(sheet, certificate, y):
    """Statistics, each with its acceptable range."""
    shown = []
    if certificate.has_extrinsics() and (certificate.held_out_px or certificate.fit_px):
        held = certificate.held_out_px is not None
        shown.append(
            (
                words(certificate.held_out_px if held else certificate.fit_px, ".2f", " px"),
                "held-out reprojection error" if held else "reprojection error",
                "below 0.5 is good",
            )
        )
    if certificate.scale:
        shown.append(
            (
                f"{certificate.scale['bias'] + 0.0:+.1f} mm/m".replace("-0.0", "0.0").replace("+0.0", "0.0"),
                f"scale; spread {certificate.scale['spread']:.1f} mm/m",
                "within ± 2 is good",
            )
        )
    if certificate.volume:
        shown.append(
            (
                f"{100 * certificate.volume['three_view_fraction']:.0f} %",
                f"in view of 3 cameras, {100 * certificate.volume['two_view_fraction']:.0f} % in 2",
                "of the working volume",
            )
        )
        if len(certificate.target_points):
            shown.append(
                (
                    f"{100 * certificate.volume['calibrated_fraction']:.0f} %",
                    "of the working volume covered by the target",
                    "above 80 % is good",
                )
            )
    if certificate.hull:
        before = f"; before {certificate.hull_before['mean_iou']:.2f}" if certificate.hull_before else ""
        shown.append((words(certificate.hull["mean_iou"], ".2f"), "hull IoU" + before, "above 0.8 is good"))
    if certificate.stature is not None:
        shown.append((f"{certificate.stature:.2f} m", "stature of the person", "compare with a measurement"))
    if certificate.floor:
        tilt = certificate.floor.get("tilt_std_deg")
        flat = certificate.floor.get("flatness_rms_mm")
        off = certificate.floor.get("rms_px")
        value = (
            f"± {tilt:.2f}°" if tilt is not None else f"{flat:.0f} mm" if flat is not None else words(off, ".2f", " px")
        )
        what = "floor's tilt" if tilt is not None else "floor's flatness" if flat is not None else "floor residual"
        shown.append((value, what, "from " + FLOOR_METHODS.get(certificate.floor["method"], "?")))
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


def draw_camera(sheet, camera, x, y, width, height, arrows):
    """Coverage of the image by the target, and reprojection residuals magnified `arrows` times."""
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
                    axes.add_patch(
                        Rectangle(
                            (column * cell[0] - 0.5, row * cell[1] - 0.5), *cell, fc="#dcebe3", ec="white", lw=0.4
                        )
                    )
    if len(camera.residuals):
        long = np.hypot(camera.residuals[:, 2], camera.residuals[:, 3])
        bad = long > 1.0
        shown = camera.residuals.copy()  # limits the length of large ones
        shown[:, 2:] *= np.minimum(1, 0.16 * camera.size[0] / arrows / np.maximum(long, 1e-9))[:, None]
        for choice, colour in ((~bad, LEFT), (bad, "#c0392b")):
            if choice.any():
                axes.quiver(
                    *shown[choice].T,
                    angles="xy",
                    scale_units="xy",
                    scale=1 / arrows,
                    width=0.004,
                    color=colour,
                    headwidth=3,
                    headlength=3.5,
                    headaxislength=3,
                )
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
    """Columns, width and height that make `count` images largest in `room` mm of height, captions below."""
    best = None
    for columns in range(min(count, 2), 9):
        width = (INNER_MM - 4 * (columns - 1)) / columns
        height = min(aspect * width, room / -(-count // columns) - 9)
        if best is None or height > best[2]:
            best = columns, width, height
    return best


def draw_cameras(sheet, certificate, y, bottom):
    """One image per camera, as large as possible. Returns the lower end."""
    shown = [c for c in certificate.cameras if c.counts is not None or len(c.residuals)]
    if not shown:
        return y
    named = {f.get("camera"): f["verdict"] for f in reversed(certificate.findings) if f["verdict"] != "GO"}
    columns, width, height = fitting(len(shown), max(c.size[1] / c.size[0] for c in shown), bottom - y - 5)
    rows = -(-len(shown) // columns)
    usual = np.median([np.median(np.hypot(*c.residuals[:, 2:].T)) for c in shown if len(c.residuals)] or [1])
    wanted = 0.05 * max(c.size[0] for c in shown) / max(usual, 1e-3)
    arrows = next((n for n in (200, 100, 50, 20, 10, 5, 2) if n <= wanted), 1)
    sheet.heading(
        MARGIN_MM,
        y,
        "Coverage and residuals",
        INNER_MM,
        "green: covered"
        + (f";  arrows: residuals x {arrows};  red: above 1 px" if any(len(c.residuals) for c in shown) else ""),
    )
    y += 5
    for i, camera in enumerate(shown):
        x, top = MARGIN_MM + i % columns * (width + 4), y + i // columns * (height + 9)
        high = draw_camera(sheet, camera, x, top, width, height, arrows)
        colour = COLOURS.get(named.get(camera.name), INK)
        sheet.text(x, top + high + 3.4, camera.name, size=7.5, weight="bold", color=colour)
        sheet.text(x, top + high + 6.4, caption_of(camera), size=6, color=SOFT)
    return y + rows * (height + 9)


def draw_overlays(sheet, certificate, y, height):
    """Silhouette and hull of one frame set, all cameras."""
    names = list(certificate.overlays)[:8]
    sheet.heading(MARGIN_MM, y, "Silhouettes and hull", INNER_MM)
    sheet.text(RIGHT_MM, y, "white: both   orange: silhouette only   blue: hull only", size=6.5, color=SOFT, ha="right")
    y += 4
    width = min((INNER_MM - 3 * (len(names) - 1)) / len(names), height * 0.75)
    gap = 3 if len(names) < 2 else min(8, (INNER_MM - width * len(names)) / (len(names) - 1))
    for i, name in enumerate(names):
        axes = sheet.axes(MARGIN_MM + i * (width + gap), y, width, width / 0.75)
        axes.imshow(certificate.overlays[name], interpolation="lanczos", aspect="auto")
        axes.set_axis_off()
        iou = (certificate.hull or {}).get("cameras", {}).get(name)
        sheet.text(
            MARGIN_MM + i * (width + gap),
            y + width / 0.75 + 3.2,
            name + (f"  {iou:.2f}" if iou is not None else ""),
            size=7,
            weight="bold",
        )
    return y + width / 0.75 + 6


def make_certificate_page(certificate):
    sheet = Sheet()
    sheet.text(
        MARGIN_MM,
        19,
        "Camera calibration" if certificate.has_extrinsics() else "Camera intrinsics",
        size=19,
        weight="bold",
    )
    parts = [f"{len(certificate.cameras)} cameras", METHODS.get(certificate.method, certificate.method)]
    if certificate.create_time:
        parts.append(certificate.create_time + " UTC")
    parts.append("/".join(certificate.file.absolute().parts[-2:]))
    sheet.text(MARGIN_MM, 24.5, "  ·  ".join(parts)[:130], size=7, color=SOFT)
    sheet.text(RIGHT_MM, 19, "kinevox", size=10, weight="bold", color=FAINT, ha="right")
    y = verdict_band(sheet, certificate, 28.5) + 4
    y = tiles(sheet, certificate, y) + 8

    bottom = HEIGHT_MM - 18
    has_cameras = any(c.counts is not None or len(c.residuals) for c in certificate.cameras)
    if certificate.has_extrinsics():
        rows = -(-len(certificate.cameras) // columns_for(len(certificate.cameras)))
        taken = (rows * 51 + 5 if has_cameras else 0) + (58 if certificate.overlays else 0)
        height = min(INNER_MM * 0.74, max(62, bottom - y - taken - 6))
        sheet.heading(
            MARGIN_MM,
            y,
            "Plan of the room" if certificate.world_defined else "Plan of the room, floor not defined",
            INNER_MM,
        )
        y = draw_plan(sheet, certificate, MARGIN_MM, y + 4, INNER_MM, height) + 8
    if certificate.overlays:
        y = draw_overlays(sheet, certificate, y, 46 if has_cameras else min(80, bottom - y - 12)) + 4
    if has_cameras:
        draw_cameras(sheet, certificate, y, bottom)
    sheet.line(MARGIN_MM, HEIGHT_MM - 13, INNER_MM)
    sheet.text(
        MARGIN_MM,
        HEIGHT_MM - 9,
        "Held-out points are not used by the fit. Recheck a calibration with kinevox calibrate check "
        "after a camera was touched.",
        size=6,
        color=FAINT,
    )
    return sheet
