"""What the programs of this folder share: one-line errors, and files that are whole or not there."""
import argparse
import os
import sys
import tempfile


def fail_as(verb):
    """What prints one line and ends the program."""
    def fail(message):
        print(f"{verb}: " + " ".join(str(message).split()), file=sys.stderr)
        sys.exit(1)
    return fail


class OneLineParser(argparse.ArgumentParser):
    def error(self, message):
        fail_as(self.prog)(f"{message}; see {self.prog} --help")


def write_aside(out, write, fail):
    """`write(file)` beside `out`, then renamed."""
    try:
        out.parent.mkdir(parents=True, exist_ok=True)
        handle, aside = tempfile.mkstemp(dir=out.parent, prefix=out.name + ".", suffix=".part")
        os.close(handle)
        try:
            write(aside)
            os.chmod(aside, 0o644)
            os.replace(aside, out)
        except BaseException:
            os.unlink(aside)
            raise
    except OSError as error:
        fail(f"{out}: cannot be written: {error.strerror}; check the folder's permissions and free space")


def write_sheet(sheet, out, fail):
    """A page; `out` ends in .png or .pdf."""
    write_aside(out, lambda aside: sheet.save(aside, out.suffix.lower().lstrip(".")), fail)
