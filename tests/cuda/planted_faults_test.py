#!/usr/bin/env python3
"""Checks that the emulator finds every planted fault (planted_faults.cu) and accepts the correct form of each.

usage: planted_faults_test.py PLAIN ASAN CHECKED     the programs planted_faults_VARIANT
A fault is found if a run reports it, or if results depend on a setting that no correct program's do. Prints which runs find
which fault. Exit status: 0 if all are found and no correct form is reported, else 1.
"""
import subprocess
import sys

import emulator_runs


def findings(programs, fault, form):
    """Names of the runs that find something."""
    plain, asan, checked = programs
    found, first = [], None
    runs = [(plain, settings, emulator_runs.name(settings)) for settings in emulator_runs.SETTINGS]
    runs += [(asan, {}, "asan"), (checked, {}, "checked")]
    for program, settings, name in runs:
        process = emulator_runs.run([program, fault, form], settings)
        if emulator_runs.problem(process) or process.returncode != 0:
            found.append(name)
        elif program == plain:
            first = first or process.stdout
            if process.stdout != first:
                found.append(name)
    return found


def main():
    programs = sys.argv[1:]
    names = subprocess.run(programs[:1], capture_output=True, text=True, check=True).stdout.split()
    count, wrong = 0, 0
    for fault in names:
        found = findings(programs, fault, "faulty")
        count += bool(found)
        print(f"{fault:30} {'; '.join(found) or 'NOT FOUND'}")
        reported = findings(programs, fault, "correct")
        if reported:
            wrong += 1
            print(f"{fault:30} its correct form is reported by {'; '.join(reported)}")
    print(f"{count} of {len(names)} planted faults found, {wrong} correct forms reported")
    return 0 if count == len(names) == 14 and not wrong else 1


if __name__ == "__main__":
    sys.exit(main())
