#!/usr/bin/env python3
"""bounds.py on planted values: tolerance, direction, expected misses, update."""
import contextlib
import io
import tempfile
import unittest
from pathlib import Path

from bounds import Judgement

TABLE = """# A comment.

[[expected_miss]]
sequence = "a"
metric = "volume.coloured_iou"
value = 0.7
reason = "known"

[a.pose]
joints_mean_mm = 10.0
swaps = 0

[a.silhouettes]
mean_iou = 0.9
"""


class Bounds(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.file = Path(folder.name) / "bounds.toml"
        self.file.write_text(TABLE)

    def status(self, judgement):
        with contextlib.redirect_stdout(io.StringIO()) as text:
            return judgement.finish(), text.getvalue()

    def test_values_may_be_15_percent_worse(self):
        for suite, metrics, expected in (
            ("pose", {"joints_mean_mm": 11.4}, 0),
            ("pose", {"joints_mean_mm": 11.6}, 1),
            ("silhouettes", {"mean_iou": 0.886}, 0),
            ("silhouettes", {"mean_iou": 0.884}, 1),
            ("pose", {"swaps": 1}, 1),
            ("pose", {"joints_mean_mm": float("nan")}, 1),
        ):
            judgement = Judgement(self.file)
            judgement.measure("a", metrics, suite)
            self.assertEqual(self.status(judgement)[0], expected, metrics)

    def test_values_without_a_bound_fail_until_updated(self):
        judgement = Judgement(self.file)
        judgement.measure("b", {"median_mm": 5.0}, "tracking")
        self.assertIn("run with --update", self.status(judgement)[1])
        judgement.update()
        again = Judgement(self.file)
        again.measure("b", {"median_mm": 5.1}, "tracking")
        again.measure("a", {"joints_mean_mm": 10.0}, "pose")
        self.assertEqual(self.status(again)[0], 0)
        self.assertEqual(again.misses[("a", "volume.coloured_iou")]["reason"], "known")
        self.assertTrue(self.file.read_text().startswith("# A comment."))

    def test_requirements_fail_unless_expected(self):
        for metric, value, limit, expected in (
            ("volume.coloured_iou", 0.7, 0.72, 0),
            ("volume.coloured_iou", 0.75, 0.72, 1),
            ("volume.hull_coverage", 0.96, 0.97, 1),
            ("pose.joints_mean_mm", 34, 35, 0),
        ):
            judgement = Judgement(self.file)
            with contextlib.redirect_stdout(io.StringIO()):
                judgement.require("a", metric, value, limit)
            self.assertEqual(self.status(judgement)[0], expected, (metric, value))


if __name__ == "__main__":
    unittest.main()
