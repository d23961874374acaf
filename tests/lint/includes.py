#!/usr/bin/env python3
"""Checks that includes go down the folder list, never up.   usage: includes.py [--graph]

The list is FOLDERS below, bottom to top, as in the module table of CONTRIBUTING.md. A file may include headers of its own
folder and of folders above it in the list; client/ includes nothing of server/ and kernels/. Also checks that FILE.cc
includes FILE.h first, which proves that the header compiles alone. --graph prints which folder includes which.
Prints FILE:LINE: what. Exit status: 0 no violation, 1 some.
"""
import re
import sys

import checkout
from checkout import ROOT

FOLDERS = [
    "proto",
    "common",
    "kernels",
    "server/events",
    "server/access",
    "server/cameras",
    "server/silhouettes",
    "server/pose",
    "server/pipeline",
    "server/config",
    "server/calibration",
    "server/sync",
    "server/quality",
    "server/recording",
    "server/api",
    "server/metrics",
    "server/daemon",
    "server/tools",
    "client/lib",
    "client/cli",
    "client/bridge",
    "client/web",
    "client/viewer",
    "tests",
]
RANK = {folder: rank for rank, folder in enumerate(FOLDERS)}
CLIENT_USES = ("proto", "common", "client/lib")
INCLUDE = re.compile(r'^\s*#\s*include\s+"([^"]+)"')


def folder_of(path):
    """The entry of FOLDERS that contains the file; None for files outside."""
    found = [folder for folder in FOLDERS if path.startswith(folder + "/")]
    return max(found, key=len, default=None)


def includes(text):
    """Yields (line number, path) for each quoted include."""
    for number, line in enumerate(text.splitlines(), 1):
        if match := INCLUDE.match(line):
            yield number, match[1]


def main():
    existing = set(checkout.files("*.h", "*.cc", "*.cu", "*.cuh"))
    count, graph = 0, {}
    for name in sorted(existing):
        source = folder_of(name)
        found = list(includes((ROOT / name).read_text()))
        own_header = re.sub(r"\.cc$", ".h", name)
        if name.endswith(".cc") and own_header in existing and found and found[0][1] != own_header:
            if any(path == own_header for _, path in found):
                print(f"{name}:{found[0][0]}: include {own_header} first")
                count += 1
        for number, path in found:
            target = folder_of(path)
            if source is None or target is None or source == target:
                continue
            graph.setdefault(source, {}).setdefault(target, []).append(f"{name}:{number}")
            is_client = source.startswith("client/") and target not in CLIENT_USES
            if RANK[target] > RANK[source] or is_client:
                print(f"{name}:{number}: {source} must not include {path}")
                count += 1
    if "--graph" in sys.argv:
        for source in FOLDERS:
            targets = graph.get(source, {})
            print(f"{source}: " + ", ".join(f"{target} ({len(lines)})" for target, lines in sorted(targets.items())))
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
