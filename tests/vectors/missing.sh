#!/usr/bin/env bash
# Fails unless each program prints one line and exits with status 1 on a processor without NEON, and runs on a processor with NEON.
#
#   missing.sh PROGRAM...     builds for armv7-unknown-linux-gnueabihf with NEON; needs qemu-user
set -euo pipefail
[ $# -gt 0 ] || { echo "missing.sh: found no program, expected ARMv7 builds of hemilux and hemilux-sim" >&2; exit 1; }
run() { qemu-arm -L /usr/arm-linux-gnueabihf -cpu "$@"; }
for program in "$@"; do
    status=0
    line=$(run cortex-a9,neon=off "$program" --version 2>&1) || status=$?
    if [ $status != 1 ] || [ "$(wc -l <<<"$line")" != 1 ] || [[ $line != hemilux:*NEON* ]]; then
        echo "missing.sh: $program without NEON: found status $status and '$line', expected status 1 and a line about NEON" >&2
        exit 1
    fi
    run cortex-a9 "$program" --version
done
echo "without NEON: $line"
