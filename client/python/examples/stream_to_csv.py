#!/usr/bin/python3
"""Writes poses to a CSV file as they are measured.

usage: stream_to_csv.py [--server HOST:PORT] [--seconds 10] [--out poses.csv]

A row a frame set: time, the knees and hips in degrees, the toes in metres (world frame, z up). An empty cell is a value
that the cameras did not determine.
"""
import argparse
import csv
import math
import time

from kinevox import Client, KinevoxError

ANGLES = ["knee_angle_l", "knee_angle_r", "hip_flexion_l", "hip_flexion_r", "trunk_lean"]
JOINTS = ["toe_l", "toe_r"]


def cell(value):
    return "" if math.isnan(value) else f"{value:.5f}"


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--server", default="", help="HOST:PORT of the daemon")
    parser.add_argument("--seconds", type=float, default=10)
    parser.add_argument("--out", default="poses.csv")
    options = parser.parse_args()
    rows = 0
    with (Client(options.server) as client, client.poses(silence_s=10) as poses,
          open(options.out, "w", newline="") as file):
        table = csv.writer(file)
        table.writerow(["sequence", "time_s"] + [f"{name}_deg" for name in ANGLES] +
                       [f"{name}_{axis}_m" for name in JOINTS for axis in "xyz"])
        begin, first_ns = time.monotonic(), None
        for pose in poses:
            first_ns = pose.time_ns if first_ns is None else first_ns
            table.writerow([pose.sequence, f"{(pose.time_ns - first_ns) * 1e-9:.4f}"] +
                           [cell(pose.angles[name]) for name in ANGLES] +
                           [cell(value) for name in JOINTS for value in pose.joints[name]])
            rows += 1
            if time.monotonic() - begin >= options.seconds:
                break
    print(f"{rows} rows in {options.out}")


if __name__ == "__main__":
    try:
        main()
    except KinevoxError as error:
        raise SystemExit(f"stream_to_csv: {error}")
