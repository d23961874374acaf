"""Readers of what the programs and tools of deploy/gpu-proof print."""
import csv
import io
import json
import re


def tab_rows(text):
    """Rows of tab-separated cells."""
    return [line.split("\t") for line in text.splitlines() if "\t" in line]


def test_counts(text):
    """Executed and failed tests of a GoogleTest program, and the names of the failed ones."""
    executed = re.search(r"\[=+\] (\d+) tests? from .* ran", text)
    if not executed:
        raise ValueError("the tests did not finish: " + (text.strip().splitlines() or ["no output"])[-1])
    failed = re.findall(r"^\[  FAILED  \] (\S+?),? .*\(\d+ ms\)", text, re.M)
    skipped = re.search(r"^\[  SKIPPED \] (\d+) tests?", text, re.M)
    return {
        "executed": int(executed[1]),
        "failed": len(failed),
        "skipped": int(skipped[1]) if skipped else 0,
        "failed_names": failed,
    }


def results(text):
    """Rows of cuda_results."""
    rows = []
    for stage, values, different, cpu_hash, cuda_hash in tab_rows(text):
        rows.append(
            {
                "stage": stage,
                "values": int(values),
                "different": int(different),
                "cpu_hash": cpu_hash,
                "cuda_hash": cuda_hash,
            }
        )
    if len(rows) < 8:
        raise ValueError("cuda_results did not finish: " + (text.strip().splitlines() or ["no output"])[-1])
    return rows


def benchmarks(text):
    """Median and 99th percentile in us, and iterations, by the benchmark's name."""
    times = {}
    for row in json.loads(text)["benchmarks"]:
        if "median_us" in row:
            name = re.sub(r"/(iterations:\d+|real_time)", "", row["name"])
            times[name] = {"median_us": row["median_us"], "p99_us": row["p99_us"], "iterations": row["iterations"]}
            for stage in ("segmentation", "hull", "colouring"):
                if f"{stage}_median_us" in row:
                    stage_times = {key: row[f"{stage}_{key}"] for key in ("median_us", "p99_us")}
                    times[f"{name}: {stage}"] = {**stage_times, "iterations": row["iterations"]}
    return times


def joined(cpu, cuda):
    """One row per benchmark with the times of both devices."""
    rows = []
    for name in dict.fromkeys([*cpu, *cuda]):
        row = {"name": name}
        for device, times in (("cpu", cpu), ("cuda", cuda)):
            if name in times:
                row.update({f"{device}_{key}": value for key, value in times[name].items()})
        rows.append(row)
    return rows


def sanitizer_findings(text):
    """Errors or hazards that a tool of compute-sanitizer counts."""
    found = re.search(r"ERROR SUMMARY: (\d+) error", text) or re.search(r"RACECHECK SUMMARY: (\d+) hazard", text)
    if not found:
        raise ValueError("compute-sanitizer did not finish: " + (text.strip().splitlines() or ["no output"])[-1])
    return int(found[1])


def kernels(text, metrics, frames):
    """Kernels by their time per frame set, longest first. `metrics`: ncu's names and ours."""
    lines = [line for line in text.splitlines() if line.startswith('"')]
    rows = [row for row in csv.DictReader(io.StringIO("\n".join(lines))) if (row.get("ID") or "").isdigit()]
    kernels_by_name = {}
    for row in rows:
        plain = re.sub(r"\(anonymous namespace\)::|<unnamed>::", "", row["Kernel Name"])
        found = re.search(r"(\w+)\s*(?:<.*?>)?\(", plain)
        name = found[1] if found else plain
        values = {ours: float(row[theirs].replace(",", "") or 0) for theirs, ours in metrics.items()}
        kernel = kernels_by_name.setdefault(
            name, {"name": name, "launches": 0, "us": 0.0, **dict.fromkeys(("occupancy", "dram"), 0.0)}
        )
        kernel["launches"] += 1
        kernel["us"] += values["time"] / 1e3  # base unit: ns
        kernel["registers"] = int(values["registers"])
        for key in ("occupancy", "dram"):  # weighted by time
            kernel[key] += values[key] * values["time"] / 1e3
    for kernel in kernels_by_name.values():
        for key in ("occupancy", "dram"):
            kernel[key] /= kernel["us"] or 1
        kernel["us"] /= frames
        kernel["launches"] /= frames
    return sorted(kernels_by_name.values(), key=lambda kernel: -kernel["us"])
