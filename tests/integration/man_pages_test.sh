#!/usr/bin/env bash
# The manual pages: each verb has one, and groff has nothing to say against any.
# usage: man_pages_test.sh KINEVOX KINEVOXD
set -euo pipefail
command -v help2man >/dev/null && command -v groff >/dev/null || { echo "skipped: help2man or groff is not there"; exit 77; }
out=$(mktemp -d)
trap 'rm -rf "$out"' EXIT
"$(dirname "$0")/../../client/cli/man/make-man-pages" "$out" 9.8.7 "$1" "$2"
for page in kinevox.1 kinevoxd.8 kinevox-status.1 kinevox-record-start.1 kinevox-replay-open.1 kinevox-process.1 kinevox-stream-angles.1; do
    [ -s "$out/$page" ] || { echo "FAIL: $page is missing"; exit 1; }
done
grep -q 'codec' "$out/kinevox-record-start.1" || { echo "FAIL: kinevox-record-start.1 does not know --codec"; exit 1; }
grep -q '9.8.7' "$out/kinevoxd.8" || { echo "FAIL: kinevoxd.8 does not say its version"; exit 1; }
if grep -l "$1" "$out"/*; then echo "FAIL: a path of the build is in these"; exit 1; fi
for page in "$out"/*; do
    said=$(groff -man -ww -z -Tutf8 "$page" 2>&1)
    [ -z "$said" ] || { echo "FAIL: $(basename "$page"): $said"; exit 1; }
done
echo "$(find "$out" -type f | wc -l) pages"
