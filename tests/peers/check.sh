#!/usr/bin/env bash
# Tests OSC and MQTT with programs of other authors: python-osc, mosquitto and paho-mqtt.
#
#   tests/peers/check.sh HEMILUX
#
# Needs Python 3.10 with venv, PyPI for the first run, and mosquitto; without mosquitto the check of MQTT is skipped with a line, and fails with HEMILUX_RIG.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
program=$(realpath "$1")
cache=${XDG_CACHE_HOME:-$HOME/.cache}/hemilux-peers
[ -x "$cache/venv/bin/python" ] || python3 -m venv "$cache/venv"
"$cache/venv/bin/pip" install --quiet --disable-pip-version-check python-osc==1.9.3 paho-mqtt==2.1.0
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
PATH=$PATH:/usr/sbin "$cache/venv/bin/python" "$here/check.py" "$program" "$work"
