"""A Python program whose imports, most of its time, are done once: each run is a fork of this process."""
import importlib.machinery
import importlib.util
import os
import subprocess
import sys
import tempfile
import traceback
from pathlib import Path


class ForkedProgram:
    """`file` with a main(); `modules` are those it imports when it needs them."""

    def __init__(self, file, modules):
        loader = importlib.machinery.SourceFileLoader("forked_program", str(file))
        self.program = importlib.util.module_from_spec(importlib.util.spec_from_loader(loader.name, loader))
        loader.exec_module(self.program)
        for module in modules:
            importlib.import_module(module)
        self.name = Path(file).name

    def run(self, *arguments):
        """As of subprocess.run with capture_output and text."""
        words = [self.name, *map(str, arguments)]
        with tempfile.TemporaryFile() as output, tempfile.TemporaryFile() as errors:
            sys.stdout.flush(), sys.stderr.flush()
            child = os.fork()
            if child == 0:
                os.dup2(output.fileno(), 1)
                os.dup2(errors.fileno(), 2)
                os._exit(self._status(words))
            status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
            texts = []
            for file in (output, errors):
                file.seek(0)
                texts.append(file.read().decode())
        return subprocess.CompletedProcess(words, status, *texts)

    def _status(self, words):
        """The exit status of main(), as the interpreter's."""
        sys.stdout, sys.stderr = open(1, "w", closefd=False), open(2, "w", closefd=False)
        sys.argv = words
        status = 0
        try:
            self.program.main()
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else int(end.code is not None)
        except BaseException:
            traceback.print_exc()
            status = 1
        sys.stdout.flush(), sys.stderr.flush()
        return status
