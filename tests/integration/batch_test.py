#!/usr/bin/python3
"""kinevox process as a batch job: resumed, interrupted, twice at the same time; with the queue script and a real Slurm.

usage: batch_test.py BUILD_FOLDER [unittest options]"""
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

import slurm_node

BATCH = Path(__file__).resolve().parents[2] / "deploy/batch"
BUILD = Path()
FRAMES = 16
QUICK = ["--voxel-mm", "40", "--no-pose"]


def contents(folder):
    """{file: (bytes, time of change)} of a folder; stage times differ between runs."""
    return {
        str(file.relative_to(folder)): (file.read_bytes(), file.stat().st_mtime_ns)
        for file in sorted(folder.rglob("*"))
        if file.is_file() and file.name != "timing.csv"
    }


class Batch(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = Path(tempfile.mkdtemp(prefix="kinevox-batch-"))
        cls.trials = []
        for name, seed in (("first", 3), ("second", 4)):
            subprocess.run(
                [
                    BUILD / "server/tools/kinevox-studio",
                    "--motion",
                    "walk",
                    "--frames",
                    str(FRAMES),
                    "--cameras",
                    "3",
                    "--size",
                    "160x120",
                    "--background-frames",
                    "20",
                    "--seed",
                    str(seed),
                    "--no-masks",
                    "--out",
                    cls.root / "trials" / name,
                ],
                check=True,
                capture_output=True,
            )
            cls.trials.append(cls.root / "trials" / name / "session.toml")

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.root, ignore_errors=True)

    def setUp(self):
        self.folder = Path(tempfile.mkdtemp(prefix="work-", dir=self.root))

    def process(self, trial, out, *more):
        return subprocess.run(
            [BUILD / "server/tools/kinevox-process", trial, "--out", out, *QUICK, *more],
            capture_output=True,
            text=True,
            timeout=120,
        )

    def test_resume_skips_existing_results(self):
        out = self.folder / "out"
        first = self.process(self.trials[0], out, "--resume")
        self.assertEqual(first.returncode, 0, first.stderr)
        before = contents(out)
        self.assertIn("run.toml", before)
        again = self.process(self.trials[0], out, "--resume")
        self.assertEqual(again.returncode, 0, again.stderr)
        self.assertIn("already", again.stdout)
        self.assertEqual(contents(out), before, "not rewritten")
        moved = self.folder / "elsewhere"  # copied to another folder, with other times
        shutil.copytree(self.trials[0].parent, moved)
        self.assertIn("already", self.process(moved / "session.toml", out, "--resume").stdout)

    def test_other_input_or_options_need_overwrite(self):
        out = self.folder / "out"
        self.process(self.trials[0], out)
        for what, trial, more in (
            ("another option", self.trials[0], ["--background-samples", "16"]),
            ("another trial", self.trials[1], ["--background-samples", "16"]),
        ):
            refused = self.process(trial, out, "--resume", *more)
            self.assertEqual(refused.returncode, 1, what)
            self.assertIn("--overwrite", refused.stderr)
            again = self.process(trial, out, "--resume", "--overwrite", *more)
            self.assertEqual(again.returncode, 0, again.stderr)
            self.assertNotIn("already", again.stdout, what)
        changed = self.folder / "changed"
        shutil.copytree(self.trials[1].parent, changed)
        calibration = changed / "calibration.toml"
        calibration.write_text(calibration.read_text() + "\n# another\n")
        self.assertNotIn(
            "already",
            self.process(changed / "session.toml", out, "--resume", "--overwrite", "--background-samples", "16").stdout,
        )

    def test_config_sets_options_unless_overridden(self):
        config = self.folder / "kinevoxd.toml"
        config.write_text(
            '[server]\ntls_key_file = "none.pem"\ntls_certificate_file = "none.pem"\n'
            "[pipeline]\nvoxel_mm = 25\ncolouring = false\n[segmentation]\nloose_threshold = 0.2\n"
        )
        out = self.folder / "out"
        ran = self.process(self.trials[0], out, "--config", config)
        self.assertEqual(ran.returncode, 0, ran.stderr)
        run = (out / "run.toml").read_text()
        self.assertIn("voxel_mm = 40.0", run, "of the command line")
        self.assertIn("colouring = false", run)
        self.assertIn("loose_threshold = 0.2\n", run)
        config.write_text(config.read_text().replace("0.2", "0.25"))
        changed = self.process(self.trials[0], out, "--config", config, "--resume")
        self.assertEqual(changed.returncode, 1, "another fingerprint")
        config.write_text("[pipeline]\nvoxels = 3\n")
        refused = self.process(self.trials[0], self.folder / "none", "--config", config)
        self.assertEqual(refused.returncode, 1)
        self.assertIn("kinevoxd.toml:2: key 'pipeline.voxels' is unknown", refused.stderr)

    def test_results_without_run_toml_are_incomplete(self):
        out = self.folder / "out"
        self.process(self.trials[0], out)
        (out / "run.toml").unlink()
        again = self.process(self.trials[0], out, "--resume")
        self.assertNotIn("already", again.stdout)
        self.assertTrue((out / "run.toml").exists())

    def test_killed_job_restarts_with_equal_results(self):
        whole, out = self.folder / "whole", self.folder / "out"
        self.process(self.trials[0], whole)
        command = [BUILD / "server/tools/kinevox-process", self.trials[0], "--out", out, *QUICK, "--resume", "--quiet"]
        killed = 0
        for _ in range(20):
            job = subprocess.Popen(command)
            end = time.monotonic() + 30
            while not (out / ".kinevox-partial").exists() and time.monotonic() < end:
                time.sleep(0.005)
            time.sleep(0.05)
            job.send_signal(signal.SIGKILL)
            job.wait()
            if (out / "run.toml").exists():  # a busy machine killed it too late
                shutil.rmtree(out)
                continue
            killed += 1
            if killed == 3:
                break
        self.assertEqual(killed, 3, "every run ended before it was killed")
        self.assertEqual(subprocess.run(command).returncode, 0)
        read = lambda folder: {name: text for name, (text, _) in contents(folder).items()}
        self.assertEqual(read(out), read(whole))
        self.assertEqual([p.name for p in out.iterdir() if p.name.startswith(".")], [], "no partial file is left")

    def test_second_job_on_one_folder_fails(self):
        out = self.folder / "out"
        command = [BUILD / "server/tools/kinevox-process", self.trials[0], "--out", out, *QUICK, "--quiet"]
        first = subprocess.Popen(command)
        end = time.monotonic() + 30
        while not (out / ".kinevox-partial").exists() and time.monotonic() < end:
            time.sleep(0.005)
        first.send_signal(signal.SIGSTOP)  # while it works
        try:
            second = subprocess.run(command, capture_output=True, text=True)
        finally:
            first.send_signal(signal.SIGCONT)
        self.assertEqual(first.wait(), 0)
        self.assertEqual(second.returncode, 1)
        self.assertIn("another", second.stderr)
        self.assertEqual(second.stderr.count("\n"), 1)
        self.assertTrue((out / "run.toml").exists())

    def sessions(self, *lines):
        file = self.folder / "sessions.txt"
        file.write_text("".join(f"{line}\n" for line in lines))
        return file

    def test_queue_processes_all_and_names_failures(self):
        listed, out = (
            self.sessions(self.trials[0], self.root / "trials/none/session.toml", self.trials[1]),
            self.folder / "out",
        )
        environment = dict(os.environ, KINEVOX=str(BUILD / "client/cli/kinevox"))
        run = lambda: subprocess.run(
            [BATCH / "kinevox-queue", listed, out, "2", *QUICK],
            env=environment,
            capture_output=True,
            text=True,
            timeout=120,
        )
        first = run()
        self.assertEqual(first.returncode, 1)
        self.assertEqual(sorted(first.stdout.splitlines()), ["first: done", "second: done"])
        self.assertIn("none: failed", first.stderr)
        self.assertIn("none", (out / "0002-none.log").read_text())
        before = contents(out / "0003-second")
        self.assertIn("volume.csv", before)
        run()
        self.assertEqual(contents(out / "0003-second"), before)

    def test_slurm_runs_the_array(self):
        if why := slurm_node.problem():
            self.skipTest(why)
        listed, out = self.sessions(*self.trials), self.folder / "out"
        node = slurm_node.SlurmNode(self.folder / "node")
        try:
            node.start()
        except (RuntimeError, subprocess.SubprocessError) as why:  # no Slurm here: the script cannot be tested
            self.skipTest(f"Slurm does not start here: {why}")
        self.addCleanup(node.stop)

        def submit():
            return node.call(
                "sbatch",
                "--wait",
                "--array=1-2%2",
                "--cpus-per-task=1",
                "--mem=500",
                "--export=ALL",
                f"--output={self.folder}/slurm-%a.log",
                BATCH / "kinevox-array.sbatch",
                check=False,
                SESSIONS=str(listed),
                OUT=str(out),
                KINEVOX=str(BUILD / "client/cli/kinevox"),
                OPTIONS=" ".join(QUICK),
            )

        done = submit()
        logs = "".join(file.read_text() for file in self.folder.glob("slurm-*.log"))
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr + logs)
        self.assertEqual(sorted(p.name for p in out.iterdir()), ["0001-first", "0002-second"])
        before = {p.name: contents(p) for p in out.iterdir()}
        self.assertIn("volume.csv", before["0001-first"])
        self.assertEqual(submit().returncode, 0)
        self.assertEqual(
            {p.name: contents(p) for p in out.iterdir()}, before, "the array submitted again changes nothing"
        )


if __name__ == "__main__":
    BUILD = Path(sys.argv.pop(1)).resolve()
    unittest.main()
