#!/usr/bin/env bash
# Measures error and instructions on ARMv7 of the functions that the core calls, by libm, micromath, tables and the standard library.
#
#   math.sh DIR     builds core's example `math` for this machine and for ARMv7, and writes math.txt, math.svg and math.counts to DIR
#
# Needs qemu-user, gcc and the ARM cross compiler.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
[ $# = 1 ] || { echo "math.sh: found $# arguments, expected a folder" >&2; exit 1; }
mkdir -p "$1"
out=$(cd "$1" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cd "$here/../.."
target=armv7-unknown-linux-gnueabihf
build=(cargo build --locked --quiet --release -p hemilux-core --example math)
"${build[@]}"
"${build[@]}" --target $target
built=${CARGO_TARGET_DIR:-target}
gcc -shared -fPIC -O2 -o "$work/count.so" "$here/count.c"
# All code has one name, from the first instruction on.
printf 'code 0 frame 1\n0 1 none\n' >"$work/table"

total() { # NAME WAY CALLS
    env -i COUNTS="$work/counts" qemu-arm -L /usr/arm-linux-gnueabihf -cpu cortex-a7 -plugin "$work/count.so,table=$work/table" \
        "$built/$target/release/examples/math" "$@" >/dev/null
    awk '$1 == "other" || $1 == "none" { n += $2 } END { print n }' "$work/counts"
}
each() { # NAME WAY: instructions of a call, the loop's included
    echo $((($(total "$1" "$2" 50000) - $(total "$1" "$2" 10000)) / 400))
}
for name in sqrt acos atan2 cos sin exp ln pow0.8 pow1/2.4 rint; do
    none=$(each $name none)
    for way in libm micromath table std; do
        printf '%s %s %s\n' "$name" "$way" "$(awk "BEGIN { print ($(each $name $way) - $none) / 100 }")"
    done
done >"$out/math.counts"
"$built/release/examples/math" --out "$out" --counts "$out/math.counts"
