"""The steps of deploy/gpu-proof. Each returns what it measured: rows for the table, and numbers that goals name."""
import concurrent.futures
import datetime
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import time

import gpu_proof_parsers as parsers

TOTAL_LIMIT_S = 580
FAMILIES = {  # name of the benchmarks: pattern
    "frame sets": "^frame_set/.*width:(640|1920)",
    "hull": "^BM_Hull",
    "colouring": "^BM_Colouring",
    "segmentation": "^segment_",
    "projection": "^BM_Projection",
    "body silhouettes": "^render_",
    "moments": "^moments_of",
}
FRAME_SET = ["4", "640", "480", "10"]  # cameras, width, height, mm: the size that goals name
SANITIZERS = ("memcheck", "initcheck", "racecheck", "synccheck")
NCU_METRICS = {
    "gpu__time_duration.sum": "time",
    "launch__registers_per_thread": "registers",
    "sm__warps_active.avg.pct_of_peak_sustained_active": "occupancy",
    "dram__throughput.avg.pct_of_peak_sustained_elapsed": "dram",
}


def commit_of(root):
    """The commit of a checkout or of an unpacked pack."""
    if (root / "commit").is_file():
        return (root / "commit").read_text().strip()
    process = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=root, capture_output=True, text=True, check=False
    )
    return process.stdout.strip() or "unknown"


def is_gpu(device):
    """Whether this names a GPU: cuda, which is the first one, or cuda:N."""
    return re.fullmatch(r"cuda(:(0|[1-9][0-9]{0,2}))?", device) is not None


def query_gpus(fields):
    """Values that nvidia-smi reports, a list per GPU in the order of their PCI addresses."""
    if not shutil.which("nvidia-smi"):
        return []
    command = ["nvidia-smi", f"--query-gpu={','.join(fields)}", "--format=csv,noheader"]
    process = subprocess.run(command, capture_output=True, text=True, check=False)
    lines = process.stdout.splitlines() if process.returncode == 0 else []
    return [[cell.strip() for cell in line.split(",")] for line in lines]


def cpu_name():
    """The processor's model name."""
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        names = [line.split(":", 1)[1].strip() for line in file if line.startswith("model name")]
    return names[0] if names else "unknown"


class StepError(Exception):
    """A step that could not be executed; the message says why."""


class Proof:
    """Executes the steps in order and keeps their results in `out`."""

    def __init__(self, root, out, emulate, quick, programs, only, device="cuda:0"):
        """Raises StepError if there are GPUs, but not this one."""
        gpus = query_gpus(["name", "compute_cap", "pci.bus_id"])
        self.root, self.out, self.quick, self.programs = root, out.resolve(), quick, programs
        self.emulated = emulate or not gpus
        self.gpu = int(device.partition(":")[2] or 0)
        self.device = f"cuda:{self.gpu}"
        if not self.emulated and self.gpu >= len(gpus):
            raise StepError(f"there is no {self.device}; nvidia-smi lists {len(gpus)} GPUs, from cuda:0 on")
        facts = ["emulator", "9.0", None] if self.emulated else gpus[self.gpu]
        self.card, self.bus_id = facts[0], facts[2]
        self.architecture = None if self.emulated else facts[1].replace(".", "")
        self.build = root / "build/gpu-proof"
        self.begin = time.monotonic()
        self.problems = []
        self.only = only  # steps to execute; empty: all
        self.log = None
        self.result_file = None
        self.deadline = 0
        self.limit_s = 0

    def run(self):
        """All steps; a step that fails does not stop the next one, unless nothing was built."""
        steps = [
            ("build", 200, self.step_build),
            ("facts", 30, self.step_facts),
            ("tests", 90, self.step_tests),
            ("exact", 60, self.step_exact),
            ("calls", 60, self.step_calls),
            ("stages", 100 if self.quick else 200, self.step_stages),
        ]
        if not self.emulated:
            steps += [("sanitizers", 120, self.step_sanitizers), ("profile", 60, self.step_profile)]
        if self.only:
            steps = [step for step in steps if step[0] in self.only]
        elif self.quick:
            steps = [step for step in steps if step[0] not in ("sanitizers", "profile")]
        self.out.mkdir(parents=True, exist_ok=True)
        if not self.only:
            for result in self.out.glob("*.json"):
                result.unlink()
        for name, limit_s, step in steps:
            if not self.execute(name, limit_s, step) and name == "build":
                break

    def execute(self, name, limit_s, step):
        """One step; False if it could not be executed."""
        begin = time.monotonic()
        self.limit_s = min(limit_s, TOTAL_LIMIT_S - (begin - self.begin))
        self.deadline = begin + self.limit_s
        self.result_file = self.out / f"{name}.json"
        result, problem = {"problem": "not finished", "seconds": 0}, None
        with open(self.out / f"{name}.log", "w", encoding="utf-8") as self.log:
            try:
                step(result)
            except (StepError, OSError, ValueError, KeyError, IndexError) as error:
                problem = f"{type(error).__name__}: {error}" if not isinstance(error, StepError) else str(error)
                self.problems.append(f"{name}: {problem}")
        result["problem"] = problem
        result["seconds"] = time.monotonic() - begin
        self.save(result)
        print(
            f"gpu-proof: {name}, {result['seconds']:.1f} s{', ' + problem if problem else ''}",
            file=sys.stderr,
            flush=True,
        )
        return problem is None

    def save(self, result):
        """Writes what a step has measured so far."""
        self.result_file.write_text(json.dumps(result, indent=1))

    def command(self, arguments, limit_s=None, check=True, **environment):
        """Output of a command, which is also logged. Raises StepError if it fails or takes too long."""
        arguments = [str(argument) for argument in arguments]
        left_s = max(1.0, self.deadline - time.monotonic())
        name = pathlib.Path(arguments[0]).name
        shown = " ".join([*(f"{key}={value}" for key, value in environment.items()), *arguments])
        timeout_s = min(left_s, limit_s or left_s)
        with subprocess.Popen(
            arguments,
            env={**os.environ, "CUDA_DEVICE_ORDER": "PCI_BUS_ID", **environment},  # nvidia-smi's indices
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,  # so that its children end with it
        ) as process:
            try:
                output, _ = process.communicate(timeout=timeout_s)
            except subprocess.TimeoutExpired as error:
                os.killpg(process.pid, signal.SIGKILL)
                output, _ = process.communicate()
                self.log.write(f"$ {shown}\n{output}\n(time limit)\n")
                raise StepError(f"{name} took longer than {timeout_s:.0f} s") from error
        self.log.write(f"$ {shown}\n{output}\n(status {process.returncode})\n")
        self.log.flush()
        if check and process.returncode != 0:
            last = output.strip().splitlines()[-1:] or ["no output"]
            raise StepError(f"{name} ended with status {process.returncode}: {last[0][:300]}")
        return output

    def program(self, name):
        """Path of a built program: its CUDA form, or the emulated one."""
        emulated = {
            "kernels_test": "emulated_kernels_test",
            "kernels_bench": "emulated_kernels_bench",
            "cuda_results": "cuda_results_plain",
            "card_rates": "emulated_card_rates",
        }
        if self.emulated:
            name = emulated.get(name, name)
        for folder in (self.programs, self.build, self.build / "cuda"):
            if folder and (folder / name).is_file():
                return folder / name
        raise StepError(f"{name} was not built")

    def step_build(self, result):
        """Configures, and builds what the steps need. With --programs only configures."""
        result["date"] = datetime.date.today().isoformat()
        result["commit"] = commit_of(self.root)
        result["card"] = self.card
        result["device"] = self.device + (f" ({self.bus_id})" if self.bus_id else "")
        result["cpu"] = f"{os.cpu_count()} CPU cores ({cpu_name()})"
        arguments = ["cmake", "-S", self.root / "kernels", "-B", self.build, "-DCMAKE_BUILD_TYPE=Release"]
        arguments += ["-G", "Ninja"] if shutil.which("ninja") else []
        libraries = self.root / "third_party"
        if libraries.is_dir():
            configs = libraries / "usr/lib/x86_64-linux-gnu/cmake"
            arguments += [f"-D{name}_DIR={configs / name}" for name in ("TBB", "benchmark", "hwy")]
            arguments += [f"-DKINEVOX_GTEST_SOURCE={libraries / 'googletest'}"]
        targets = ["emulated_frame_set", "cuda_results_plain"]
        if self.emulated:
            arguments += ["-DKINEVOX_CUDA=OFF"]
            targets += ["emulated_kernels_test", "emulated_kernels_bench", "emulated_card_rates"]
        else:
            arguments += ["-DKINEVOX_CUDA=ON", f"-DCMAKE_CUDA_ARCHITECTURES={self.architecture}-real"]
            targets += ["kernels_test", "kernels_bench", "cuda_results", "frame_set", "card_rates"]
        self.command(arguments, limit_s=60)
        if not self.programs:
            jobs = os.cpu_count() or 1
            self.command(["cmake", "--build", self.build, "-j", jobs, "--target", *targets])

    def step_facts(self, result):
        """The card, and the rates of its memory, bus and driver."""
        if not self.emulated:
            fields = ["driver_version", "memory.total", "clocks.max.sm", "clocks.max.memory", "pcie.link.gen.max"]
            result["facts"] = list(zip(fields, query_gpus(fields)[self.gpu]))
        result["rates"] = parsers.tab_rows(
            self.command([self.program("card_rates"), *(["1", "3"] if self.emulated else ["256", "500"]), self.gpu])
        )

    def step_tests(self, result):
        """All kernel tests; on the emulator a few, since cuda_emulation_test executes the others."""
        arguments = [self.program("kernels_test"), "--gtest_brief=1"]
        if self.emulated:
            arguments += ["--gtest_filter=CudaMoments*"]
        output = self.command(arguments, check=False, KINEVOX_REQUIRE_GPU="1", KINEVOX_TEST_DEVICE=self.device)
        result.update(parsers.test_counts(output))
        result["measures"] = {"tests failed": result["failed"]}

    def step_exact(self, result):
        """CPU against CUDA form, and the card against the emulator, by the hashes of all results."""
        small = ["80", "60", "40", "2"] if self.emulated else ["160", "120", "25", "4"]
        sizes = [small] if self.emulated else [small, ["640", "480", "10", "4"]]
        sizes += [] if self.emulated or self.quick else [["1920", "1080", "8", "2"]]
        emulator = self.program("cuda_results_plain")
        expected = parsers.results(self.command([emulator, *small], check=False))
        rows = []
        for size in sizes:
            for row in parsers.results(self.command([self.program("cuda_results"), *size, self.device], check=False)):
                row["size"] = " x ".join(size[:2]) + f", {size[2]} mm"
                if size == small:
                    row["emulator"] = next(e["cuda_hash"] for e in expected if e["stage"] == row["stage"])
                rows.append(row)
        result["rows"] = rows
        same_method = [row for row in rows if row["stage"] not in ("body silhouettes", "moments")]
        result["measures"] = {
            "values different": sum(row["different"] for row in same_method),
            "stages different from emulator": sum(
                row.get("emulator", row["cuda_hash"]) != row["cuda_hash"] for row in rows
            ),
        }

    def step_calls(self, result):
        """What a frame set asks of CUDA's runtime, counted by the emulator."""
        last = self.command([self.program("emulated_frame_set"), *FRAME_SET, "3"]).split("\n")[-2].split("\t")
        launches, copies, waits, uploaded, downloaded = map(int, last[1:])
        raw = 3 * int(FRAME_SET[0]) * int(FRAME_SET[1]) * int(FRAME_SET[2])
        result["measures"] = {
            "launches": launches,
            "copies": copies,
            "waits": waits,
            "upload ratio": uploaded / raw,
            "uploaded_mb": uploaded / 1e6,
            "downloaded_mb": downloaded / 1e6,
        }

    def step_stages(self, result):
        """Median and 99th percentile of each stage on the CPU and on the card."""
        result["rows"], result["measures"] = [], {}
        families = {"frame sets": "^frame_set/.*width:160"} if self.emulated else FAMILIES
        problems = []
        for family, pattern in families.items():
            times = {}
            for device in ("cpu", "cuda"):
                target = self.out / "benchmark.json"
                seconds = 0.001 if self.emulated else 0.05 if self.quick else 0.3
                arguments = [
                    self.program("kernels_bench"),
                    f"--benchmark_filter={pattern}",
                    f"--benchmark_min_time={seconds}",
                ]
                try:
                    self.command(
                        [*arguments, f"--benchmark_out={target}"],
                        KINEVOX_BENCH_DEVICE=self.device if device == "cuda" else device,
                    )
                    times[device] = parsers.benchmarks(target.read_text())
                except StepError as error:
                    problems.append(f"{family} on {device}: {error}")
            rows = parsers.joined(times.get("cpu", {}), times.get("cuda", {}))
            result["rows"] += rows
            for row in rows:
                if "cuda_median_us" in row:
                    result["measures"][f"{row['name']} median_ms"] = row["cuda_median_us"] / 1e3
                    result["measures"][f"{row['name']} p99_ratio"] = row["cuda_p99_us"] / row["cuda_median_us"]
            self.save(result)
        if problems:
            raise StepError("; ".join(problems))

    def step_sanitizers(self, result):
        """compute-sanitizer's tools on a small run of all stages, at the same time."""
        if not shutil.which("compute-sanitizer"):
            raise StepError("compute-sanitizer is not installed")
        program = [self.program("cuda_results"), "96", "72", "40", "2", self.device]

        def findings(tool):
            arguments = ["compute-sanitizer", "--tool", tool, "--print-limit", "10", *program]
            return parsers.sanitizer_findings(self.command(arguments, check=False))

        with concurrent.futures.ThreadPoolExecutor() as pool:
            result["rows"] = list(zip(SANITIZERS, pool.map(findings, SANITIZERS)))
        result["measures"] = {"sanitizer findings": sum(count for _, count in result["rows"])}

    def step_profile(self, result):
        """The ten kernels on which a frame set spends most time, by Nsight Compute."""
        if not shutil.which("ncu"):
            raise StepError("ncu is not installed")
        frames = 3
        arguments = ["ncu", "--clock-control", "none", "--csv", "--page", "raw", "--print-units", "base"]
        arguments += ["--metrics", ",".join(NCU_METRICS), self.program("frame_set"), *FRAME_SET, frames, self.device]
        result["rows"] = parsers.kernels(self.command(arguments), NCU_METRICS, frames)[:10]
