#!/usr/bin/python3
"""kinevox process as a job among many: begun again, interrupted, twice at once; by the queue script and by a real Slurm.

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
    """{file: (bytes, time of change)} of a folder; the times that the stages took differ from run to run."""
    return {str(file.relative_to(folder)): (file.read_bytes(), file.stat().st_mtime_ns)
            for file in sorted(folder.rglob("*")) if file.is_file() and file.name != "timing.csv"}


class Batch(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.root = Path(tempfile.mkdtemp(prefix="kinevox-batch-"))
        cls.trials = []
        for name, seed in (("first", 3), ("second", 4)):
            subprocess.run([BUILD / "server/tools/kinevox-studio", "--motion", "walk", "--frames", str(FRAMES), "--cameras", "3",
                            "--size", "160x120", "--background-frames", "20", "--seed", str(seed), "--no-masks",
                            "--out", cls.root / "trials" / name], check=True, capture_output=True)
            cls.trials.append(cls.root / "trials" / name / "session.toml")

    @classmethod
    def tearDownClass(cls):
        shutil.rmtree(cls.root, ignore_errors=True)

    def setUp(self):
        self.folder = Path(tempfile.mkdtemp(prefix="work-", dir=self.root))

    def process(self, trial, out, *more):
        return subprocess.run([BUILD / "server/tools/kinevox-process", trial, "--out", out, *QUICK, *more], capture_output=True,
                              text=True, timeout=120)

    def test_what_is_there_is_not_made_again(self):
        out = self.folder / "out"
        first = self.process(self.trials[0], out, "--resume")
        self.assertEqual(first.returncode, 0, first.stderr)
        before = contents(out)
        self.assertIn("run.toml", before)
        again = self.process(self.trials[0], out, "--resume")
        self.assertEqual(again.returncode, 0, again.stderr)
        self.assertIn("already", again.stdout)
        self.assertEqual(contents(out), before, "not even written again")
        moved = self.folder / "elsewhere"     # copied to another place, with other times
        shutil.copytree(self.trials[0].parent, moved)
        self.assertIn("already", self.process(moved / "session.toml", out, "--resume").stdout)

    def test_other_input_or_options_are_made_again(self):
        out = self.folder / "out"
        self.process(self.trials[0], out)
        for what, trial, more in (("another option", self.trials[0], ["--samples", "16"]),
                                  ("another trial", self.trials[1], ["--samples", "16"])):
            again = self.process(trial, out, "--resume", *more)
            self.assertEqual(again.returncode, 0, again.stderr)
            self.assertNotIn("already", again.stdout, what)
        changed = self.folder / "changed"
        shutil.copytree(self.trials[1].parent, changed)
        calibration = changed / "calibration.toml"
        calibration.write_text(calibration.read_text() + "\n# another\n")
        self.assertNotIn("already", self.process(changed / "session.toml", out, "--resume", "--samples", "16").stdout)

    def test_without_the_last_file_it_is_not_whole(self):
        out = self.folder / "out"
        self.process(self.trials[0], out)
        (out / "run.toml").unlink()
        again = self.process(self.trials[0], out, "--resume")
        self.assertNotIn("already", again.stdout)
        self.assertTrue((out / "run.toml").exists())

    def test_a_killed_one_is_begun_again_and_ends_the_same(self):
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
            if (out / "run.toml").exists():   # a busy machine killed it too late to tell anything
                shutil.rmtree(out)
                continue
            killed += 1
            if killed == 3:
                break
        self.assertEqual(killed, 3, "it was always over before it was killed")
        self.assertEqual(subprocess.run(command).returncode, 0)
        read = lambda folder: {name: text for name, (text, _) in contents(folder).items()}
        self.assertEqual(read(out), read(whole))
        self.assertEqual([p.name for p in out.iterdir() if p.name.startswith(".")], [], "nothing is left aside")

    def test_two_do_not_write_into_one_folder(self):
        out = self.folder / "out"
        command = [BUILD / "server/tools/kinevox-process", self.trials[0], "--out", out, *QUICK, "--quiet"]
        first = subprocess.Popen(command)
        end = time.monotonic() + 30
        while not (out / ".kinevox-partial").exists() and time.monotonic() < end:
            time.sleep(0.005)
        first.send_signal(signal.SIGSTOP)   # in the middle of its work
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

    def test_the_queue_does_all_and_says_which_failed(self):
        listed, out = self.sessions(self.trials[0], self.root / "trials/none/session.toml", self.trials[1]), self.folder / "out"
        environment = dict(os.environ, KINEVOX=str(BUILD / "client/cli/kinevox"))
        run = lambda: subprocess.run([BATCH / "kinevox-queue", listed, out, "2", *QUICK], env=environment, capture_output=True,
                                     text=True, timeout=120)
        first = run()
        self.assertEqual(first.returncode, 1)
        self.assertEqual(sorted(first.stdout.splitlines()), ["first: done", "second: done"])
        self.assertIn("none: failed", first.stderr)
        self.assertIn("none", (out / "0002-none.log").read_text())
        before = contents(out / "0003-second")
        self.assertIn("volume.csv", before)
        run()
        self.assertEqual(contents(out / "0003-second"), before)

    def test_a_real_slurm_runs_the_array(self):
        if why := slurm_node.problem():
            self.skipTest(why)
        listed, out = self.sessions(*self.trials), self.folder / "out"
        node = slurm_node.SlurmNode(self.folder / "node")
        try:
            node.start()
        except (RuntimeError, subprocess.SubprocessError) as why:   # a machine that lets no Slurm run tells nothing of the script
            self.skipTest(f"Slurm does not come up here: {why}")
        self.addCleanup(node.stop)

        def submit():
            return node.call("sbatch", "--wait", "--array=1-2%2", "--cpus-per-task=1", "--mem=500", "--export=ALL",
                             f"--output={self.folder}/slurm-%a.log", BATCH / "kinevox-array.sbatch", check=False,
                             SESSIONS=str(listed), OUT=str(out), KINEVOX=str(BUILD / "client/cli/kinevox"),
                             OPTIONS=" ".join(QUICK))

        done = submit()
        logs = "".join(file.read_text() for file in self.folder.glob("slurm-*.log"))
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr + logs)
        self.assertEqual(sorted(p.name for p in out.iterdir()), ["0001-first", "0002-second"])
        before = {p.name: contents(p) for p in out.iterdir()}
        self.assertIn("volume.csv", before["0001-first"])
        self.assertEqual(submit().returncode, 0)
        self.assertEqual({p.name: contents(p) for p in out.iterdir()}, before, "the array submitted again changes nothing")


if __name__ == "__main__":
    BUILD = Path(sys.argv.pop(1)).resolve()
    unittest.main()
