#!/usr/bin/env python3
"""Draws the results of `kinevox process --save silhouettes,volumes` over the session's images, for inspection.

usage: overlay.py SESSION.toml RESULTS IMAGE.png [--frames 0,30,60] [--height 480] [--crop]

One row per frame; per camera the image with the contours of the sharp silhouette (yellow) and the volume (red), and next
to it the coloured volume."""
import argparse
import sys
from pathlib import Path

import cv2
import numpy as np

from session_data import Session, read_table


def read_points(file):
    """A PLY of coloured points: (n, 3) metres, (n, 3) B G R."""
    data = Path(file).read_bytes()
    end = data.index(b"end_header\n") + len(b"end_header\n")
    count = next(int(line.split()[2]) for line in data[:end].decode().splitlines() if line.startswith("element vertex"))
    kind = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("red", "u1"), ("green", "u1"), ("blue", "u1")])
    points = np.frombuffer(data, kind, count, end)
    return (
        np.stack([points[c] for c in "xyz"], 1).astype(float),
        np.stack([points[c] for c in ("blue", "green", "red")], 1),
    )


def splat(camera, points, colours, voxel_m):
    """The points as squares of a voxel's size, the nearest on top: image and mask."""
    image = np.full((camera.height, camera.width, 3), 255, np.uint8)
    mask = np.zeros((camera.height, camera.width), np.uint8)
    pixels = camera.project(points)
    depth = points @ camera.rotation[2] + camera.translation[2]
    for n in np.argsort(-depth):
        if not np.isfinite(pixels[n]).all():
            continue
        half = 0.5 * camera.matrix[0, 0] * voxel_m / depth[n] + 0.5
        x0, y0 = (pixels[n] - half).round().astype(int).clip(0)
        x1, y1 = (pixels[n] + half).round().astype(int).clip(0) + 1
        image[y0:y1, x0:x1] = colours[n]
        mask[y0:y1, x0:x1] = 255
    return image, mask


def draw_contour(image, mask, colour, thickness):
    contours, _ = cv2.findContours(mask, cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.drawContours(image, contours, -1, colour, thickness)


def cell(camera, image, results, frame, voxel_m, arguments):
    points, colours = np.zeros((0, 3)), np.zeros((0, 3))
    if (results / "volumes" / f"{frame:06d}.ply").exists():
        points, colours = read_points(results / "volumes" / f"{frame:06d}.ply")
    volume, mask = splat(camera, points, colours, voxel_m)
    silhouette = cv2.imread(str(results / "silhouettes" / camera.name / f"{frame:06d}.png"), cv2.IMREAD_GRAYSCALE)
    over = image.copy()
    thickness = max(1, camera.height // 480)
    draw_contour(over, mask, (0, 0, 255), thickness)
    if silhouette is not None:
        draw_contour(over, silhouette, (0, 255, 255), thickness)
    if arguments.crop and mask.any():
        x, y, w, h = cv2.boundingRect(mask)
        pad = h // 6
        window = np.s_[max(0, y - pad) : y + h + pad, max(0, x - pad) : x + w + pad]
        over, volume = over[window], volume[window]
    both = np.hstack([over, volume])
    return cv2.resize(
        both, (round(both.shape[1] * arguments.height / both.shape[0]), arguments.height), interpolation=cv2.INTER_AREA
    )


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("session", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("image", type=Path)
    parser.add_argument("--frames", default="0")
    parser.add_argument("--height", type=int, default=360, help="of an image, px")
    parser.add_argument("--crop", action="store_true", help="only the surroundings of the volume")
    arguments = parser.parse_args()
    session = Session(arguments.session)
    frames = [int(f) for f in arguments.frames.split(",")]
    voxel_m = np.nanmax(read_table(arguments.results / "volume.csv")["voxel_mm"]) / 1e3
    rows = {frame: [] for frame in frames}
    for camera, file in zip(session.cameras, session.videos):
        video, at = cv2.VideoCapture(str(file)), 0
        while at <= max(frames):
            read, image = video.read()
            if not read:
                sys.exit(f"{file} ends before frame {at}")
            if at in rows:
                rows[at].append(cell(camera, image, arguments.results, at, voxel_m, arguments))
            at += 1
    rows = [np.hstack(row) for row in rows.values()]
    width = max(row.shape[1] for row in rows)
    sheet = np.vstack([cv2.copyMakeBorder(row, 0, 4, 0, width - row.shape[1], cv2.BORDER_CONSTANT) for row in rows])
    cv2.imwrite(str(arguments.image), sheet)
    print(f"{arguments.image}: {sheet.shape[1]} x {sheet.shape[0]} px")


if __name__ == "__main__":
    main()
