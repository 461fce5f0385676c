#!/usr/bin/env bash
# Reads the public test images of OpenEXR, exiv2 and Pillow (Debian's source packages) and compares the results with those of OpenEXR and Pillow.
#
#   tests/suites/check.sh HEMILUX-SIM
#
# Each OpenEXR image is either refused in one line or read as the library reads it, texel for texel. Each photograph is either refused in
# one line or imported with the exposure time that Pillow reads.
# Needs Debian's package tools and sources, and Python 3.10 or newer with venv; downloads of about 100 MB stay in the cache.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
sim=$(realpath "$1")
cache=${XDG_CACHE_HOME:-$HOME/.cache}/hemilux-suites
mkdir -p "$cache/lists/partial"
[ -x "$cache/venv/bin/python" ] || python3 -m venv "$cache/venv"
"$cache/venv/bin/pip" install --quiet --disable-pip-version-check OpenEXR==3.5.3 numpy==2.4.6 pillow==13.0.0

cd "$cache"
fetch() { # fetch PACKAGE: unpacks the original source of a Debian package into a folder of its name
    [ -d "$1" ] && return
    sed 's/^Types: deb$/Types: deb-src/; s/^deb /deb-src /' /etc/apt/sources.list.d/debian.sources /etc/apt/sources.list 2>/dev/null >sources.sources || true
    local options=(-o APT::Sandbox::User=root -o "Dir::State::lists=$cache/lists" -o Dir::Etc::sourceparts=/dev/null -o "Dir::Etc::sourcelist=$cache/sources.sources")
    [ -e lists/lock ] && ls lists/*Sources* >/dev/null 2>&1 || apt-get -q "${options[@]}" update >/dev/null || true
    apt-get -q -q "${options[@]}" source --download-only "$1" >/dev/null
    mkdir "$1.new"
    tar -xf "$1"_*.orig.tar.?z -C "$1.new"
    mv "$1.new" "$1"
}
for package in openexr exiv2 pillow; do fetch "$package"; done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
venv/bin/python -W ignore "$here/check.py" --sim "$sim" --lens "$here/../../fixtures/lens-184.toml" --work "$work" openexr exiv2 pillow
