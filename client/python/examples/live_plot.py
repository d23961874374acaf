#!/usr/bin/python3
"""Plots knee and hip angles live.

usage: live_plot.py [--server HOST:PORT] [--subject ID] [--duration 10] [--screenshot FILE.png]

Shows the last ten seconds in a window until it is closed. With --screenshot it collects poses for --duration seconds
and writes a PNG file, which needs no display.
"""
import argparse
import collections
import time

import matplotlib

from kinevox import Client, KinevoxError

CURVES = {
    "knee_flexion_geometric_l": ("#0072B2", "-"),
    "knee_flexion_geometric_r": ("#D55E00", "-"),
    "hip_flexion_geometric_l": ("#0072B2", ":"),
    "hip_flexion_geometric_r": ("#D55E00", ":"),
}
SHOWN_S = 10


def label(name):
    return name.replace("_geometric", "").replace("_", " ")


class Plot:
    """The last seconds of the angles."""

    def __init__(self):
        from matplotlib import pyplot

        self.pyplot = pyplot
        self.figure, self.axes = pyplot.subplots(figsize=(8, 4), constrained_layout=True)
        self.time_s = collections.deque()
        self.values = {name: collections.deque() for name in CURVES}
        self.lines = {
            name: self.axes.plot([], [], color=colour, linestyle=style, label=label(name))[0]
            for name, (colour, style) in CURVES.items()
        }
        self.axes.set(xlabel="time, s", ylabel="angle, deg", ylim=(-30, 150))
        self.axes.grid(color="0.92")
        self.axes.legend(ncols=4, fontsize=8, frameon=False, loc="upper left")

    def add(self, time_s, pose):
        self.time_s.append(time_s)
        for name, values in self.values.items():
            values.append(pose.angles[name])  # NaN, drawn as a gap, where withheld
        while self.time_s[-1] - self.time_s[0] > SHOWN_S:
            for column in (self.time_s, *self.values.values()):
                column.popleft()

    def draw(self):
        for name, line in self.lines.items():
            line.set_data(self.time_s, self.values[name])
        if self.time_s:
            self.axes.set_xlim(self.time_s[0], self.time_s[0] + max(self.time_s[-1] - self.time_s[0], 1))

    def is_open(self):
        return self.pyplot.fignum_exists(self.figure.number)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--server", default="", help="HOST:PORT of the daemon")
    parser.add_argument("--subject", type=int, default=0, help="id of the subject (default: the lowest one tracked)")
    parser.add_argument("--duration", type=float, default=10, help="with --screenshot: collection time (s)")
    parser.add_argument("--screenshot", help="PNG file to write instead of opening a window")
    options = parser.parse_args()
    if options.screenshot:
        matplotlib.use("Agg")
    plot = Plot()
    # A window draws slowly and needs only the latest pose.
    delivery = "lossless" if options.screenshot else "latest"
    with Client(options.server) as client, client.poses(delivery, idle_timeout_s=10) as poses:
        begin, first_ns = time.monotonic(), None
        for frame in poses:
            first_ns = frame.capture_time_ns if first_ns is None else first_ns
            subject_id = options.subject or min((pose.subject_id for pose in frame.subjects), default=0)
            plot.add((frame.capture_time_ns - first_ns) * 1e-9, frame.subject(subject_id))
            if not options.screenshot:
                plot.draw()
                plot.pyplot.pause(0.001)
                if not plot.is_open():
                    return
            elif time.monotonic() - begin >= options.duration:
                break
    plot.draw()
    plot.figure.savefig(options.screenshot, dpi=100)
    print(f"{len(plot.time_s)} poses in {options.screenshot}")


if __name__ == "__main__":
    try:
        main()
    except KinevoxError as error:
        raise SystemExit(f"live_plot: {error}")
