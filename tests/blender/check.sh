#!/usr/bin/env bash
# Tests the Blender extension, installed from its zip into Blender (the PyPI wheel bpy), against running probes.
#
#   tests/blender/check.sh HEMILUX [FOLDER]    FOLDER (or HEMILUX_HDRI) has latitude-longitude maps; without it the built-in scenes are used
#
# Needs Python 3.11 with venv, PyPI for the first run (374 MB; the wheel stays in the cache), and ten minutes on two cores.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
program=$(realpath "$1")
cache=${XDG_CACHE_HOME:-$HOME/.cache}/hemilux-blender
folder=${2:-${HEMILUX_HDRI:-}}
python=${HEMILUX_PYTHON311:-python3.11}

[ -x "$cache/venv/bin/python" ] || "$python" -m venv "$cache/venv"
"$cache/venv/bin/pip" install --quiet --disable-pip-version-check --requirement "$here/requirements.txt"
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
export BLENDER_USER_RESOURCES=$work/user

"$cache/venv/bin/python" "$here/../../board/clients/blender/build.py" "$work/hemilux.zip"
"$cache/venv/bin/python" "$(find "$cache/venv/" -path '*bl_pkg/cli/blender_ext.py' | head -1)" validate "$work/hemilux.zip"
sources=(scene:sky scene:overcast)
if [ -n "$folder" ]; then
    sources=()
    for map in $(find "$folder" -name '*.exr' | sort | head -2); do sources+=("env:$map,view=whole"); done
fi
"$cache/venv/bin/python" "$here/check.py" --program "$program" --zip "$work/hemilux.zip" --work "$work" "${sources[@]}"
