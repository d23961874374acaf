"""Shared by the programs of this folder: one-line errors and atomic files."""
import argparse
import os
import sys
import tempfile


def fail_as(verb):
    """A function that prints one line and ends the program."""

    def fail(message):
        print(f"{verb}: " + " ".join(str(message).split()), file=sys.stderr)
        sys.exit(1)

    return fail


class OneLineParser(argparse.ArgumentParser):
    def error(self, message):
        fail_as(self.prog)(f"{message}; see {self.prog} --help")


def write_atomically(out, write, fail):
    """`write(file)` to a temporary file next to `out`, then renamed."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        handle, temporary = tempfile.mkstemp(dir=out.parent, prefix=out.name + ".", suffix=".part")
        os.close(handle)
        try:
            write(temporary)
            os.chmod(temporary, 0o644)
            os.replace(temporary, out)
        except BaseException:
            os.unlink(temporary)
            raise
    except OSError as error:
        fail(f"{out}: cannot be written: {error.strerror}; check the folder's permissions and free space")


def write_sheet(sheet, out, fail):
    """A page; `out` ends in .png or .pdf."""
    write_atomically(out, lambda temporary: sheet.save(temporary, out.suffix.lower().lstrip(".")), fail)
