#!/usr/bin/env bash
# Counts instructions per frame on ARMv7, by stage, under qemu-arm. The count is exact, so a loop that became longer is visible at once.
#
#   count.sh HEMILUX-SIM            counts the cases of baseline.txt and fails if a case takes over 3 % more
#   count.sh HEMILUX-SIM --write    replaces baseline.txt; `cargo test -p hemilux-sim --test all counts` then names the rows to change in READMEs
#
# HEMILUX-SIM is a release build for armv7-unknown-linux-gnueabihf with NEON. Needs qemu-user, gcc and binutils for ARM.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
sim=$(realpath "$1")
baseline=$here/baseline.txt
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

gcc -shared -fPIC -O2 -o "$work/count.so" "$here/count.c"

arm-linux-gnueabihf-nm -CS --defined-only "$sim" >"$work/symbols"

# A function belongs to the stage of its module; functions that stages share belong to `other`.
{
    code=$(arm-linux-gnueabihf-readelf -lW "$sim" | awk '$1 == "LOAD" && / R E / && !n++ { print substr($3, 3) }')
    frame=$(awk '/hemilux_core::front::add_up$/ { print $1; exit }' "$work/symbols")
    [ -n "$frame" ] || { echo "count.sh: $sim: found no hemilux_core::front::add_up, expected the function that begins a frame" >&2; exit 1; }
    printf 'code %s frame %x\n' "$code" $((0x$frame & ~1))
    awk '$3 ~ /^[tTwW]$/ {
        name = substr($0, index($0, $4)); stage = ""
        if (name ~ /sampler::/) stage = "sample"
        else if (name ~ /hemilux_core::(pyramid|window|lanes|extrapolation|polar)/) stage = "pyramid"
        else if (name ~ /hemilux_core::(front|merge|response)/) stage = "front"
        if (stage != "") print $1, $2, stage
    }' "$work/symbols" | python3 -c 'import sys
for start, size, stage in sorted((int(a, 16) & ~1, int(b, 16), c) for a, b, c in map(str.split, sys.stdin)):
    print(f"{start:x} {start + size:x} {stage}")'
} >"$work/table"

# count NAME: writes a line, instructions per frame of the case NAME, to $work/NAME.found, in which '/' is replaced by '_'
count() {
    local file=$work/${1//\//_} frames=8 least=8
    # The flicker of a lamp is found in the first third of these bursts; bursts that are left out are no frames.
    [[ $1 != *+mains* ]] || frames=96 least=48
    # The stack contents must not depend on the caller.
    env -i COUNTS="$file.counts" qemu-arm -L /usr/arm-linux-gnueabihf -cpu cortex-a7 -plugin "$work/count.so,table=$work/table" \
        "$sim" bench --case "$1" --frames "$frames" >/dev/null
    awk -v case="$1" -v frames="$frames" -v least="$least" '{ n[$1] = $2 } END {
        if (n["frames"] < least || n["frames"] > frames) { print "count.sh: " case ": found " n["frames"] " frames, expected " frames > "/dev/stderr"; exit 1 }
        split("front pyramid sample other", names, " ")
        for (i = 1; i <= 4; i++) { per[i] = int(n[names[i]] / n["frames"] + 0.5); total += per[i] }
        printf "%-32s %9d %9d %9d %9d %9d\n", case, per[1], per[2], per[3], per[4], total
    }' "$file.counts" >"$file.found"
}
export -f count
export work sim

cases=$(awk '!/^#/ { print $1 }' "$baseline")
# A case runs on one processor.
xargs -P "$(nproc)" -I NAME bash -euc 'count NAME' <<<"$cases"
found() { for c in $cases; do cat "$work/${c//\//_}.found"; done; }

if [ "${2:-}" = --write ]; then
    { grep '^#' "$baseline"; found; } >"$work/new"
    cp "$work/new" "$baseline"
    cat "$baseline"
    exit
fi
found
# Compares each stage and the total; a stage of less than 10,000 instructions may differ by 300.
found | awk 'FILENAME == "-" {
        split("front pyramid sample other total", names, " ")
        for (i = 1; i <= 5; i++) {
            most = expected[$1, i]
            if ($(i + 1) > most * 1.03 && $(i + 1) > most + 300) {
                printf "%s: found %d instructions in %s, expected at most %d + 3 %%\n", $1, $(i + 1), names[i], most; bad = 1
            }
        }
        next
    }
    !/^#/ { for (i = 1; i <= 5; i++) expected[$1, i] = $(i + 1) }
    END { exit bad }' "$baseline" -
