"""Shared by the Python programs of `kinevox`: one-line errors, progress on a terminal, atomic files."""
import argparse
import difflib
import os
import sys
import tempfile


def fail_as(verb):
    """A function that prints one line and ends the program."""

    def fail(message):
        show_progress("")
        print(f"{verb}: " + " ".join(str(message).split()), file=sys.stderr)
        sys.exit(1)

    return fail


class OneLineParser(argparse.ArgumentParser):
    """Options are spelled out; a mistyped one gets a suggestion."""

    def __init__(self, **more):
        super().__init__(
            allow_abbrev=False,
            epilog="Exit status: 0 on success, 1 on any error, with one line on standard error.",
            **more,
        )

    def parse_args(self, args=None, namespace=None):
        known = [option for option in self._option_string_actions if option.startswith("--")]
        for word in sys.argv[1:] if args is None else args:  # before argparse asks for what else is missing
            option = word.split("=")[0]
            if option == "--":
                break
            if option.startswith("--") and option not in known:
                close = difflib.get_close_matches(option, known, 1)
                self.error(f"unknown option '{option}'" + (f"; did you mean '{close[0]}'?" if close else ""))
        return super().parse_args(args, namespace)

    def error(self, message):
        fail_as(self.prog)(f"{message}{'' if message.endswith('?') else ';'} see {self.prog} --help")


def show_progress(text):
    """Replaces the progress line; "" clears it. Only on a terminal."""
    if sys.stderr.isatty():
        print(f"\r\033[K{text}", end="", file=sys.stderr, flush=True)


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
