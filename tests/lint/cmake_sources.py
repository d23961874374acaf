#!/usr/bin/env python3
"""Checks that CMake lists name one source file per line.   usage: cmake_sources.py [--fix]

Applies to the commands in COMMANDS. --fix rewrites the files. Prints FILE:LINE: what. Exit status: 0 none found, 1 some.
"""
import re
import sys

import checkout
from checkout import ROOT

COMMANDS = (
    "add_executable",
    "add_library",
    "kinevox_fuzzer",
    "kinevox_library",
    "kinevox_test",
    "set",
    "target_sources",
)
SOURCE = re.compile(r"(?<!\S)[\w./${}-]+\.(?:cc|cu|h)(?=[\s)]|$)")


def split(line, depth_indent):
    """The line with each source on a line of its own."""
    code, comment = re.fullmatch(r"(.*?)(\s*#.*)?", line).groups()
    found = list(SOURCE.finditer(code))
    before, after = code[: found[0].start()].rstrip(), code[found[-1].end() :].strip()
    keyword = re.search(r"\b(SOURCES|PRIVATE|PUBLIC)$", before)
    # Sources follow their keyword by four columns, or the command by two.
    indent = " " * (depth_indent + (4 if keyword or not before.strip() else 2))
    out = []
    if keyword and before.strip() != keyword[1]:
        out += [before[: keyword.start()].rstrip(), " " * (depth_indent + 2) + keyword[1]]
    elif before.strip():
        out.append(before)
    out += [indent + match[0] for match in found]
    if after.startswith(")"):
        out[-1] += after
    elif after:
        out.append(" " * (depth_indent + 2) + after)
    out[-1] += comment or ""
    return out


def rewritten(text):
    """The text with one source per line, and the numbers of the lines that had more."""
    out, numbers, command, depth, base = [], [], None, 0, 0
    for number, line in enumerate(text.splitlines(), 1):
        code = line.split("#")[0]
        if depth == 0 and (match := re.match(r"(\s*)(\w+)\(", code)):
            command, base = match[2], len(match[1])
        if command in COMMANDS and len(SOURCE.findall(code)) > 1:
            numbers.append(number)
            out += split(line, base)
        else:
            out.append(line)
        depth += code.count("(") - code.count(")")
    return "\n".join(out) + "\n", numbers


def main():
    count = 0
    for name in checkout.files("*CMakeLists.txt"):
        file = ROOT / name
        text, numbers = rewritten(file.read_text())
        if numbers and "--fix" in sys.argv:
            file.write_text(text)
        for number in () if "--fix" in sys.argv else numbers:
            print(f"{name}:{number}: name one source per line; run tests/lint/cmake_sources.py --fix")
            count += 1
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
