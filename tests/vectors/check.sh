#!/usr/bin/env bash
# Fails if a hot loop of the core has no vector instructions on ARMv7.
#
#   check.sh HEMILUX-SIM     a release build for armv7-unknown-linux-gnueabihf with NEON and with symbols
set -euo pipefail
binary=$1
[ -r "$binary" ] || { echo "check.sh: $binary: found no readable file, expected an ARMv7 build of hemilux-sim" >&2; exit 1; }

# Columns: function, least number of functions of that name, instruction pattern, least number of matches in each function.
wanted='
hemilux_core::merge::linear::Linear::merge 8 vmax.u(8|16) 1
hemilux_core::merge::linear::Linear::merge 8 vshl.u16 1
hemilux_core::front::gather::sum_up 1 vmlal.s16 1
hemilux_core::front::gather::sum_up 1 vadd.i32 1
hemilux_core::front::gather::cut 1 vsub.i32 1
hemilux_core::front::gather::cut 1 vcvt.f32.s32.*q 1
hemilux_core::front::gather::add 2 vmla.f32|vfma.f32 3
hemilux_core::front::code_sums::CodeSums::above_black 1 vld3.8 1
hemilux_core::front::code_sums::CodeSums::add_up 1 vaddw.s16 1
hemilux_core::front::code_sums::CodeSums::add_runs 1 vmla.i32 1
hemilux_core::front::yuv::Pairs::paint_as 4 vqadd.s16 3
hemilux_core::front::yuv::Pairs::paint_as 4 vmull.s16 8
hemilux_core::merge::table::Whole::plane 2 vmax.u8 1
hemilux_core::merge::table::Whole::has_answers 1 vcg[et].u8 2
'
arm-linux-gnueabihf-objdump -dC --no-show-raw-insn "$binary" >"${TMPDIR:-/tmp}/vectors.$$"
trap 'rm -f "${TMPDIR:-/tmp}/vectors.$$"' EXIT
failed=0
while read -r name functions instruction least; do
    [ -n "$name" ] || continue
    awk -v name="$name" -v functions="$functions" -v pattern="$instruction" -v least="$least" '
        function close_one() { if (inside && n < least) { printf "%s: found %d of %s, expected at least %d\n", name, n, pattern, least; bad = 1 } }
        /^[0-9a-f]+ <.*>:$/ { close_one(); inside = index($0, "<" name ">") > 0; if (inside) { found++; n = 0 }; next }
        inside && $0 ~ pattern { n++ }
        END { close_one(); if (found < functions) { printf "%s: found %d functions, expected %d\n", name, found, functions; bad = 1 }; exit bad }
    ' "${TMPDIR:-/tmp}/vectors.$$" || failed=1
done <<<"$wanted"
[ $failed = 0 ] && echo "vectors: passed"
exit $failed
