#!/usr/bin/env bash
# Runs the commands of the READMEs as written, and compares their output with the READMEs.
#
#   tests/readme/check.sh HEMILUX HEMILUX-SIM
#
# A comment above a block defines how it is run; the comment is not visible on the rendered page:
#   <!-- run: probe -->            a probe runs beside it; port 8080 is replaced by a free one everywhere
#   <!-- run: serves -->           its last command serves until it is stopped
#   <!-- run: not here, WHY -->    needs a camera, root, or an hour
#   <!-- output: COMMAND -->       the block below is the output of the command, except for numbers; "..." stands for any lines
# A block of commands without a comment must end with status 0.
set -euo pipefail
exec python3 "$(dirname "$0")/check.py" "$(realpath "$1")" "$(realpath "$2")"
