#!/usr/bin/python3
"""Analyses a sprint start: ground contacts of hands and feet, the first steps, and knees and hips left against right.

usage: sprint_start.py SESSION [--server HOST:PORT] [--subject ID] [--out sprint_start]
       sprint_start.py RESULTS [--subject ID] [--out sprint_start]

SESSION is a recording's name or the absolute path of a session.toml on the server; the daemon replays every frame.
RESULTS is a folder written by `kinevox process`, or a recording's poses/ folder, and needs no daemon. Writes all poses
to OUT.csv and the plot to OUT.png, and prints the table.
"""
import argparse
from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np

from kinevox import Client, InvalidArgument, KinevoxError, PoseTable

matplotlib.use("Agg")
from matplotlib import pyplot  # noqa: E402

# Contact of a foot: its toe is this low and this slow; of a hand: its finger tips are this low. The tips of a hand that
# rests on its fingers are measured some centimetres too high.
TOE_HEIGHT_M, TOE_SPEED_M_PER_S, HAND_HEIGHT_M = 0.08, 2.0, 0.10
MIN_CONTACT_S = 0.05
SIDES = {"left": "l", "right": "r"}
COLOURS = {"left": "#0072B2", "right": "#D55E00"}


@dataclass
class Contact:
    """A hand or foot on the ground. at_m: its median position, (3,), world. down_s, up_s: None if the recording starts or
    ends during the contact."""

    side: str
    down_s: float | None
    up_s: float | None
    at_m: np.ndarray


@dataclass
class Step:
    """From the other foot's contact to this one's. length_m: along the run; time_s: from touch-down to touch-down, the
    first one from the lift-off of the second hand. complete: no pose is missing since the previous contact;
    otherwise a step may be missing in between."""

    side: str
    touch_down_s: float
    length_m: float
    time_s: float
    contact_s: float | None
    complete: bool


def crossing(time_s, signal, limit, k):
    """Time at which the signal crosses the limit between rows k - 1 and k, s."""
    before, after = signal[k - 1], signal[k]
    fraction = (limit - before) / (after - before) if np.isfinite(after - before) and after != before else 1.0
    return float(time_s[k - 1] + np.clip(fraction, 0, 1) * (time_s[k] - time_s[k - 1]))


def contacts(side, time_s, at_m, excess):
    """The contacts where excess, (n,), is below 0: [Contact]. Rows without a value belong to none."""
    down = np.nan_to_num(excess, nan=1.0) < 0
    edges = np.flatnonzero(np.diff(down.astype(int), prepend=0, append=0))
    out = []
    for begin, end in zip(edges[::2], edges[1::2]):
        if time_s[end - 1] - time_s[begin] < MIN_CONTACT_S and begin > 0 and end < len(time_s):
            continue
        out.append(
            Contact(
                side,
                crossing(time_s, excess, 0, begin) if begin > 0 else None,
                crossing(time_s, excess, 0, end) if end < len(time_s) else None,
                np.median(at_m[begin:end], axis=0),
            )
        )
    return out


def horizontal_speed(time_s, at_m):
    """(n,) m/s."""
    return np.linalg.norm(np.gradient(at_m[:, :2], time_s, axis=0), axis=1)


def foot_contacts(table, side, floor_m):
    toe = table.joint(f"toe_{SIDES[side]}")
    high = (toe[:, 2] - floor_m - TOE_HEIGHT_M) / TOE_HEIGHT_M
    fast = (horizontal_speed(table.time_s, toe) - TOE_SPEED_M_PER_S) / TOE_SPEED_M_PER_S
    return contacts(side, table.time_s, toe, np.maximum(high, fast))


def hand_contacts(table, side, floor_m):
    hand = table.joint(f"hand_{SIDES[side]}")
    return contacts(side, table.time_s, hand, (hand[:, 2] - floor_m - HAND_HEIGHT_M) / HAND_HEIGHT_M)


@dataclass
class Start:
    """The analysis; times from the start of the recording, s."""

    hands: list[Contact]
    feet: list[Contact]
    steps: list[Step]
    direction: np.ndarray  # of the run, (2,), horizontal, world
    go_s: float | None  # lift-off of the second hand


def analyse(table):
    """The start in a PoseTable."""
    toes = np.concatenate([table.joint("toe_l")[:, 2], table.joint("toe_r")[:, 2]])
    floor_m = np.nanpercentile(toes, 10)  # the height of standing toes
    hands = sorted((c for side in SIDES for c in hand_contacts(table, side, floor_m)), key=lambda c: c.down_s or 0)
    feet = sorted((c for side in SIDES for c in foot_contacts(table, side, floor_m)), key=lambda c: c.down_s or 0)
    root = table.joint("root")[np.isfinite(table.joint("root")[:, 0]), :2]
    direction = (root[-1] - root[0]) / max(np.linalg.norm(root[-1] - root[0]), 1e-9)
    lifted = [contact.up_s for contact in hands if contact.up_s is not None]
    go_s = max(lifted) if lifted else None
    missing_s = table.time_s[np.isnan(table.joint("toe_l") + table.joint("toe_r")).any(axis=1)]
    steps, before, since = [], [c for c in feet if c.down_s is None], go_s
    # The first step starts at the front foot.
    last = max(before, key=lambda c: c.at_m[:2] @ direction) if before else None
    for contact in (c for c in feet if c.down_s is not None):
        if last is not None and since is not None:
            steps.append(
                Step(
                    contact.side,
                    contact.down_s,
                    float((contact.at_m - last.at_m)[:2] @ direction),
                    contact.down_s - since,
                    None if contact.up_s is None else contact.up_s - contact.down_s,
                    not ((missing_s > since) & (missing_s < contact.down_s)).any(),
                )
            )
        last, since = contact, contact.down_s
    return Start(hands, feet, steps, direction, go_s)


def mean(values):
    values = [value for value in values if value is not None and np.isfinite(value)]
    return float(np.mean(values)) if values else float("nan")


def sides(table, start):
    """{quantity: (left, right)}: degrees, m, s. Angles from the first touch-down on, without the starting position."""
    after = table.time_s >= (start.steps[0].touch_down_s if start.steps else 0)
    out = {}
    for quantity, angle in (
        ("max knee flexion, deg", "knee_flexion_geometric"),
        ("max hip flexion, deg", "hip_flexion_geometric"),
    ):
        out[quantity] = tuple(float(np.nanmax(table.angle(f"{angle}_{end}")[after])) for end in SIDES.values())
    for what, field in (("step length, m", "length_m"), ("step time, s", "time_s"), ("contact time, s", "contact_s")):
        out[what] = tuple(
            mean(getattr(step, field) for step in start.steps if step.side == side and step.complete) for side in SIDES
        )
    return out


def report(table, start):
    lines = [
        f"{contact.side} hand leaves the ground at {contact.up_s:.2f} s" for contact in start.hands if contact.up_s
    ]
    lines.append("step  foot   touch-down, s  length, m  time, s  contact time, s")
    for number, step in enumerate(start.steps, 1):
        stay = f"{step.contact_s:.2f}" if step.contact_s is not None else "-"
        lines.append(
            f"{number:<5} {step.side:<6} {step.touch_down_s:>13.2f} {step.length_m:>10.2f} "
            f"{step.time_s:>8.2f} {stay:>16}" + ("" if step.complete else "   poses missing before it")
        )
    lines.append(f"{'':<28}   left  right  left / right")
    for what, (left, right) in sides(table, start).items():
        lines.append(f"{what:<28} {left:>6.2f} {right:>6.2f} {left / right:>10.2f}")
    return "\n".join(lines)


def draw(table, start, file):
    figure, rows = pyplot.subplots(
        4, 1, sharex=True, figsize=(8.5, 9), height_ratios=[1.2, 1, 1, 0.8], constrained_layout=True
    )
    for side, end in SIDES.items():
        style = {"color": COLOURS[side], "linewidth": 1.4}
        rows[0].plot(table.time_s, table.joint(f"toe_{end}")[:, 2], label=f"{side} toe", **style)
        rows[0].plot(table.time_s, table.joint(f"hand_{end}")[:, 2], label=f"{side} hand", linestyle=":", **style)
        rows[1].plot(table.time_s, table.angle(f"knee_flexion_geometric_{end}"), label=side, **style)
        rows[2].plot(table.time_s, table.angle(f"hip_flexion_geometric_{end}"), label=side, **style)
    rows[3].plot(table.time_s, table.angle("trunk_lean_geometric"), color="0.3", linewidth=1.4)
    for row, label in zip(rows, ("height, m", "knee flexion, deg", "hip flexion, deg", "trunk lean, deg")):
        row.set_ylabel(label)
        row.grid(color="0.92")
        row.spines[["top", "right"]].set_visible(False)
        if start.go_s is not None:
            row.axvline(start.go_s, color="0.2", linewidth=1, linestyle="--")
        for contact in start.feet:
            begin = table.time_s[0] if contact.down_s is None else contact.down_s
            row.axvspan(
                begin,
                table.time_s[-1] if contact.up_s is None else contact.up_s,
                color=COLOURS[contact.side],
                alpha=0.12,
                linewidth=0,
            )
    for number, step in enumerate(start.steps, 1):
        rows[0].annotate(
            f"step {number}\n{step.length_m:.2f} m",
            (step.touch_down_s, 0),
            xytext=(2, -4),
            fontsize=8,
            va="top",
            textcoords="offset points",
            color=COLOURS[step.side],
        )
    rows[0].set_ylim(bottom=min(-0.25, rows[0].get_ylim()[0]))
    rows[0].legend(ncols=4, fontsize=8, frameon=False, loc="upper left", bbox_to_anchor=(0, 1.16))
    rows[-1].set_xlabel("time, s; shaded: a foot on the ground, dashed: lift-off of the second hand")
    figure.savefig(file, dpi=100)
    pyplot.close(figure)


def load(source, server):
    if (Path(source) / "joints.csv").exists():
        return PoseTable.read(source)
    with Client(server) as client:
        return PoseTable.of(client.measure_session(source))


def runner(table, subject_id):
    """The rows of one subject; of the whole table if there is one at a time."""
    if subject_id == 0 and not table.has_several:
        return table
    if subject_id not in table.subject_ids:
        ids = ", ".join(map(str, table.subject_ids)) or "none"
        what = f"subject {subject_id} is not in it" if subject_id else "several subjects are tracked"
        raise InvalidArgument(f"{what}; choose one with --subject: {ids}")
    return table.of_subject(subject_id, every_frame=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("source", type=Path, help="recording, session.toml on the server, or folder of results")
    parser.add_argument("--server", default="", help="HOST:PORT of the daemon")
    parser.add_argument("--subject", type=int, default=0, help="id of the runner; needed where several are tracked")
    parser.add_argument("--out", default="sprint_start")
    options = parser.parse_args()
    table = runner(load(options.source, options.server), options.subject)
    start = analyse(table)
    table.write_csv(f"{options.out}.csv")
    draw(table, start, f"{options.out}.png")
    print(report(table, start))


if __name__ == "__main__":
    try:
        main()
    except KinevoxError as error:
        raise SystemExit(f"sprint_start: {error}")
