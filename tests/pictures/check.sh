#!/usr/bin/env bash
# Runs the commands of the README that make the committed pictures, and compares their files with fixtures/, byte for byte.
#
#   tests/pictures/check.sh HEMILUX-SIM            exits with status 1 if a picture differs
#   tests/pictures/check.sh HEMILUX-SIM --write    replaces the committed pictures
#
# Not compared: soft.png (soft.py), page*.png, which are screenshots of a live page (tests/tests/page/screenshots.mjs), and the positions on the time axis
# of chart-time.svg, which are measured on the current machine; its texts (methods, axes) are compared. Coordinates of slowdown.svg may differ by a
# pixel: one curve is within 0.02 pixels of a boundary of pixels. exports.png belongs to tests/exports.
# The check takes two minutes on two cores.
set -euo pipefail
sim=$(realpath "$1")
cd "$(dirname "$0")/../.."
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/out"

# The README's commands, with this program and this folder in place of `cargo run` and `out`.
grep -E '^cargo run --release -p hemilux-sim -- (decompose|render|chart|stress|slowdown) ' README.md | grep -F 'out/' >"$work/commands"
while read -r command; do
    command=${command/#cargo run --release -p hemilux-sim --/"$sim"}
    echo "${command#"$sim"}"
    bash -c "${command// out\// $work/out/}" 2>>"$work/log" || { cat "$work/log"; exit 1; }
done <"$work/commands"

words() { grep -oE '[A-Za-z][A-Za-z+%() ,-]+' "$1" | sort -u; }
numbers() { grep -oE '[0-9]+(\.[0-9]+)?' "$1"; }
without_numbers() { sed -E 's/[0-9]+(\.[0-9]+)?/N/g' "$1"; }
# nearly_equal FILE FILE: whether both texts are equal but for numbers that differ by at most 1
nearly_equal() {
    cmp -s <(without_numbers "$1") <(without_numbers "$2") &&
        paste <(numbers "$1") <(numbers "$2") | awk '$1 - $2 > 1 || $2 - $1 > 1 { bad = 1 } END { exit bad }'
}
failed=0
for picture in room.png render.png slowdown.svg stress/stress.svg charts/chart-lights.svg charts/chart-time.svg; do
    made=$work/out/$picture committed=fixtures/$(basename "$picture")
    if [ "${2:-}" = --write ]; then
        cp "$made" "$committed"
    elif [ "$(basename "$picture")" = chart-time.svg ]; then
        diff <(words "$committed") <(words "$made") || { echo "$committed: found other words than the README's command writes" >&2; failed=1; }
    elif [ "$(basename "$picture")" = slowdown.svg ]; then
        nearly_equal "$committed" "$made" || { echo "$committed: found a picture that differs from the README's command's by more than a pixel" >&2; failed=1; }
    else
        cmp "$committed" "$made" || { echo "$committed: found a picture that differs from the README's command's" >&2; failed=1; }
    fi
done
[ $failed = 0 ] && echo "pictures: the committed ones are those of the commands"
exit $failed
