#!/usr/bin/env python3
"""Tests of the checks in this folder.   usage: lint_test.py"""
import re
import sys
import tempfile
import unittest
from pathlib import Path

sys.dont_write_bytecode = True
sys.path.insert(0, str(Path(__file__).parent))
import cmake_sources  # noqa: E402
import includes  # noqa: E402
import links  # noqa: E402
import sizes  # noqa: E402
import words  # noqa: E402


class Words(unittest.TestCase):
    def found(self, path, text, rows=()):
        return [word for _, word in words.refused(path, text, rows)]

    def test_refused_words_and_identifiers(self):
        self.assertEqual(self.found("a.md", "Whoever is told; the lens"), ["Whoever", "told", "lens"])
        self.assertEqual(self.found("a.cc", "int least_cameras = kMostViews;"), ["least_cameras", "kMostViews"])
        self.assertEqual(self.found("a.md", "least_cameras"), [])
        self.assertEqual(self.found("a.cc", "kWidest + turn_deg; LensFit"), ["kWidest", "turn_deg", "LensFit"])
        self.assertEqual(self.found("a.cc", "TEST(Import, IsToldOnce)"), ["IsToldOnce"])

    def test_accepted_words(self):
        self.assertEqual(self.found("a.cc", "// The standard deviation; something; another lensless camera"), [])

    def test_exceptions_cover_a_phrase(self):
        rows = [("a.*", re.compile("wide lens(es)?", re.IGNORECASE))]
        self.assertEqual(self.found("a.md", "very wide lenses", rows), [])
        self.assertEqual(self.found("a.md", "wide lenses and lenses", rows), ["lenses"])
        self.assertEqual(self.found("b.md", "very wide lenses", rows), ["lenses"])


class Includes(unittest.TestCase):
    def test_folder_of_a_file(self):
        self.assertEqual(includes.folder_of("server/pose/database/x.h"), "server/pose")
        self.assertIsNone(includes.folder_of("docs/x.h"))

    def test_quoted_includes(self):
        text = '#include <vector>\n#include "common/camera.h"\n'
        self.assertEqual(list(includes.includes(text)), [(2, "common/camera.h")])


class Links(unittest.TestCase):
    def test_anchors(self):
        self.assertEqual(links.anchor("## `kinevox status`, and more".lstrip("# ")), "kinevox-status-and-more")

    def test_missing_files_and_headings(self):
        with tempfile.TemporaryDirectory() as folder:
            page = Path(folder) / "page.md"
            page.write_text("# Title\n[a](none.md) [b](#title) [c](#other) [d](https://example.org) `server/none.cc`\n")
            what = [text for _, text in links.problems(page)]
        self.assertEqual(len(what), 3, what)


class CmakeSources(unittest.TestCase):
    def test_one_source_per_line(self):
        text, numbers = cmake_sources.rewritten(
            "kinevox_library(a\n  SOURCES b.cc c/d.cc\n  PUBLIC e)\nfoo(b.cc c.cc)\n"
        )
        self.assertEqual(text, "kinevox_library(a\n  SOURCES\n    b.cc\n    c/d.cc\n  PUBLIC e)\nfoo(b.cc c.cc)\n")
        self.assertEqual(numbers, [2])
        text, _ = cmake_sources.rewritten("add_executable(a b.cc c.cc)\n")
        self.assertEqual(text, "add_executable(a\n  b.cc\n  c.cc)\n")
        self.assertEqual(cmake_sources.rewritten(text), (text, []))


class Sizes(unittest.TestCase):
    def test_python_functions(self):
        path = Path(__file__).relative_to(sizes.ROOT)
        names = {name for _, _, name, _ in sizes.python_functions([str(path)])}
        self.assertIn("test_python_functions", names)


if __name__ == "__main__":
    unittest.main()
