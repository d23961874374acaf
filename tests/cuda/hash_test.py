#!/usr/bin/env python3
"""Checks that the CUDA forms give the same bits on the emulator in every setting, and that it reports nothing.

usage: hash_test.py PLAIN ASAN CHECKED     the programs cuda_results_VARIANT
Prints one line per run. Exit status: 0 if all results are the same and near the CPU form's, else 1.
"""
import sys

import emulator_runs


def main():
    plain, asan, checked = sys.argv[1:]
    on_second = ["160", "120", "25", "4", "cuda:1"]  # the default size
    runs = [([plain], settings, emulator_runs.name(settings)) for settings in emulator_runs.SETTINGS]
    runs += [([asan], {}, "AddressSanitizer and UBSan"), ([checked], {}, "access checker")]
    runs += [([plain, *on_second], {"GUARDED": "1"}, "cuda:1, guarded 1")]
    expected, failures = None, 0
    for command, settings, name in runs:
        process = emulator_runs.run(command, settings)
        expected = expected or process.stdout
        problem = emulator_runs.problem(process)
        if problem is None and process.stdout != expected:
            problem = "other results:\n" + process.stdout
        if problem is None and process.returncode != 0:
            problem = "CUDA and CPU form differ:\n" + process.stdout + process.stderr
        print(f"{name:30} {problem or 'same'}", flush=True)
        failures += problem is not None
    print(f"expected:\n{expected}")
    return 1 if failures else 0


if __name__ == "__main__":
    sys.exit(main())
