"""Numbers: key values at the top, left-right comparison at the bottom."""
import numpy as np
from matplotlib.patches import Circle, FancyBboxPatch, Rectangle

from .sheet import FAINT, INK, INNER_MM, LEFT, MARGIN_MM, PANEL, RIGHT, RULE, SOFT, STAGE_COLOURS
from .trial import STAGES, label_of, spread

ROW_MM = 5.4
ANGLE_ROWS = (
    "hip_flexion_geometric",
    "knee_flexion_geometric",
    "hip_abduction_geometric",
    "shoulder_elevation_geometric",
    "elbow_flexion_geometric",
)
SEGMENT_ROWS = (
    ("hip", "knee", "Thigh"),
    ("knee", "ankle", "Shank"),
    ("shoulder", "elbow", "Upper arm"),
    ("elbow", "wrist", "Forearm"),
)
MIN_RANGE_DEG = 5  # for a ratio of ranges


def number(value, digits=0, unit=""):
    return "–" if not np.isfinite(value) else f"{value:.{digits}f}".replace("-", "−") + unit


def draw_tiles(sheet, trial, y):
    height, gap = 13.5, 2.5
    stds = [np.nanmedian(s) for n, s in trial.std.items() if np.isfinite(s).any()]
    total = trial.stage_ms.get("total")
    total_ms = float(np.median(total)) if total is not None else float("nan")
    tiles = [
        ("duration", number(trial.duration_s, 2, " s")),
        ("frames", f"{len(trial.frames)}"),
        ("frame rate", number(trial.rate_hz, 4 if trial.rate_hz < 1 else 0, " Hz")),
        ("values withheld", number(100 * trial.withheld_fraction(), 1, " %")),
        ("median angle std", "± " + number(np.median(stds), 1, "°") if stds else "–"),
        ("time per frame", number(total_ms, 1, " ms")),
    ]
    width = (INNER_MM - (len(tiles) - 1) * gap) / len(tiles)
    axes = sheet.drawing(MARGIN_MM, y, INNER_MM, height)
    for k, (label, value) in enumerate(tiles):
        x = k * (width + gap)
        axes.add_patch(
            FancyBboxPatch(
                (x + 1, 1),
                width - 2,
                height - 2,
                boxstyle="round,pad=1,rounding_size=1.2",
                facecolor=PANEL,
                edgecolor="none",
            )
        )
        axes.text(x + 2.6, 6.6, value, size=11, weight="bold", va="baseline")
        axes.text(x + 2.6, 11, label, size=6, color=SOFT, va="baseline")
    return height


def ratio_mark(axes, x, width, y, ratio):
    """A ruler from 0.75 to 1.33, logarithmic, 1 in the centre, and the ratio on it."""
    centre = x + width / 2
    axes.plot([x, x + width], [y, y], color=RULE, linewidth=1.6, solid_capstyle="round")
    axes.plot([centre, centre], [y - 1, y + 1], color=FAINT, linewidth=0.7)
    if np.isfinite(ratio) and ratio > 0:
        at = np.clip(np.log(ratio) / np.log(4 / 3), -1, 1)
        axes.add_patch(
            Circle(
                (centre + at * width / 2, y),
                0.95,
                zorder=3,
                linewidth=0,
                facecolor=LEFT if ratio > 1.05 else RIGHT if ratio < 1 / 1.05 else INK,
            )
        )


def ratio_cell(axes, x, y, ratio):
    axes.text(x, y, number(ratio, 2), size=7, ha="right", va="baseline", weight="bold" if np.isfinite(ratio) else None)


def draw_ranges(sheet, trial, x, y, width):
    """Ranges of motion; `width` mm."""
    sheet.heading(x, y, "Ranges of motion, left and right", width)
    top = y + 3
    axes = sheet.drawing(x, top, width, (len(ANGLE_ROWS) + 4) * ROW_MM)
    head = ROW_MM * 0.75
    for word, right in (("range", 47), ("min to max", 80), ("peak °/s", 99)):
        axes.text(right, head, word, size=6.3, color=SOFT, ha="right", va="baseline")
    axes.text(width, head, "left / right", size=6.3, color=SOFT, ha="right", va="baseline")
    for k, angle in enumerate(ANGLE_ROWS):
        base = head + (k + 1) * ROW_MM
        if k % 2 == 0:
            axes.add_patch(Rectangle((-1, base - 3.75), width + 2, ROW_MM, facecolor=PANEL, edgecolor="none"))
        axes.text(0, base, label_of(angle), size=7.2, va="baseline")
        ranges = []
        for side, colour, columns in (("l", LEFT, (38, 64, 90)), ("r", RIGHT, (47, 80, 99))):
            low, high = spread(trial.angles[f"{angle}_{side}"])
            ranges.append(high - low)
            speeds = np.abs(trial.speed(f"{angle}_{side}"))
            peak = np.nanmax(speeds) if np.isfinite(speeds).any() else float("nan")
            axes.text(columns[0], base, number(high - low, 0, "°"), size=7, color=colour, ha="right", va="baseline")
            axes.text(
                columns[1],
                base,
                f"{number(low)} … {number(high)}°" if np.isfinite(low) else "–",
                size=7,
                color=colour,
                ha="right",
                va="baseline",
            )
            axes.text(columns[2], base, number(peak), size=7, color=colour, ha="right", va="baseline")
        ratio = ranges[0] / ranges[1] if min(ranges) >= MIN_RANGE_DEG else float("nan")
        ratio_mark(axes, width - 22, 13, base - 1.1, ratio)
        ratio_cell(axes, width, base, ratio)
    return top + head + (len(ANGLE_ROWS) + 1) * ROW_MM


def draw_segments(sheet, trial, x, y, width):
    sheet.heading(x, y, "Segments", width, "median length, mm")
    axes = sheet.drawing(x, y + 3, width, (len(SEGMENT_ROWS) + 2) * ROW_MM)
    head = ROW_MM * 0.75
    axes.text(width, head, "left / right", size=6.3, color=SOFT, ha="right", va="baseline")
    for k, (a, b, title) in enumerate(SEGMENT_ROWS):
        base = head + (k + 1) * ROW_MM
        if k % 2 == 0:
            axes.add_patch(Rectangle((-1, base - 3.75), width + 2, ROW_MM, facecolor=PANEL, edgecolor="none"))
        left, right = trial.length_mm(f"{a}_l", f"{b}_l"), trial.length_mm(f"{a}_r", f"{b}_r")
        axes.text(0, base, title, size=7.2, va="baseline")
        axes.text(29, base, number(left), size=7, color=LEFT, ha="right", va="baseline")
        axes.text(38, base, number(right), size=7, color=RIGHT, ha="right", va="baseline")
        ratio_cell(axes, width, base, left / right)


def draw_stage_times(sheet, trial, x, y, width):
    if not trial.stage_ms:
        return
    medians = {s: float(np.median(trial.stage_ms[s])) for s in STAGES}
    total = sum(medians.values())
    sheet.text(x, y, "Median time per frame", size=7, weight="bold")
    axes = sheet.drawing(x, y + 1.5, width, 9)
    at = 0.0
    for stage, ms in medians.items():
        length = width * ms / total if total > 0 else 0
        axes.add_patch(Rectangle((at, 0), length, 3, facecolor=STAGE_COLOURS[stage], edgecolor="white", linewidth=0.5))
        at += length
    pitch = width / len(medians)
    for k, (stage, ms) in enumerate(medians.items()):
        axes.add_patch(Rectangle((k * pitch, 5.1), 1.6, 1.6, facecolor=STAGE_COLOURS[stage], edgecolor="none"))
        axes.text(k * pitch + 2.4, 6.6, f"{stage} {ms:.1f} ms", size=6, color=SOFT, va="baseline")
