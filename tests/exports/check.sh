#!/usr/bin/env bash
# Opens exported light sets with the programs of the formats: usd-core, gltf-validator and Mitsuba 3.
#
#   tests/exports/check.sh HEMILUX-SIM [FOLDER]    FOLDER (or HEMILUX_HDRI) has latitude-longitude maps; without it the built-in scenes are used
#   tests/exports/check.sh HEMILUX-SIM [FOLDER] --write    also replaces fixtures/exports.png
#
# Needs Python 3.10 or newer with venv, npm, and both registries for the first run; packages stay in the cache.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
sim=$(realpath "$1")
cache=${XDG_CACHE_HOME:-$HOME/.cache}/hemilux-exports
folder=${2:-${HEMILUX_HDRI:-}}
write=()
[ "$folder" = --write ] && folder=${HEMILUX_HDRI:-}
[[ " $* " != *" --write "* ]] || write=(--write "$here/../../fixtures/exports.png")

[ -x "$cache/venv/bin/python" ] || python3 -m venv "$cache/venv"
"$cache/venv/bin/pip" install --quiet --disable-pip-version-check --requirement "$here/requirements.txt"
npm install --silent --no-audit --no-fund --prefix "$cache" gltf-validator@2.0.0-dev.3.10
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
NODE_PATH=$cache/node_modules exec_validator="$here/validate.js"
export NODE_PATH
"$cache/venv/bin/python" "$here/check.py" --sim "$sim" --validator "$exec_validator" --work "$work" ${folder:+--maps "$folder"} "${write[@]}"
