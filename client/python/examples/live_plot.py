#!/usr/bin/python3
"""Draws knee and hip angles while they are measured.

usage: live_plot.py [--server HOST:PORT] [--seconds 10] [--picture FILE.png]

Opens a window and draws the last ten seconds, until it is closed; with --picture it draws nothing until --seconds are
over and then writes the picture, which needs no screen.
"""
import argparse
import collections
import time

import matplotlib

from kinevox import Client, KinevoxError

CURVES = {"knee_flexion_l": ("#0072B2", "-"), "knee_flexion_r": ("#D55E00", "-"),
          "hip_flexion_l": ("#0072B2", ":"), "hip_flexion_r": ("#D55E00", ":")}
SHOWN_S = 10


class Plot:
    """The last seconds of some angles."""

    def __init__(self):
        from matplotlib import pyplot
        self.pyplot = pyplot
        self.figure, self.axes = pyplot.subplots(figsize=(8, 4), constrained_layout=True)
        self.time_s = collections.deque()
        self.values = {name: collections.deque() for name in CURVES}
        self.lines = {name: self.axes.plot([], [], color=colour, linestyle=style, label=name.replace("_", " "))[0]
                      for name, (colour, style) in CURVES.items()}
        self.axes.set(xlabel="time, s", ylabel="angle, deg", ylim=(-30, 150))
        self.axes.grid(color="0.92")
        self.axes.legend(ncols=4, fontsize=8, frameon=False, loc="upper left")

    def add(self, time_s, pose):
        self.time_s.append(time_s)
        for name, values in self.values.items():
            values.append(pose.angles[name])   # NaN, which leaves a gap, where it was withheld
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
    parser.add_argument("--seconds", type=float, default=10, help="with --picture: how long to watch")
    parser.add_argument("--picture", help="PNG to write instead of opening a window")
    options = parser.parse_args()
    if options.picture:
        matplotlib.use("Agg")
    plot = Plot()
    # A window draws slowly: the newest pose is enough for it. A picture takes them all.
    with Client(options.server) as client, client.poses("all" if options.picture else "latest", silence_s=10) as poses:
        begin, first_ns = time.monotonic(), None
        for pose in poses:
            first_ns = pose.time_ns if first_ns is None else first_ns
            plot.add((pose.time_ns - first_ns) * 1e-9, pose)
            if not options.picture:
                plot.draw()
                plot.pyplot.pause(0.001)
                if not plot.is_open():
                    return
            elif time.monotonic() - begin >= options.seconds:
                break
    plot.draw()
    plot.figure.savefig(options.picture, dpi=100)
    print(f"{len(plot.time_s)} poses in {options.picture}")


if __name__ == "__main__":
    try:
        main()
    except KinevoxError as error:
        raise SystemExit(f"live_plot: {error}")
