"""A page that compares two processed trials: differences per angle, and the largest ones over time."""
import numpy as np

from .sheet import FAINT, HEIGHT_MM, INK, INNER_MM, LEFT, MARGIN_MM, RIGHT, RULE, SOFT, Sheet

MAX_BARS, CURVES = 26, 6


def draw_bars(sheet, angles, y, height):
    shown = sorted(angles, key=lambda d: -np.nan_to_num(d.rms, nan=-1))[:MAX_BARS]
    axes = sheet.axes(MARGIN_MM + 40, y, INNER_MM - 44, height)
    rows = np.arange(len(shown))
    axes.barh(rows, [np.nan_to_num(d.rms) for d in shown], color=RIGHT, height=0.62)
    axes.plot([np.nan_to_num(d.max) for d in shown], rows, "|", color=INK, markersize=5)
    axes.set_yticks(rows, [d.name for d in shown])
    axes.set_ylim(len(shown) - 0.4, -0.6)
    axes.set_xlim(left=0)
    axes.xaxis.set_major_formatter(lambda v, _: f"{v:g}°")
    axes.grid(axis="x", color=RULE, linewidth=0.5)
    axes.set_axisbelow(True)
    for side in ("top", "left", "right"):
        axes.spines[side].set_visible(False)


def draw_over_time(sheet, comparison, y, height):
    worst = sorted(comparison.angles, key=lambda d: -np.nan_to_num(d.rms, nan=-1))[:CURVES]
    rows, gap = (CURVES + 1) // 2, 14
    width, pitch = (INNER_MM - gap - 7) / 2, height / rows
    for k, d in enumerate(worst):
        x, top = MARGIN_MM + 7 + (k % 2) * (width + gap), y + (k // 2) * pitch
        sheet.text(x, top + 3.4, d.name, size=8, weight="bold", color=INK)
        axes = sheet.axes(x, top + 6, width, pitch - 13)
        axes.plot(comparison.time_s, d.a, color=LEFT, linewidth=1.2)
        axes.plot(comparison.time_s, d.b, color=RIGHT, linewidth=1.0)
        axes.set_xlim(comparison.time_s[0], max(comparison.time_s[-1], comparison.time_s[0] + 1e-3))
        axes.xaxis.set_major_formatter(lambda v, _: f"{v:g} s")
        axes.yaxis.set_major_formatter(lambda v, _: f"{v:.0f}°".replace("-", "−"))
        axes.grid(axis="y", color=RULE, linewidth=0.5)
        for side in ("top", "left", "right"):
            axes.spines[side].set_visible(False)


def make_comparison_page(comparison):
    sheet = Sheet()
    a, b = ("/".join(f.absolute().parts[-2:]) for f in comparison.folders)
    sheet.text(MARGIN_MM, 19, "Comparison", size=19, weight="bold")
    same = "identical to the last digit" if comparison.same() else f"{len(comparison.frames)} frames in both"
    sheet.text(MARGIN_MM, 24.5, f"A  {a}     B  {b}     {same}", size=7, color=SOFT)
    sheet.text(MARGIN_MM + INNER_MM, 19, "kinevox", size=10, weight="bold", color=FAINT, ha="right")
    sheet.heading(MARGIN_MM, 34, "Geometric angles, B minus A", INNER_MM, "bar: RMS; line: maximum")
    draw_bars(sheet, comparison.angles, 39, 112)
    sheet.heading(MARGIN_MM, 164, "Largest differences", INNER_MM, "blue: A; orange: B; gap: withheld")
    draw_over_time(sheet, comparison, 168, 108)
    sheet.line(MARGIN_MM, HEIGHT_MM - 13, INNER_MM)
    sheet.text(
        MARGIN_MM,
        HEIGHT_MM - 9,
        "Frames at equal times. A value that only one of them has is not compared, " "but counted in the table.",
        size=6,
        color=FAINT,
    )
    return sheet
