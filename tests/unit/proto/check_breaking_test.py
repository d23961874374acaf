#!/usr/bin/python3
"""proto/check-breaking on planted changes of a small API.   usage: check_breaking_test.py CHECK_BREAKING"""
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

PROGRAM = Path(sys.argv.pop(1)).resolve()
PROTO = """syntax = "proto3";
package kinevox.v1;
service Music {
  rpc Play(PlayRequest) returns (stream PlayResponse);
}
enum Tempo {
  TEMPO_UNSPECIFIED = 0;
  TEMPO_SLOW = 1;
}
message PlayRequest {
  string title = 1;
  oneof volume {
    double gain = 2;
    int32 level = 3;
  }
  message Track {
    repeated string artists = 1;
  }
  optional Tempo tempo = 4;
}
message PlayResponse {
  bytes sound = 1;
}
"""


class CheckBreaking(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.file = Path(self.folder.name) / "kinevox/v1/music.proto"
        self.file.parent.mkdir(parents=True)
        self.stored = Path(self.folder.name) / "api.txt"
        self.file.write_text(PROTO)
        self.assertEqual(self.run_program("--update").returncode, 0)

    def run_program(self, *options):
        return subprocess.run(
            [PROGRAM, "--proto-path", self.folder.name, "--stored", self.stored, *options],
            capture_output=True,
            text=True,
            timeout=60,
        )

    def change(self, *replacements):
        """Applies the replacements to the .proto file and returns the lines reported about it."""
        text = PROTO
        for old, new in replacements:
            self.assertIn(old, text)
            text = text.replace(old, new)
        self.file.write_text(text)
        result = self.run_program()
        self.assertEqual(result.returncode, 1, result.stderr)
        return result.stdout.splitlines()

    def test_accepts_unchanged_api(self):
        self.assertEqual(self.run_program().returncode, 0)

    def test_accepts_changed_comments(self):
        self.file.write_text("// Plays music.\n" + PROTO)
        self.assertEqual(self.run_program().returncode, 0)

    def test_requires_update_after_addition(self):
        lines = self.change(("  bytes sound = 1;", "  bytes sound = 1;\n  int64 length = 2;"))
        self.assertEqual(lines, ["field kinevox.v1.PlayResponse.length: added"])
        self.assertEqual(self.run_program("--update").returncode, 0)
        self.assertEqual(self.run_program().returncode, 0)

    def test_reports_removed_field(self):
        self.assertEqual(self.change(("  bytes sound = 1;\n", "")), ["field kinevox.v1.PlayResponse.sound: removed"])

    def test_reports_renamed_field(self):
        self.assertEqual(
            self.change(("bytes sound", "bytes samples")), ["field kinevox.v1.PlayResponse.sound: renamed to samples"]
        )

    def test_reports_renumbered_field(self):
        self.assertEqual(
            self.change(("bytes sound = 1", "bytes sound = 2")),
            ["field kinevox.v1.PlayResponse.sound: changed from '1 bytes' to '2 bytes'"],
        )

    def test_reports_retyped_field(self):
        self.assertEqual(
            self.change(("bytes sound = 1", "string sound = 1")),
            ["field kinevox.v1.PlayResponse.sound: changed from '1 bytes' to '1 string'"],
        )

    def test_reports_changed_labels(self):
        self.assertEqual(
            self.change(("repeated string artists", "string artists"), ("optional Tempo", "Tempo")),
            [
                "field kinevox.v1.PlayRequest.tempo: changed from '4 optional kinevox.v1.Tempo' to '4 kinevox.v1.Tempo'",
                "field kinevox.v1.PlayRequest.Track.artists: changed from '1 repeated string' to '1 string'",
            ],
        )

    def test_reports_changed_oneof(self):
        self.assertEqual(
            self.change(("    int32 level = 3;\n  }", "  }\n  int32 level = 3;")),
            ["field kinevox.v1.PlayRequest.level: changed from '3 int32 oneof volume' to '3 int32'"],
        )

    def test_reports_changed_enum(self):
        self.assertEqual(
            self.change(("TEMPO_SLOW = 1", "TEMPO_FAST = 1")),
            ["value kinevox.v1.Tempo.TEMPO_SLOW: renamed to TEMPO_FAST"],
        )
        self.assertEqual(
            self.change(("TEMPO_SLOW = 1", "TEMPO_SLOW = 2")),
            ["value kinevox.v1.Tempo.TEMPO_SLOW: changed from '1' to '2'"],
        )

    def test_reports_changed_methods(self):
        self.assertEqual(self.change(("rpc Play(", "rpc Start(")), ["method kinevox.v1.Music.Play: removed"])
        request, response = "kinevox.v1.PlayRequest", "kinevox.v1.PlayResponse"
        self.assertEqual(
            self.change(("returns (stream PlayResponse)", "returns (PlayResponse)")),
            [
                f"method kinevox.v1.Music.Play: changed from '{request} returns stream {response}' to '{request} returns {response}'"
            ],
        )

    def test_reports_removed_service(self):
        text = PROTO.partition("service")[2].partition("}\n")[0]
        self.assertEqual(
            self.change(("service" + text + "}\n", "")),
            ["service kinevox.v1.Music: removed", "method kinevox.v1.Music.Play: removed"],
        )


if __name__ == "__main__":
    unittest.main()
