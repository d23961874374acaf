#!/usr/bin/env bash
# The manual pages: one per command, without groff warnings.
# usage: man_pages_test.sh KINEVOX KINEVOXD
set -euo pipefail
command -v help2man >/dev/null && command -v groff >/dev/null || { echo "skipped: help2man or groff is not installed"; exit 77; }
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
"$(dirname "$0")/../../client/cli/man/make-man-pages" "$out" 9.8.7 "$1" "$2"
for page in kinevox.1 kinevoxd.8 kinevox-status.1 kinevox-record-start.1 kinevox-record-export.1 kinevox-replay-open.1 kinevox-process.1 \
    kinevox-stream-angles.1 kinevox-calibrate-check.1; do
    [ -s "$out/$page" ] || { echo "FAIL: $page is missing"; exit 1; }
done
grep -q 'codec' "$out/kinevox-record-start.1" || { echo "FAIL: kinevox-record-start.1 lacks --codec"; exit 1; }
grep -q 'EXIT STATUS' "$out/kinevox-record-start.1" || { echo "FAIL: kinevox-record-start.1 lacks the exit status"; exit 1; }
[ "$(grep -ci 'exit status' "$out/kinevox-doctor.1")" = 1 ] && grep -q '^0 without an ERROR' "$out/kinevox-doctor.1" ||
    { echo "FAIL: kinevox-doctor.1 has another exit status than its --help"; exit 1; }
grep -q '9.8.7' "$out/kinevoxd.8" || { echo "FAIL: kinevoxd.8 lacks its version"; exit 1; }
if grep -l "$1" "$out"/*; then echo "FAIL: these contain a path of the build"; exit 1; fi
for page in "$out"/*; do
    warnings=$(groff -man -ww -z -Tutf8 "$page" 2>&1)
    [ -z "$warnings" ] || { echo "FAIL: $(basename "$page"): $warnings"; exit 1; }
done
echo "$(find "$out" -type f | wc -l) pages"
