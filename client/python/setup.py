"""Makes the API's messages from proto/ with protoc while building; everything else is in pyproject.toml."""
import shutil
import subprocess
import sys
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py

PROTO = Path(__file__).resolve().parent.parent.parent / "proto"


class BuildWithMessages(build_py):
    """Adds kinevox/v1 to what is built."""

    def run(self):
        super().run()
        protoc = shutil.which("protoc")
        if protoc is None:
            sys.exit("kinevox: protoc is missing; install protobuf-compiler")
        if not PROTO.is_dir():
            sys.exit(f"kinevox: {PROTO} is missing; install from client/python of the whole repository")
        files = sorted(str(file.relative_to(PROTO)) for file in PROTO.glob("kinevox/v1/*.proto"))
        out = Path(__file__).resolve().parent if self.editable_mode else Path(self.build_lib)
        subprocess.run([protoc, "-I", str(PROTO), f"--python_out={out}", f"--pyi_out={out}", *files], check=True)


setup(cmdclass={"build_py": BuildWithMessages})
