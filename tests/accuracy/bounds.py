"""Bounds of the accuracy tests: every measured value may be 15 % worse than the one in bounds.toml, not more.

A requirement that is known to be missed is listed in bounds.toml as an expected miss, with its value and the reason; the
test fails if it is missed without being listed, or listed and met."""
import math
import tomllib
from pathlib import Path

FILE = Path(__file__).with_name("bounds.toml")
TOLERANCE = 0.15
HIGHER_IS_BETTER = ("_iou", "_coverage", "_fraction")  # of these the error is 1 - value
MIN_SLACK, MIN_PERCENT_SLACK = 0.005, 0.1  # for values next to perfect, of another machine
COUNTS = ("swaps",)  # may not grow at all


def higher_is_better(metric):
    return metric.endswith(HIGHER_IS_BETTER)


def bound_of(metric, measured):
    """The worst value that passes where `measured` was measured."""
    if metric.endswith(COUNTS):
        return measured
    if higher_is_better(metric):
        return 1 - max((1 + TOLERANCE) * (1 - measured), 1 - measured + MIN_SLACK)
    slack = MIN_PERCENT_SLACK if metric.endswith("_percent") else MIN_SLACK
    return max((1 + TOLERANCE) * measured, measured + slack)


class Judgement:
    """Collects the values of a run and compares them with bounds.toml."""

    def __init__(self, file=FILE):
        self.file = Path(file)
        self.table = tomllib.loads(self.file.read_text(encoding="utf-8")) if self.file.exists() else {}
        self.misses = {(m["sequence"], m["metric"]): m for m in self.table.pop("expected_miss", [])}
        self.values, self.problems = {}, []

    def measure(self, sequence, metrics, suite):
        """`metrics` {name: value} of one suite ("pose") against the table."""
        for metric, value in metrics.items():
            value = float(value)
            self.values.setdefault(sequence, {}).setdefault(suite, {})[metric] = value
            measured = self.table.get(sequence, {}).get(suite, {}).get(metric)
            if measured is None:
                self.problems.append(f"{sequence}: {suite}.{metric} is {value:.4g} and has no bound; run with --update")
                continue
            bound = bound_of(metric, measured)
            good = value >= bound - 1e-9 if higher_is_better(metric) else value <= bound + 1e-9
            if not good or math.isnan(value):
                self.problems.append(
                    f"{sequence}: {suite}.{metric} is {value:.4g}, bound {bound:.4g} (measured {measured:.4g})"
                )

    def require(self, sequence, metric, value, limit):
        """A requirement: at least `limit` where higher is better, else at most. `metric`: "volume.coloured_iou"."""
        met = value >= limit if higher_is_better(metric) else value <= limit
        miss = self.misses.get((sequence, metric))
        text = f"{sequence}: {metric} is {value:.4g}, required {limit:.4g}"
        if not met and miss is None:
            self.problems.append(text)
        elif not met:
            print(f"expected miss: {text}: {miss['reason']}")
        elif miss is not None:
            self.problems.append(f"{text}: met, remove the expected miss from {self.file.name}")

    def finish(self):
        """Prints the problems; the exit status."""
        for problem in self.problems:
            print("FAILED", problem)
        return 1 if self.problems else 0

    def update(self):
        """Writes the values of this run into the table, keeping those of other sequences and the expected misses."""
        for sequence, suites in self.values.items():
            self.table.setdefault(sequence, {}).update(suites)
        text = self.file.read_text(encoding="utf-8") if self.file.exists() else ""
        lines = [line for line in text.splitlines() if line.startswith("#")] + [""]
        for miss in self.misses.values():
            lines += [
                "[[expected_miss]]",
                *(f"{k} = {f'{v:.4g}' if isinstance(v, float) else chr(34) + v + chr(34)}" for k, v in miss.items()),
                "",
            ]
        for sequence in sorted(self.table):
            for suite in sorted(self.table[sequence]):
                lines.append(f"[{sequence}.{suite}]")
                lines += [f"{metric} = {value:.4g}" for metric, value in self.table[sequence][suite].items()] + [""]
        self.file.write_text("\n".join(lines), encoding="utf-8")
