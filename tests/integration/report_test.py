#!/usr/bin/env python3
"""`kinevox report`: a page in both formats, with and without images, of a recording, and user errors.

usage: report_test.py KINEVOX MAKE_POSED_TRIAL [unittest options]"""
import json
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import cv2
import numpy as np

REPOSITORY = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(REPOSITORY / "tests/support"))
from forked_program import ForkedProgram  # noqa: E402

KINEVOX = MAKE_TRIAL = None
PROGRAM = ForkedProgram(
    REPOSITORY / "server/tools/report/kinevox-report",
    [f"kinevox_report.{part}" for part in ("alignment", "certificate", "certificate_page", "page", "trial")],
)
FRAMES = 40
STRIP = (slice(400, 750), slice(120, 1530))  # px of the page at 200 dpi


def run(*arguments):
    return PROGRAM.run(*arguments)


def run_command(*arguments):
    """The command itself; only a few times, since most of its time are the imports."""
    return subprocess.run([KINEVOX, "report", *map(str, arguments)], capture_output=True, text=True, timeout=120)


def write_session(folder):
    """A camera 4 m in front of the trial's person, whose images are green."""
    (folder / "images").mkdir(parents=True)
    for n in range(FRAMES):
        cv2.imwrite(str(folder / "images" / f"{n:03d}.png"), np.full((480, 640, 3), (40, 160, 40), np.uint8))
    (folder / "session.toml").write_text(
        'name = "green room"\nfps = 50.0\ncalibration = "calibration.toml"\n\n'
        '[[camera]]\nname = "front"\nvideo = "images"\n'
    )
    (folder / "calibration.toml").write_text(  # looks along +x from x = -3, z = 1
        '[front]\nname = "front"\nsize = [640.0, 480.0]\nmatrix = [[500.0, 0.0, 320.0], [0.0, 500.0, 240.0], '
        "[0.0, 0.0, 1.0]]\ndistortions = [0.0, 0.0, 0.0, 0.0, 0.0]\n"
        "rotation = [1.2091995761561452, -1.2091995761561452, 1.2091995761561452]\n"
        "translation = [-0.4, 1.0, 3.0]\nfisheye = false\n"
    )
    return folder / "session.toml"


class Report(unittest.TestCase):
    def setUp(self):
        self.folder = Path(tempfile.mkdtemp(prefix="kinevox-report-"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)
        self.trial = self.folder / "trial"
        subprocess.run([MAKE_TRIAL, self.trial, "gaps"], check=True)

    def report(self, *more, trial=None, by=run):
        done = by(trial or self.trial, *more)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        self.assertRegex(done.stdout, r"^report in .+\n$")

    def green_of(self, page):
        strip = cv2.imread(str(page))[STRIP].astype(int)
        return float(((strip[..., 1] > strip[..., 0] + 60) & (strip[..., 1] > strip[..., 2] + 60)).mean())

    def test_both_formats_are_reproducible(self):
        self.report(by=run_command)
        page = cv2.imread(str(self.trial / "report.png"))
        self.assertEqual(page.shape[:2], (2338, 1653), "A4 at 200 dpi")
        self.assertLess(self.green_of(self.trial / "report.png"), 0.01)
        first = (self.trial / "report.png").read_bytes()
        self.report()
        self.assertEqual((self.trial / "report.png").read_bytes(), first)
        pdf = self.folder / "new" / "page.pdf"
        self.report("--out", pdf)
        self.assertTrue(pdf.read_bytes().startswith(b"%PDF"))
        done = run(self.trial, "--out", pdf)
        self.assertEqual(done.returncode, 1)
        self.assertIn("--overwrite", done.stderr)
        self.assertEqual([p.name for p in pdf.parent.iterdir()], ["page.pdf"], "no temporary file is left")

    def test_shows_the_sessions_images(self):
        session = write_session(self.folder / "session")
        self.report("--session", session)
        self.assertGreater(self.green_of(self.trial / "report.png"), 0.7)
        (self.trial / "report.png").unlink()
        (self.trial / "run.toml").write_text(f'session = "{session}"\n')
        self.report("--camera", "front")
        self.assertGreater(self.green_of(self.trial / "report.png"), 0.7)
        shutil.rmtree(session.parent)
        self.report()  # works without the images
        self.assertLess(self.green_of(self.trial / "report.png"), 0.01)

    def test_shows_the_images_of_cameras_that_started_early(self):
        session = write_session(self.folder / "session")
        images = session.parent / "images"
        for n in reversed(range(FRAMES)):  # 12 red ones come first
            (images / f"{n:03d}.png").rename(images / f"{n + 12:03d}.png")
        for n in range(12):
            cv2.imwrite(str(images / f"{n:03d}.png"), np.full((480, 640, 3), (40, 40, 200), np.uint8))
        (self.trial / "run.toml").write_text(f'session = "{session}"\n\n[first_image_index]\n"front" = 12\n')
        self.report()
        self.assertGreater(self.green_of(self.trial / "report.png"), 0.7)

    def test_reports_a_recording(self):
        session = write_session(self.folder / "recording")
        shutil.copytree(self.trial, session.parent / "poses")
        text = session.read_text() + '\n[recording]\nframe_times = "frames.csv"\n'
        session.write_text(text)
        done = run(session.parent)
        self.assertEqual((done.returncode, len(done.stderr.splitlines())), (1, 1), done.stderr)
        self.assertIn("contains no poses", done.stderr)
        session.write_text(text + 'poses = "poses"\n')
        self.report(trial=session.parent)
        self.assertGreater(self.green_of(session.parent / "report.png"), 0.7)

    def test_several_subjects_need_a_choice(self):
        for name in ("joints.csv", "angles.csv", "uncertainty.csv"):
            header, *rows = (self.trial / name).read_text().splitlines()
            second = [",".join([*r.split(",")[:2], "2", *r.split(",")[3:]]) for r in rows]
            (self.trial / name).write_text(
                "\n".join([header, *(line for pair in zip(rows, second) for line in pair)]) + "\n"
            )
        done = run(self.trial)
        self.assertEqual((done.returncode, len(done.stderr.splitlines())), (1, 1), done.stderr)
        self.assertIn("has subjects 1, 2; choose one with --subject", done.stderr)
        self.report("--subject", 2)
        self.assertIn("has no subject 3; it has 1, 2", run(self.trial, "--subject", 3).stderr)

    def test_errors_are_one_line(self):
        session = write_session(self.folder / "session")
        good = {name: (self.trial / name).read_text() for name in ("joints.csv", "angles.csv")}
        lines = good["angles.csv"].splitlines()
        empty = lines[0] + "\n" + "".join(",".join(row.split(",")[:3]) + 11 * "," + "\n" for row in lines[1:])
        table = [
            ([], {}, "PATH"),
            (["/nowhere"], {}, "/nowhere"),
            ([self.folder], {}, "joints.csv"),
            ([self.trial, "--out", "page.jpg"], {}, "page.jpg"),
            ([self.trial, "--out", "/proc/x/y.png"], {}, "/proc/x/y.png"),
            ([self.trial, "--session", "/no/session.toml"], {}, "/no/session.toml"),
            ([self.trial, "--session", session, "--camera", "back"], {}, "front"),
            ([self.trial, "--session", session], {"session": FRAMES - 2}, "has no image"),
            ([self.trial], {"angles.csv": lines[0] + "\n"}, "angles.csv: has no frames"),
            ([self.trial], {"angles.csv": empty}, "every angle of every frame is withheld"),
            ([self.trial], {"angles.csv": "\n".join(lines[:9]) + "\n"}, "angles.csv: its frames"),
            ([self.trial], {"joints.csv": good["joints.csv"].replace("\n1,", "\none,")}, "joints.csv:3: frame is"),
            ([self.trial], {"joints.csv": good["joints.csv"].replace("root_x", "rooty")}, "no column root_x"),
            ([self.trial], {"joints.csv": good["joints.csv"][:-40]}, "joints.csv:41:"),
            ([self.trial], {"run.toml": "session = "}, "run.toml"),
        ]
        for arguments, files, names in table:
            for name, text in {**good, "run.toml": "", **files}.items():
                if name == "session":
                    for image in sorted((session.parent / "images").iterdir())[text:]:
                        image.unlink()
                else:
                    (self.trial / name).write_text(text)
            for by in (run_command, run) if names in ("PATH", "front") else (run,):
                done = by(*arguments)
                self.assertEqual((done.returncode, done.stdout), (1, ""), (arguments, done.stderr))
                self.assertEqual(done.stderr.count("\n"), 1, (arguments, done.stderr))
                self.assertIn(names, done.stderr, arguments)
        self.assertFalse((self.trial / "report.png").exists())


def certificate(**more):
    """A minimal certificate: two cameras that face each other."""
    camera = {
        "centre_m": [2.0, 0.0, 1.5],
        "size_px": [640, 480],
        "focal_px": [500, 500],
        "principal_point_px": [319.5, 239.5],
        "distortion": [0, 0, 0, 0, 0],
        "camera_from_world": {"rotation_vector": [1.2092, 1.2092, -1.2092], "translation_m": [0, 1.5, 2]},
    }
    other = {
        **camera,
        "centre_m": [-2.0, 0.0, 1.5],
        "camera_from_world": {"rotation_vector": [1.2092, -1.2092, 1.2092], "translation_m": [0, 1.5, 2]},
    }
    return {
        "verdict": "GO",
        "method": "import",
        "findings": [],
        "world_defined": True,
        "cameras": {"a": camera, "b": other},
        **more,
    }


class CertificatePage(unittest.TestCase):
    def setUp(self):
        self.folder = Path(tempfile.mkdtemp(prefix="kinevox-report-"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    def test_every_verdict_has_its_colour(self):
        for verdict, channel in (("GO", 1), ("CAUTION", 2), ("NO-GO", 2)):
            finding = {"verdict": verdict, "check": "x", "reason": "a reason " * 30, "remedy": "a remedy " * 30}
            file = self.folder / f"{verdict}.certificate.json"
            file.write_text(json.dumps(certificate(verdict=verdict, findings=[finding] * 7)))
            done = run(file)
            self.assertEqual((done.returncode, done.stderr), (0, ""))
            page = cv2.imread(str(file.with_suffix(".png")))
            self.assertEqual(page.shape[:2], (2338, 1653), "A4 at 200 dpi")
            self.assertEqual(int(page[300, 130].argmax()), channel, "the band's left edge")

    def test_invalid_certificates_are_reported_in_one_line(self):
        good = certificate()
        for what in (
            "",
            "[]",
            "{",
            "null",
            json.dumps({**good, "verdict": "MAYBE"}),
            json.dumps({**good, "cameras": {}}),
            json.dumps({**good, "cameras": {"a": {}}}),
            json.dumps({**good, "findings": [3]}),
            json.dumps({**good, "overlay_images": {"a": "bm90aGluZw=="}}),
            json.dumps({**good, "target_points_m": [[1, 2]]}),
            json.dumps({k: v for k, v in good.items() if k != "method"}),
        ):
            file = self.folder / "x.certificate.json"
            file.write_text(what)
            done = run(file)
            self.assertEqual((done.returncode, len(done.stderr.splitlines())), (1, 1), what[:80] + done.stderr)
            self.assertIn("x.certificate.json", done.stderr)
            self.assertFalse(file.with_suffix(".png").exists())
        self.assertIn("no such file", run_command(self.folder / "none.json").stderr)


class AlignmentPage(unittest.TestCase):
    def setUp(self):
        self.folder = Path(tempfile.mkdtemp(prefix="kinevox-report-"))
        self.addCleanup(shutil.rmtree, self.folder, ignore_errors=True)

    @staticmethod
    def alignment(cameras):
        evidence = (100 * np.exp(-np.linspace(-3, 3, 121) ** 2)).tolist()
        camera = {
            "name": "a",
            "offset_s": 0.5,
            "std_s": 0.01,
            "evidence_nats": 100,
            "runner_up_ratio": 0.4,
            "runner_up_offset_s": 1.2,
            "curve": {"first_offset_s": -2.0, "evidence_nats": evidence},
            "changed_fraction_per_s": [None, 1.0, 2.0, None, 1.5],
        }
        return {
            "kind": "alignment",
            "session": "x",
            "fps": 30.0,
            "used_extrinsics": True,
            "cameras": [camera] * cameras,
        }

    def test_draws_few_and_many_cameras(self):
        for cameras in (2, 9):
            file = self.folder / f"{cameras}.json"
            file.write_text(json.dumps(self.alignment(cameras)))
            done = run_command(file)
            self.assertEqual((done.returncode, done.stderr), (0, ""))
            page = cv2.imread(str(file.with_suffix(".png"))).astype(int)
            self.assertEqual(page.shape[:2], (2338, 1653), "A4 at 200 dpi")
            self.assertGreater(int(((page[..., 0] > page[..., 2] + 80)).sum()), 500, "the first camera's blue curve")

    def test_invalid_alignments_are_reported_in_one_line(self):
        good = self.alignment(2)
        for what in (
            {**good, "cameras": []},
            {**good, "fps": 0},
            {**good, "cameras": [{}]},
            {**good, "cameras": 3},
            {k: v for k, v in good.items() if k != "session"},
        ):
            file = self.folder / "x.json"
            file.write_text(json.dumps(what))
            done = run(file)
            self.assertEqual((done.returncode, len(done.stderr.splitlines())), (1, 1), done.stderr)
            self.assertIn("x.json", done.stderr)
            self.assertFalse(file.with_suffix(".png").exists())


if __name__ == "__main__":
    KINEVOX, MAKE_TRIAL = sys.argv.pop(1), sys.argv.pop(1)
    unittest.main()
