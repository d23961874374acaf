#!/usr/bin/env python3
"""Checks deploy/gpu-proof without a GPU: the pack is complete, every step works on the emulator, and the output of tools that
only a GPU machine has is read correctly.   usage: gpu_proof_test.py PROGRAMS     the folder of the emulated programs
"""
import pathlib
import subprocess
import sys
import tarfile
import tempfile
import unittest

ROOT = pathlib.Path(__file__).resolve().parent.parent.parent
sys.path.insert(0, str(ROOT / "tests/bench"))

import gpu_proof_parsers as parsers  # noqa: E402
import gpu_proof_steps  # noqa: E402

PROGRAMS = None

TESTS = """[ RUN      ] Cuda.First
kernels/tests/cuda_test.cc:80: Failure
[  FAILED  ] Cuda.First (12 ms)
[  FAILED  ] Shapes/CudaHull.EqualsCpuForm/four, where GetParam() = 40-byte object (3 ms)
[==========] 169 tests from 20 test suites ran. (5000 ms total)
[  PASSED  ] 167 tests.
[  SKIPPED ] 1 test, listed below:
[  SKIPPED ] CudaAbsent.ErrorNamesCauseAndRemedy
[  FAILED  ] 2 tests, listed below:
[  FAILED  ] Cuda.First
[  FAILED  ] Shapes/CudaHull.EqualsCpuForm/four, where GetParam() = 40-byte object
"""
MEMCHECK = "========= COMPUTE-SANITIZER\n========= Invalid __global__ write\n========= ERROR SUMMARY: 2 errors\n"
RACECHECK = "========= COMPUTE-SANITIZER\n========= RACECHECK SUMMARY: 1 hazard displayed (1 error, 0 warnings)\n"
NCU = """==PROF== Connected to process 42 (frame_set)
0\t1.2\t0.3\t0.8
"ID","Process ID","Kernel Name","Context","dram__throughput.avg.pct_of_peak_sustained_elapsed","gpu__time_duration.sum","launch__registers_per_thread","sm__warps_active.avg.pct_of_peak_sustained_active"
"","","","","%","nsecond","register/thread","%"
"0","42","void kinevox::kernels::cuda::light_kernel<3>(Data, Rect)","1","10","2,000","40","50"
"1","42","void kinevox::kernels::cuda::light_kernel<3>(Data, Rect)","1","20","4,000","40","80"
"2","42","kinevox::kernels::cuda::<unnamed>::splat(View *, int)","1","1.5","1,500","24","12.5"
"""


class Parsers(unittest.TestCase):
    def test_counts_tests_and_names_failed_ones(self):
        counts = parsers.test_counts(TESTS)
        self.assertEqual((counts["executed"], counts["failed"], counts["skipped"]), (169, 2, 1))
        self.assertEqual(counts["failed_names"], ["Cuda.First", "Shapes/CudaHull.EqualsCpuForm/four"])
        with self.assertRaises(ValueError):
            parsers.test_counts("Segmentation fault")

    def test_counts_findings_of_sanitizers(self):
        self.assertEqual(parsers.sanitizer_findings(MEMCHECK), 2)
        self.assertEqual(parsers.sanitizer_findings(RACECHECK), 1)
        with self.assertRaises(ValueError):
            parsers.sanitizer_findings("Error: Target application terminated")

    def test_sorts_kernels_by_time(self):
        rows = parsers.kernels(NCU, gpu_proof_steps.NCU_METRICS, 2)
        self.assertEqual([row["name"] for row in rows], ["light_kernel", "splat"])
        self.assertEqual((rows[0]["launches"], rows[0]["us"], rows[0]["occupancy"]), (1, 3.0, 70.0))


class DeviceNames(unittest.TestCase):
    def test_only_gpus_are_accepted(self):
        for name in ("cuda", "cuda:0", "cuda:12"):
            self.assertTrue(gpu_proof_steps.is_gpu(name), name)
        for name in ("", "cpu", "1", "cuda:", "cuda:-1", "cuda:01", "cuda:1000"):
            self.assertFalse(gpu_proof_steps.is_gpu(name), name)
        process = subprocess.run(
            [ROOT / "deploy/gpu-proof", "--device", "gpu1"], capture_output=True, text=True, check=False
        )
        self.assertEqual(process.returncode, 2)
        self.assertIn("--device is 'gpu1'; use cuda or cuda:N", process.stderr)


class WholeProof(unittest.TestCase):
    def test_every_step_passes_on_the_emulator_from_an_unpacked_pack(self):
        with tempfile.TemporaryDirectory() as folder:
            folder = pathlib.Path(folder)
            subprocess.run([ROOT / "deploy/gpu-proof", "--pack", folder / "pack.tar.gz"], check=True)
            with tarfile.open(folder / "pack.tar.gz") as archive:
                archive.extractall(folder)
            command = [
                folder / "gpu-proof/deploy/gpu-proof",
                "--emulate",
                "--device",
                "cuda:1",
                "--programs",
                PROGRAMS,
                "--out",
                folder / "out",
            ]
            process = subprocess.run(command, capture_output=True, text=True, check=False)
            self.assertEqual(process.returncode, 0, process.stdout + process.stderr)
            table = (folder / "out/emulator.md").read_text()
            self.assertIn("`deploy/gpu-proof` on cuda:1,", table)
            for step in ("tests", "exact", "stages"):
                self.assertIn("cuda:1", (folder / f"out/{step}.log").read_text(), step)
            for part in (
                "| kernel tests that fail | 0 | - | 0 | PASS |",
                "## CPU against CUDA",
                "colouring |",
                "## Card",
            ):
                self.assertIn(part, table)
            self.assertNotIn("could not be executed", table)


if __name__ == "__main__":
    PROGRAMS = pathlib.Path(sys.argv.pop(1)).resolve()
    unittest.main()
