#!/usr/bin/env python3
"""Checks the sizes of functions and files.   usage: sizes.py [--list]

In server, kernels, client and common, functions have at most 80 lines, in C++ (by ctags) and Python; at most two files
are longer than 500 lines, and at most MAX_SHORT_FILES have 50 lines or fewer. --list prints the short files, too.
Prints FILE:LINE: what. Exit status: 0 within the bounds, 1 beyond.
"""
import ast
import json
import subprocess
import sys

import checkout
from checkout import ROOT

MAX_FUNCTION_LINES, MAX_FILE_LINES, SHORT_FILE_LINES = 80, 500, 50
MAX_LONG_FILES, MAX_SHORT_FILES = 2, 200
COUNTED = ("server/", "kernels/", "client/", "common/")
CPP = (".cc", ".h", ".cu", ".cuh")
SOURCES = CPP + (".py", ".ts", ".mjs")


def tracked():
    """Paths of the counted source files."""
    return [name for name in checkout.files() if name.startswith(COUNTED) and name.endswith(SOURCES)]


def cpp_functions(names):
    """(file, line, name, lines) of each C++ function definition."""
    command = [
        "ctags",
        "-L",
        "-",
        "--output-format=json",
        "--fields=+neK",
        "--kinds-C++=f",
        "--language-force=C++",
        "-f",
        "-",
    ]
    tags = subprocess.run(command, cwd=ROOT, input="\n".join(names), check=True, capture_output=True, text=True).stdout
    for tag in map(json.loads, tags.splitlines()):
        if "end" in tag and not tag["name"].startswith("TEST"):
            yield tag["path"], tag["line"], tag["name"], tag["end"] - tag["line"] + 1


def python_functions(names):
    """(file, line, name, lines) of each Python function."""
    for name in names:
        for node in ast.walk(ast.parse((ROOT / name).read_text())):
            if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
                yield name, node.lineno, node.name, node.end_lineno - node.lineno + 1


def main():
    names = tracked()
    lines = {name: (ROOT / name).read_text(errors="replace").count("\n") for name in names}
    bad = False
    functions = list(cpp_functions([name for name in names if name.endswith(CPP)]))
    functions += python_functions([name for name in names if name.endswith(".py")])
    for name, line, function, length in sorted(functions):
        if length > MAX_FUNCTION_LINES:
            print(f"{name}:{line}: {function}() has {length} lines, at most {MAX_FUNCTION_LINES}")
            bad = True
    long_files = [name for name in names if lines[name] > MAX_FILE_LINES]
    if len(long_files) > MAX_LONG_FILES:
        for name in long_files:
            print(f"{name}:1: {lines[name]} lines; at most {MAX_LONG_FILES} files have more than {MAX_FILE_LINES}")
        bad = True
    short_files = [name for name in names if lines[name] <= SHORT_FILE_LINES]
    if len(short_files) > MAX_SHORT_FILES:
        print(
            f"{len(short_files)} files of {SHORT_FILE_LINES} lines or fewer, at most {MAX_SHORT_FILES}; see sizes.py --list"
        )
        bad = True
    if "--list" in sys.argv:
        print("\n".join(f"{name}: {lines[name]}" for name in short_files))
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
