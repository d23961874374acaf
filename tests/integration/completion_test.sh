#!/usr/bin/env bash
# bash completion of the kinevox command. usage: completion_test.sh KINEVOX
set -uo pipefail
kinevox=$1
export KINEVOX_SERVER=127.0.0.1:1   # no daemon there
# shellcheck source=/dev/null
source "$(dirname "$0")/../../client/cli/completion/kinevox"
failed=0

# expect WANTED WORD...: completes the last word; WANTED: words that are offered, or with ! before them, that are not.
expect() {
    local wanted=$1
    shift
    COMP_WORDS=("$kinevox" "$@") COMP_CWORD=$#
    COMPREPLY=()
    _kinevox
    local word
    for word in $wanted; do
        if [[ $word == !* ]]; then
            [[ " ${COMPREPLY[*]} " != *" ${word#!} "* ]] && continue
        else
            [[ " ${COMPREPLY[*]} " == *" $word "* ]] && continue
        fi
        echo "FAIL: kinevox $* offers '${COMPREPLY[*]}', expected: $word"
        failed=1
    done
}

expect "status stop start stream studio !record !cameras" st
expect "record replay report" re
expect "start stop save export status list delete" record ""
expect "--codec --operator --server --json !--help-all" record start --
expect "start list show convert intrinsics check" calibrate ""
expect "ffv1 utvideo h264" record start --codec ""
expect "ffv1 !h264" record start --codec f
expect "angles joints coordinates volumes" stream ""
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
touch "$folder/session.toml"
expect "$folder/session.toml" process "$folder/ses"
expect "$folder/session.toml" export --out "$folder/s"
[ "$failed" = 0 ] && echo "completion: passed"
exit "$failed"
