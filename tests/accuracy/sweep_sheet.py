"""Contact sheets of sweep.py: images with the true mask's outline (green), the found silhouette's (yellow), the true
skeleton (green) and the found one (left red, right blue, middle magenta)."""
import cv2
import numpy as np

from session_data import BONES, Session
from sweep_judge import JOINTS, found_mask, poses, true_mask

TILE = (300, 380)  # width, height, px
MAX_CAMERAS = 4


def draw_outline(image, mask, colour):
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(image, contours, -1, colour, 1)


def draw_skeleton(image, pixels, colours, thickness):
    for a, b, _ in BONES:
        p, q = pixels[JOINTS.index(a)], pixels[JOINTS.index(b)]
        if np.isfinite(p).all() and np.isfinite(q).all() and np.abs([p, q]).max() < 1e4:
            colour = colours["l"] if b.endswith("_l") else colours["r"] if b.endswith("_r") else colours["m"]
            cv2.line(image, tuple(int(v) for v in p), tuple(int(v) for v in q), colour, thickness, cv2.LINE_AA)


def window(mask, camera):
    """The surroundings of the true silhouette in the tile's proportions."""
    x, y, w, h = cv2.boundingRect(mask.astype(np.uint8)) if mask.any() else (0, 0, camera.width, camera.height)
    high = max(1.35 * h, 1.35 * w * TILE[1] / TILE[0], 60)
    wide = high * TILE[0] / TILE[1]
    x0, y0 = x + w / 2 - wide / 2, y + h / 2 - high / 2
    return np.float32([[x0, y0], [x0 + wide, y0], [x0, y0 + high]])


def tile(session, results, camera, image, frame, exact, found):
    truth = true_mask(session, camera, frame)
    scale = cv2.getAffineTransform(window(truth, camera), np.float32([[0, 0], [TILE[0], 0], [0, TILE[1]]]))
    warp = lambda m, how, border: cv2.warpAffine(m, scale, TILE, flags=how, borderValue=border)
    plain = warp(image, cv2.INTER_LINEAR, (40, 40, 40))
    drawn = plain.copy()
    for mask, colour in ((truth, (0, 200, 0)), (found_mask(session, results, camera, frame), (0, 255, 255))):
        draw_outline(drawn, warp(mask.astype(np.uint8), cv2.INTER_NEAREST, 0), colour)
    place = lambda joints: camera.project(np.nan_to_num(joints)) @ scale[:, :2].T + scale[:, 2]
    true_pixels, pixels = place(exact[frame]), place(found[frame])
    pixels[~np.isfinite(found[frame]).all(1)] = np.nan
    green = (0, 200, 0)
    draw_skeleton(drawn, true_pixels, {"l": green, "r": green, "m": green}, 1)
    draw_skeleton(drawn, pixels, {"l": (0, 0, 255), "r": (255, 80, 0), "m": (255, 0, 255)}, 2)
    return np.hstack([plain, drawn])


def draw_sheet(session_file, results, metrics, title, file):
    """Rows: the worst frame and two more; columns: up to four cameras, the worst silhouettes first."""
    session = Session(session_file)
    exact, found, _ = poses(session, results)
    frames = sorted({metrics["worst_frame"], len(exact) // 5, (4 * len(exact)) // 5})
    order = sorted(session.cameras, key=lambda c: metrics["cameras_iou"].get(c.name, 2))[:MAX_CAMERAS]
    rows = {frame: [] for frame in frames}
    for camera in order:
        video = cv2.VideoCapture(str(session.videos[session.cameras.index(camera)]))
        for frame in range(max(frames) + 1):
            read, image = video.read()
            if not read:
                raise SystemExit(f"{session_file}: the video of {camera.name} ends before frame {frame}")
            if frame not in rows:
                continue
            part = tile(session, results, camera, image, frame, exact, found)
            label = f"{camera.name} IoU {metrics['cameras_iou'].get(camera.name, float('nan')):.2f} frame {frame}"
            cv2.putText(part, label, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (255, 255, 255), 1, cv2.LINE_AA)
            rows[frame].append(part)
    sheet = np.vstack([np.hstack(row) for row in rows.values()])
    head = np.full((34, sheet.shape[1], 3), 30, np.uint8)
    cv2.putText(head, title, (8, 22), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (255, 255, 255), 1, cv2.LINE_AA)
    cv2.imwrite(str(file), np.vstack([head, sheet]))
