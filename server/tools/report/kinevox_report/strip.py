"""The image strip: the skeleton drawn over one camera's images."""
import numpy as np
from matplotlib import patheffects
from matplotlib.patches import Rectangle

from .body_table import BONES
from .images import choose_camera, choose_frames
from .sheet import FAINT, INNER_MM, LEFT, MARGIN_MM, MIDDLE, PANEL, RIGHT, SOFT

COUNT, GAP_MM = 7, 2.0
HEIGHT_MM = 46
# Middle, left, right; brighter on images than on paper.
IMAGE_COLOURS, PAPER_COLOURS = ("#ffffff", "#35a7ff", "#ff8a3c"), (MIDDLE, LEFT, RIGHT)


def crop_boxes(pixels, camera, aspect):
    """[(x, y, width, height)] px around each frame's body: one scale for all, inside the image if it fits."""
    boxes = []
    for p in pixels:
        p = p[np.isfinite(p[:, 0])]
        boxes.append((p.min(0), p.max(0)) if len(p) else (np.zeros(2), np.array([camera.width, camera.height], float)))
    height = 1.16 * max(max(high[1] - low[1], (high[0] - low[0]) / aspect) for low, high in boxes)
    height = max(height, 40.0)
    width = height * aspect
    out = []
    for low, high in boxes:
        x, y = (low + high) / 2 - [width / 2, height / 2]
        x = np.clip(x, 0, camera.width - width) if width <= camera.width else (camera.width - width) / 2
        y = np.clip(y, 0, camera.height - height) if height <= camera.height else (camera.height - height) / 2
        out.append((float(x), float(y), float(width), float(height)))
    return out


def draw_skeleton(axes, at, colours, outlined):
    """`at`: joints in the axes' units, by name."""
    outline = [patheffects.Stroke(linewidth=2.5, foreground="#10161d", alpha=0.75), patheffects.Normal()]
    colour_of = dict(zip(("middle", "left", "right"), colours))
    for a, b, side in BONES:
        ends, colour = np.array([at[a], at[b]]), colour_of[side]
        if np.isfinite(ends).all():
            axes.plot(
                *ends.T, color=colour, linewidth=1.3, solid_capstyle="round", path_effects=outline if outlined else None
            )


def frame_axes(sheet, trial, y, k, frame):
    """The k-th image's axes, with its time below."""
    width = (INNER_MM - (COUNT - 1) * GAP_MM) / COUNT
    at = MARGIN_MM + k * (width + GAP_MM)
    axes = sheet.axes(at, y, width, HEIGHT_MM)
    axes.set_facecolor(PANEL)
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_visible(False)
    sheet.text(at, y + HEIGHT_MM + 3.2, f"{trial.time_s[frame]:.2f} s", size=7, weight="bold")
    sheet.text(at + width, y + HEIGHT_MM + 3.2, f"frame {trial.frames[frame]}", size=6, color=FAINT, ha="right")
    return axes


def draw_images(sheet, trial, frames, session, camera, y):
    reader = session.image_reader(camera.name)
    names = list(trial.joints)
    pixels = [camera.project(np.array([trial.joints[n][f] for n in names])) for f in frames]
    aspect = (INNER_MM - (COUNT - 1) * GAP_MM) / COUNT / HEIGHT_MM
    for k, (frame, points, box) in enumerate(zip(frames, pixels, crop_boxes(pixels, camera, aspect))):
        image = reader.read(int(trial.frames[frame]))
        axes = frame_axes(sheet, trial, y, k, frame)
        axes.imshow(image, interpolation="lanczos", aspect="auto")
        draw_skeleton(axes, dict(zip(names, points)), IMAGE_COLOURS, outlined=True)
        axes.set_xlim(box[0], box[0] + box[2])
        axes.set_ylim(box[1] + box[3], box[1])


def draw_figures(sheet, trial, frames, y):
    """Without images: the skeleton from the subject's right, upright."""
    aspect = (INNER_MM - (COUNT - 1) * GAP_MM) / COUNT / HEIGHT_MM
    figures = []
    for frame in frames:
        to_left = trial.joints["hip_l"][frame] - trial.joints["hip_r"][frame]
        forward = np.array([to_left[1], -to_left[0]]) / max(np.hypot(*to_left[:2]), 1e-9)
        if not np.isfinite(forward).all():
            forward = np.array([1.0, 0.0])
        figures.append({n: np.array([p[frame, :2] @ forward, p[frame, 2]]) for n, p in trial.joints.items()})
    corners = [(np.nanmin(list(f.values()), 0), np.nanmax(list(f.values()), 0)) for f in figures]
    tall = 1.16 * max(max(high[1] - low[1], (high[0] - low[0]) / aspect, 0.5) for low, high in corners)
    for k, (frame, points, (low, high)) in enumerate(zip(frames, figures, corners)):
        axes = frame_axes(sheet, trial, y, k, frame)
        draw_skeleton(axes, points, PAPER_COLOURS, outlined=False)
        x, z = (low + high) / 2
        axes.set_xlim(x - tall * aspect / 2, x + tall * aspect / 2)
        axes.set_ylim(z - tall / 2, z + tall / 2)


def draw_strip(sheet, trial, session, y, camera_name=None):
    """Returns the times shown, s, and what the strip shows."""
    frames = choose_frames(trial.joints, COUNT)
    if not frames:
        axes = sheet.drawing(MARGIN_MM, y, INNER_MM, HEIGHT_MM)
        axes.add_patch(Rectangle((0, 0), INNER_MM, HEIGHT_MM, color=PANEL))
        axes.text(INNER_MM / 2, HEIGHT_MM / 2, "every joint is withheld", size=8, color=SOFT, ha="center", va="center")
        return [], ""
    times = [float(trial.time_s[f]) for f in frames]
    if session is None:
        draw_figures(sheet, trial, frames, y)
        return times, "seen from the subject's right; no session, no images (--session)"
    camera = session.cameras[camera_name] if camera_name else choose_camera(session, trial.joints, frames)
    draw_images(sheet, trial, frames, session, camera, y)
    return times, f"camera {camera.name}"
