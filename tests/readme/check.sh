#!/usr/bin/env bash
# Runs the commands of the READMEs as they are written, and compares what they print with what the READMEs say.
#
#   tests/readme/check.sh HEMILUX HEMILUX-SIM
#
# A comment above a block tells how it runs; readers of the page do not see it:
#   <!-- run: probe -->            a probe runs beside it; port 8080 is replaced by a free one everywhere
#   <!-- run: serves -->           its last command serves until it is ended
#   <!-- run: not here, WHY -->    needs a camera, root, or an hour
#   <!-- output: COMMAND -->       the block below is what the command prints, numbers aside; "..." stands for any lines
# A block of commands without a comment must end with status 0.
set -euo pipefail
exec python3 "$(dirname "$0")/check.py" "$(realpath "$1")" "$(realpath "$2")"
