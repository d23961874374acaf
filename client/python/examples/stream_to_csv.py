#!/usr/bin/python3
"""Streams poses to a CSV file.

usage: stream_to_csv.py [--server HOST:PORT] [--duration 10] [--out poses.csv]

One row per frame set and subject: time, subject, knee and hip coordinates and trunk lean in degrees, toes in metres (world frame, z up).
Withheld values are empty cells.
"""
import argparse
import csv
import math
import time

from kinevox import Client, KinevoxError

COORDINATES = ["knee_angle_l", "knee_angle_r", "hip_flexion_l", "hip_flexion_r"]
ANGLES = ["trunk_lean_geometric"]
JOINTS = ["toe_l", "toe_r"]


def cell(value):
    return "" if math.isnan(value) else f"{value:.5f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--server", default="", help="HOST:PORT of the daemon")
    parser.add_argument("--duration", type=float, default=10, help="streaming time (s)")
    parser.add_argument("--out", default="poses.csv")
    options = parser.parse_args()
    rows = 0
    with (
        Client(options.server) as client,
        client.poses(idle_timeout_s=10) as poses,
        open(options.out, "w", newline="") as file,
    ):
        table = csv.writer(file)
        table.writerow(
            ["sequence", "time_s", "subject"]
            + [f"{name}_deg" for name in COORDINATES + ANGLES]
            + [f"{name}_{axis}_m" for name in JOINTS for axis in "xyz"]
        )
        begin, first_ns = time.monotonic(), None
        for frame in poses:
            first_ns = frame.capture_time_ns if first_ns is None else first_ns
            for pose in frame.subjects or (frame.only,):  # without a subject, a row without values
                table.writerow(
                    [frame.sequence, f"{(frame.capture_time_ns - first_ns) * 1e-9:.4f}", pose.subject_id or ""]
                    + [cell(pose.coordinates[name]) for name in COORDINATES]
                    + [cell(pose.angles[name]) for name in ANGLES]
                    + [cell(value) for name in JOINTS for value in pose.joints[name]]
                )
                rows += 1
            if time.monotonic() - begin >= options.duration:
                break
    print(f"{rows} rows in {options.out}")


if __name__ == "__main__":
    try:
        main()
    except KinevoxError as error:
        raise SystemExit(f"stream_to_csv: {error}")
