#!/usr/bin/env bash
# Rules of prose, size and imports that a machine can check, over the files that git tracks.
#
#   tests/style/check.sh [FOLDER]     one line per violation and exit status 1; FOLDER (this repository by default) is another tree
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
exec python3 "$here/check.py" "${1:-$here/../..}"
