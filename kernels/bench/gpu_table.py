#!/usr/bin/env python3
"""The table of kernels/bench/gpu: each benchmark's time on the CPU and on the card, and how many times faster that is."""
import argparse
import json


def times_us(path):
    scale = {"ns": 1e-3, "us": 1.0, "ms": 1e3, "s": 1e6}
    with open(path) as file:
        report = json.load(file)
    return report["context"], {b["name"]: b["real_time"] * scale[b["time_unit"]] for b in report["benchmarks"]}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--card", required=True)
    parser.add_argument("cpu")
    parser.add_argument("cuda")
    arguments = parser.parse_args()
    context, cpu = times_us(arguments.cpu)
    _, cuda = times_us(arguments.cuda)
    print(f"# {arguments.card}\n")
    print(
        f"`kernels/bench/gpu`, {context['date'][:10]}, beside {context['num_cpus']} CPU cores. Microseconds, uploads and "
        f"downloads of what the next stage needs included.\n"
    )
    print("| benchmark | CPU | CUDA | CPU / CUDA |\n| --- | ---: | ---: | ---: |")
    for name, on_cpu in cpu.items():
        on_card = cuda.get(name)
        if on_card is None:
            print(f"| {name.removesuffix('/real_time')} | {on_cpu:.0f} | - | - |")
        else:
            print(f"| {name.removesuffix('/real_time')} | {on_cpu:.0f} | {on_card:.0f} | {on_cpu / on_card:.1f} |")


if __name__ == "__main__":
    main()
