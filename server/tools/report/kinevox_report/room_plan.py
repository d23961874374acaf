"""Plan of the room: cameras, their views, the target's positions."""
import numpy as np
from matplotlib.patches import Polygon, Rectangle

from .sheet import FAINT, INK, LEFT, RIGHT, RULE, SOFT

SEEN = ["#ffffff", "#f3e3d3", "#dfe9ef", "#b9d7cb", "#8fc3aa", "#6bb08f"]  # by 0, 1, 2, 3, 4, 5 and more cameras


def levelled(certificate):
    """(3, 3): from the certificate's world to one with z up; identity if the floor is defined."""
    if certificate.world_defined:
        return np.eye(3)
    up = -np.mean([c.rotation[1] for c in certificate.cameras], axis=0)
    up /= np.linalg.norm(up)
    x = np.cross([0, 1, 0] if abs(up[1]) < 0.9 else [1, 0, 0], up)
    x /= np.linalg.norm(x)
    return np.array([x, np.cross(up, x), up])


def seen_by(certificate, rotation, points):
    """Number of cameras that see points (n, 3) of the levelled world."""
    count = np.zeros(len(points), int)
    for camera in certificate.cameras:
        local = (points @ rotation - camera.centre) @ camera.rotation.T
        with np.errstate(divide="ignore", invalid="ignore"):
            pixels = local[:, :2] / local[:, 2:] * camera.focal + camera.principal_point
        count += (local[:, 2] > 0.1) & ((pixels >= 0) & (pixels <= camera.size - 1)).all(1)
    return count


def draw_cameras(axes, certificate, rotation, centres, centre_xy, metre):
    """Cameras with their view cones. centres: (cameras, 3) m; metre: mm of the page."""
    named = {f.get("camera"): f["verdict"] for f in reversed(certificate.findings) if f["verdict"] != "GO"}
    for camera, centre in zip(certificate.cameras, centres):
        w, h = camera.size - 1
        rays = camera.rays([[0, h / 2], [w, h / 2]]) @ rotation.T
        length_m = 0.9
        ends = [centre[:2] + length_m * r[:2] / max(np.linalg.norm(r[:2]), 1e-6) for r in rays]
        colour = {"CAUTION": "#c98a00", "NO-GO": "#c0392b"}.get(named.get(camera.name), LEFT)
        axes.add_patch(Polygon([centre[:2], *ends], closed=True, fc=colour, alpha=0.25, ec=colour, lw=0.6, zorder=4))
        axes.plot(*centre[:2], "o", ms=4.5, color=colour, mec="white", mew=0.6, zorder=5)
        away = centre[:2] - centre_xy
        away = away / max(np.linalg.norm(away), 1e-6) * [7.5 / metre, 5 / metre]  # beyond the dot, further to the side
        height_words = f"{centre[2]:.1f} m up" if certificate.world_defined else ""
        axes.text(
            *(centre[:2] + away), camera.name, size=7.5, weight="bold", color=colour, ha="center", va="center", zorder=6
        )
        if height_words:
            axes.text(
                centre[0] + away[0],
                centre[1] + away[1] - 3.2 / metre,
                height_words,
                size=5.5,
                color=SOFT,
                ha="center",
                va="center",
                zorder=6,
            )


def draw_world_axes(axes):
    """x and y at the origin of the world frame."""
    for end, name, colour in (((0.6, 0), "x", RIGHT), ((0, 0.6), "y", "#1f8a4c")):
        axes.annotate(
            "",
            end,
            (0, 0),
            arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.2, "shrinkA": 0, "shrinkB": 0},
            zorder=7,
        )
        axes.text(
            end[0] * 1.25, end[1] * 1.25, name, size=7, color=colour, ha="center", va="center", weight="bold", zorder=7
        )


def draw_plan(sheet, certificate, x, y, width, height):
    """Returns its lower end."""
    rotation = levelled(certificate)
    centres = np.array([c.centre for c in certificate.cameras]) @ rotation.T
    seen = certificate.target_points @ rotation.T
    points = np.vstack([centres[:, :2], seen[:, :2]])
    if certificate.world_defined:
        points = np.vstack([points, [[0, 0]]])
    low, high = points.min(0), points.max(0)
    centre_xy, span = (low + high) / 2, np.maximum(high - low, 1.0) + 2.2
    metre = min(width / span[0], height / span[1])  # mm of the page
    half = np.array([width, height]) / metre / 2
    axes = sheet.axes(x, y, width, height)
    axes.set_xlim(centre_xy[0] - half[0], centre_xy[0] + half[0])
    axes.set_ylim(centre_xy[1] - half[1], centre_xy[1] + half[1])
    axes.set_xticks([])
    axes.set_yticks([])
    for spine in axes.spines.values():
        spine.set_color(RULE)
    # Number of views at hip height, or at the height of the target.
    level = (
        1.0
        if certificate.world_defined
        else float(np.median(seen[:, 2]))
        if len(seen)
        else float(centres[:, 2].mean() - 1)
    )
    columns, rows = 220, max(2, int(220 * height / width))
    gx, gy = np.meshgrid(np.linspace(*axes.get_xlim(), columns), np.linspace(*axes.get_ylim(), rows))
    grid = np.column_stack([gx.ravel(), gy.ravel(), np.full(gx.size, level)])
    count = np.minimum(seen_by(certificate, rotation, grid), len(SEEN) - 1).reshape(rows, columns)
    image = np.array([[int(c[i : i + 2], 16) for i in (1, 3, 5)] for c in SEEN], np.uint8)[count]
    axes.imshow(
        image,
        extent=[*axes.get_xlim(), *axes.get_ylim()],
        origin="lower",
        aspect="auto",
        interpolation="nearest",
        zorder=0,
    )
    for k in np.arange(np.ceil(axes.get_xlim()[0]), axes.get_xlim()[1]):
        axes.axvline(k, color="white", lw=0.5, alpha=0.7, zorder=1)
    for k in np.arange(np.ceil(axes.get_ylim()[0]), axes.get_ylim()[1]):
        axes.axhline(k, color="white", lw=0.5, alpha=0.7, zorder=1)
    if len(seen):
        axes.plot(seen[:, 0], seen[:, 1], ".", ms=1.2, color=INK, alpha=0.45, zorder=2)
    volume = certificate.volume
    if volume and certificate.world_defined:
        a, b = np.array(volume["lower_m"], float), np.array(volume["upper_m"], float)
        if (b > a).all():
            axes.add_patch(Rectangle(a[:2], *(b - a)[:2], fill=False, ec=INK, lw=0.9, ls=(0, (4, 2)), zorder=3))
    draw_cameras(axes, certificate, rotation, centres, centre_xy, metre)
    if certificate.world_defined:
        draw_world_axes(axes)
    legend(sheet, x, y + height, width, certificate.world_defined, len(seen) > 0)
    return y + height + 4


def legend(sheet, x, y, width, has_floor, has_points):
    area = sheet.drawing(x, y, width, 4)
    at = 0
    for count, name in ((1, "1 camera"), (2, "2"), (3, "3"), (4, "4"), (5, "5 or more")):
        area.add_patch(Rectangle((at, 1.2), 3, 2.2, fc=SEEN[count], ec=RULE, lw=0.4))
        area.text(at + 3.8, 3.1, name, size=6, color=SOFT, va="baseline")
        at += 8 + 1.15 * len(name)
    area.text(
        at,
        3.1,
        ("see a point there, 1 m above the floor" if has_floor else "see a point there"),
        size=6,
        color=SOFT,
        va="baseline",
    )
    area.text(
        width,
        3.1,
        ("dots: target;  " if has_points else "") + ("dashed: working volume;  " if has_floor else "") + "grid 1 m",
        size=6,
        color=FAINT,
        va="baseline",
        ha="right",
    )
