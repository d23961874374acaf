"""The layout of the page."""
from pathlib import Path

from .curves import draw_curves
from .images import Session
from .sheet import FAINT, HEIGHT_MM, INK, INNER_MM, MARGIN_MM, SOFT, Sheet
from .strip import draw_strip
from .tables import draw_ranges, draw_segments, draw_stage_times, draw_tiles

VERDICT_COLOURS = {"GOOD": SOFT, "CAUTION": "#a05a00", "DO NOT USE": "#b3261e"}


def open_session(trial, session_file):
    """None if no session is known, or the one that `process` used does not exist any more."""
    known = session_file or trial.session_file or trial.run.get("session")
    if not session_file and not (known and Path(known).is_file()):
        return None
    return Session(known, trial.folder, trial.run.get("first_image_index"))


def shortened(words, length):
    return words if len(words) <= length else words[: length // 2] + " … " + words[-length // 2 :]


def title_of(trial, session):
    name = session.name if session else trial.name
    return f"{name}  ·  {trial.subject_name}" if trial.subject_name else name


def subtitle_of(trial, session):
    words = []
    if session:
        words.append(f"{len(session.cameras)} cameras")
    if "voxel_mm" in trial.run:
        words.append(f"voxels of {trial.run['voxel_mm']:g} mm")
    cutoff = trial.run.get("filter_cutoff_hz")
    if cutoff is not None:
        words.append(f"low-pass {cutoff:g} Hz, zero phase" if cutoff > 0 else "not filtered")
    words.append("/".join(trial.folder.absolute().parts[-2:]))
    return "  ·  ".join(words)


def draw_quality(sheet, trial, right):
    """The verdict at the top, reason and remedy at the bottom."""
    if not trial.quality:
        return
    verdict, cause = trial.quality["verdict"], trial.quality["cause"]
    colour = VERDICT_COLOURS.get(verdict, INK)
    words = f"quality: {verdict}" + (f" ({cause['cause']})" if cause else "")
    sheet.text(right, 24.5, words, size=7, weight="bold", color=colour, ha="right")
    if cause:
        footer = shortened(f"{cause['reason']}. Remedy: {cause['remedy']}", 160)
        sheet.text(MARGIN_MM, HEIGHT_MM - 6, footer, size=6, color=colour)


def make_page(trial, session, camera=None):
    sheet = Sheet()
    right = MARGIN_MM + INNER_MM
    sheet.text(MARGIN_MM, 19, shortened(title_of(trial, session), 44), size=19, weight="bold")
    sheet.text(MARGIN_MM, 24.5, shortened(subtitle_of(trial, session), 105), size=7, color=SOFT)
    sheet.text(right, 19, "kinevox", size=10, weight="bold", color=FAINT, ha="right")
    draw_quality(sheet, trial, right)
    draw_tiles(sheet, trial, 28)

    strip_y = 52
    shown, what = draw_strip(sheet, trial, session, strip_y, camera)
    sheet.heading(MARGIN_MM, strip_y - 4, "Movement", INNER_MM, what)

    curves_y = 113
    signs = ["band: ± 1 standard deviation"] if trial.std else []
    signs += ["gap: withheld"] + (["▲ image above"] if shown else [])
    sheet.heading(MARGIN_MM, curves_y - 4, "Joint angles (geometric)", INNER_MM)
    sheet.text(right - 33, curves_y - 4, ";  ".join(signs), size=6.5, color=SOFT, ha="right")
    sheet.side_legend(right, curves_y - 4)
    draw_curves(sheet, trial, curves_y, 108, shown)

    tables_y = 229
    ranges_width = 124
    bottom = draw_ranges(sheet, trial, MARGIN_MM, tables_y, ranges_width)
    draw_segments(sheet, trial, MARGIN_MM + ranges_width + 8, tables_y, INNER_MM - ranges_width - 8)
    draw_stage_times(sheet, trial, MARGIN_MM, bottom + 4, INNER_MM)
    sheet.text(
        MARGIN_MM,
        HEIGHT_MM - 9,
        "Left and right are the subject's. Ratios: left over right, of ranges and lengths; "
        "none for ranges below 5°.",
        size=6,
        color=FAINT,
    )
    sheet.line(MARGIN_MM, HEIGHT_MM - 13, INNER_MM)
    return sheet
