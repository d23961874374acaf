"""How the tests run a program on the emulator: in every order of threads, with several contents of fresh memory, with work
done as late as allowed, and with device memory closed to the host."""
import os
import subprocess

SETTINGS = [
    {},
    {"ORDER": "reverse"},
    {"ORDER": "random:1"},
    {"ORDER": "random:2"},
    {"POISON": "0"},
    {"POISON": "255"},
    {"DEFERRED": "1"},
    {"GUARDED": "1"},
]


def name(settings):
    return ", ".join(f"{key.lower()} {value}" for key, value in settings.items()) or "default"


def run(command, settings):
    """The finished process, with its output as text."""
    environment = dict(os.environ, ASAN_OPTIONS="detect_leaks=0", UBSAN_OPTIONS="halt_on_error=1")
    environment.update({f"KINEVOX_EMULATOR_{key}": value for key, value in settings.items()})
    return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)


def problem(process):
    """The first line of what the emulator or a sanitizer reports; None if nothing."""
    for line in process.stderr.splitlines():
        if line.startswith("CUDA emulator:") or "ERROR: AddressSanitizer" in line or "runtime error:" in line:
            return line
    if process.returncode < 0:
        return f"ended by signal {-process.returncode}"
    return None
