#!/usr/bin/env python3
"""Reports words and identifiers that docs/vocabulary.md, section 2.1, refuses.   usage: words.py [PATH ...]

PATH: files or folders of the checkout (default: all tracked files). Exceptions with their reasons: word_exceptions.txt.
Prints FILE:LINE: 'WORD' for each place. Exit status: 0 no refused word, 1 some.
"""
import fnmatch
import pathlib
import re
import sys

import checkout
from checkout import ROOT

EXCEPTIONS = pathlib.Path(__file__).with_name("word_exceptions.txt")

WORDS = [
    r"tells?",
    "told",
    "anew",
    r"mends?",
    "mended",
    r"knock(?:s|ed)?",
    r"things?",
    "aside",
    "somebody",
    "nobody",
    "whoever",
    "so many",
    "so long",
    "left out",
    "made by",
    "goes on",
    "go on",
    "one's own",
    "for the moment",
    "at best",
    "let in",
    "himself",
    "he",
    "his",
    "him",
    r"lens(?:es)?",
    "places",
    r"moments?",
    r"sightings?",
    "beat",
    "remark",
    "film",
    "agreement",
    r"agrees?",
    r"reach(?:es)?",
    "straighten",
    "by so much",
    "how far it is",
]
CASE_SENSITIVE_WORDS = ["CARE"]
IDENTIFIERS = [
    r"\bk(?:Most|Fewest|Least|Longest|Shortest|Largest|Smallest)(?![a-z])\w*",
    r"\b(?:most|least|fewest|longest|shortest)_\w+",
    r"\b\w+_(?:part|share)_?\b",
    r"\btell_?\(",
    r"\w*anew\w*",
    r"\b(?:\w*_)?knock\w*",
    r"\b\w*Knock\w*",
    r"\b(?:\w+_)?things?_\w*",
    r"\b(?:\w+_)?reach(?:_\w*)?\b",
    r"\bk\w*Reach\w*",
    r"\b\w+_turn_\w+",
    r"(?<![Ss]tandard )(?<!^)\b\w*deviations?\w*",
    r"\b\w*sightings?\w*",
    r"\b\w*Sightings?\w*",
    r"\bk(?:Lowest|Highest|Narrowest|Widest)(?![a-z])\w*",
    r"\b(?:\w+_)?turn(?:ed)?_(?:deg|rad)\b",
    r"\b(?:\w+_)?miss_px\b",
    r"\bLens(?:es)?(?=[A-Z])\w*",
    r"\b\w*(?:Told|Anew|Nobody|Somebody|Whoever)\w*",
]
TEXT = re.compile(
    "|".join([r"(?<![\w-])(?i:" + "|".join(WORDS) + r")(?!\w)", r"\b(?:" + "|".join(CASE_SENSITIVE_WORDS) + r")\b"])
)
IDENTIFIER = re.compile("|".join(IDENTIFIERS))
CODE = (
    ".cc",
    ".h",
    ".cu",
    ".cuh",
    ".py",
    ".ts",
    ".mjs",
    ".js",
    ".proto",
    ".toml",
    ".cmake",
    ".sh",
    ".json",
    ".html",
    ".css",
)
SKIPPED = (".png", ".gif", ".apng", ".svg", ".woff2", ".lock", ".bin", ".seed")


def exceptions():
    """Rows of word_exceptions.txt: path pattern, word or phrase around it (a regular expression), reason."""
    rows = []
    for number, line in enumerate(EXCEPTIONS.read_text().splitlines(), 1):
        if not line.strip() or line.startswith("#"):
            continue
        cells = [cell.strip() for cell in line.split("|")]
        if len(cells) != 3 or not all(cells):
            sys.exit(f"{EXCEPTIONS.name}:{number}: expected 'PATH | WORD | REASON'")
        rows.append((cells[0], re.compile(cells[1], re.IGNORECASE)))
    return rows


def covers(pattern, line, match):
    """Whether an exception's pattern, a word or a phrase around it, covers the match."""
    return any(phrase.start() <= match.start() and phrase.end() >= match.end() for phrase in pattern.finditer(line))


def refused(path, text, rows):
    """Yields (line number, word) for each refused word that no exception covers."""
    allowed = [word for pattern, word in rows if fnmatch.fnmatch(path, pattern)]
    is_code = path.endswith(CODE)
    for number, line in enumerate(text.splitlines(), 1):
        found = list(TEXT.finditer(line))
        if is_code:
            found += IDENTIFIER.finditer(line)
        words = dict.fromkeys(
            match[0] for match in found if not any(covers(pattern, line, match) for pattern in allowed)
        )
        yield from ((number, word) for word in words)


def main():
    rows = exceptions()
    count = 0
    for name in checkout.files(*sys.argv[1:]):
        if name.endswith(SKIPPED):
            continue
        try:
            text = (ROOT / name).read_text()
        except UnicodeDecodeError:
            continue
        for number, word in refused(name, text, rows):
            print(f"{name}:{number}: '{word}'")
            count += 1
    if count:
        print(f"{count} refused words; docs/vocabulary.md, section 2, names the ones to use", file=sys.stderr)
    return 1 if count else 0


if __name__ == "__main__":
    sys.exit(main())
