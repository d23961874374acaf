#!/usr/bin/env python3
"""Checks the links of all Markdown pages.   usage: links.py

A relative link must name a file of the tree, a fragment a heading of its page, and a path in code quotes that begins with a
folder of the tree (`server/api`) an existing file. Prints FILE:LINE: what. Exit status: 0 all found, 1 some missing.
"""
import re
import sys

import checkout
from checkout import ROOT

LINK = re.compile(r"\]\(([^)\s]+)\)")
QUOTED_PATH = re.compile(r"`((?:client|common|cmake|deploy|docs|kernels|proto|server|tests)/[\w./-]+)`")
HEADING = re.compile(r"^#+\s+(.*)$", re.MULTILINE)


def anchor(heading):
    """GitHub's fragment of a heading."""
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading).replace("`", "").lower()
    return re.sub(r"[^\w\- ]", "", text).strip().replace(" ", "-")


def anchors(file):
    """The fragments of a page."""
    return {anchor(heading) for heading in HEADING.findall(file.read_text())}


def problems(page):
    """Yields (line number, what) for each broken link of a page."""
    for number, line in enumerate(page.read_text().splitlines(), 1):
        for target in LINK.findall(line):
            if re.match(r"[a-z]+:", target):
                continue
            path, _, fragment = target.partition("#")
            file = (page.parent / path) if path else page
            if not file.exists():
                yield number, f"{target} does not exist"
            elif fragment and file.suffix == ".md" and fragment not in anchors(file):
                yield number, f"{target}: no heading with this anchor"
        for path in QUOTED_PATH.findall(line):
            if not (ROOT / path.rstrip(".")).exists() and not list(ROOT.glob(path + ".*")):
                yield number, f"`{path}` does not exist"


def main():
    count = 0
    for name in checkout.files("*.md"):
        if name == "docs/vocabulary.md":
            continue  # names files of the past
        for number, what in problems(ROOT / name):
            print(f"{name}:{number}: {what}")
            count += 1
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
