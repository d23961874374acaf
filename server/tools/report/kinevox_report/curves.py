"""Geometric angles over time, left and right in one panel, with their uncertainty."""
import numpy as np
from matplotlib.ticker import MaxNLocator

from .body_table import GEOMETRIC_ANGLE_NAMES
from .sheet import FAINT, INNER_MM, INK, LEFT, MARGIN_MM, MIDDLE, RIGHT, RULE, SOFT
from .trial import label_of

COLUMNS, GUTTER_MM, TITLE_MM, AXIS_MM = 2, 14, 6, 4
PANELS = (
    ("hip_flexion_geometric", "extended − / flexed +"),
    ("knee_flexion_geometric", "0 straight"),
    ("hip_abduction_geometric", "towards − / away from the midline +"),
    ("elbow_flexion_geometric", "0 straight"),
    ("shoulder_elevation_geometric", "0 arm hanging"),
    ("trunk_lean_geometric", "0 upright"),
)


def series_of(angle):
    return [(angle, MIDDLE)] if angle in GEOMETRIC_ANGLE_NAMES else [(f"{angle}_l", LEFT), (f"{angle}_r", RIGHT)]


def draw_panel(axes, trial, angle, shown_times):
    time = trial.time_s
    for name, colour in series_of(angle):
        values, std = trial.angles[name], trial.std.get(name)
        if std is not None:
            axes.fill_between(
                time, values - std, values + std, where=np.isfinite(values), color=colour, alpha=0.16, linewidth=0
            )
        axes.plot(time, values, color=colour, linewidth=1.2, solid_joinstyle="round")
        alone = np.isfinite(values) & ~np.isfinite(np.roll(values, 1)) & ~np.isfinite(np.roll(values, -1))
        axes.plot(time[alone], values[alone], ".", color=colour, markersize=1.5)
    measured = any(np.isfinite(trial.angles[n]).any() for n, _ in series_of(angle))
    if not measured:
        axes.text(
            0.5, 0.5, "withheld in every frame", transform=axes.transAxes, ha="center", va="center", size=7, color=SOFT
        )
        axes.set_yticks([])
    else:
        axes.yaxis.set_major_locator(MaxNLocator(4, steps=[1, 2, 3, 5, 10], min_n_ticks=3))
        low, high = axes.get_ylim()
        centre = (low + high) / 2
        axes.set_ylim(min(low, centre - 8), max(high, centre + 8))  # noise of a still joint must not fill the panel
        if axes.get_ylim()[0] < 0 < axes.get_ylim()[1]:
            axes.axhline(0, color=FAINT, linewidth=0.6, zorder=0.5)
    for shown in shown_times:
        axes.plot(
            [shown],
            [0],
            marker=(3, 0, 0),
            markersize=3,
            color=FAINT,
            clip_on=False,
            transform=axes.get_xaxis_transform(),
            zorder=5,
        )
    axes.grid(axis="y", color=RULE, linewidth=0.5)
    axes.set_axisbelow(True)
    for side in ("top", "left", "right"):
        axes.spines[side].set_visible(False)
    axes.set_xlim(time[0], time[-1] if time[-1] > time[0] else time[0] + 1)
    axes.xaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_formatter(lambda v, _: f"{v:.0f}°".replace("-", "−"))


def draw_curves(sheet, trial, y, height, shown_times):
    rows = (len(PANELS) + COLUMNS - 1) // COLUMNS
    width = (INNER_MM - (COLUMNS - 1) * GUTTER_MM - 7) / COLUMNS  # 7 mm for the tick labels of the first column
    pitch = height / rows
    for k, (angle, meaning) in enumerate(PANELS):
        x = MARGIN_MM + 7 + (k % COLUMNS) * (width + GUTTER_MM)
        top = y + (k // COLUMNS) * pitch
        sheet.text(x, top + 3.4, label_of(angle), size=8, weight="bold", color=INK)
        sheet.text(x + width, top + 3.4, meaning, size=6.5, color=FAINT, ha="right")
        axes = sheet.axes(x, top + TITLE_MM, width, pitch - TITLE_MM - AXIS_MM - 2)
        draw_panel(axes, trial, angle, shown_times)
        if k // COLUMNS < rows - 1:
            axes.set_xticklabels([])
        else:
            axes.set_xticks(axes.get_xticks(), [f"{t:g} s" for t in axes.get_xticks()])
            axes.set_xlim(trial.time_s[0], max(trial.time_s[-1], trial.time_s[0] + 1e-3))
