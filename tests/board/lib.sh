# Helpers of the rig, to be sourced. Downloads go to $RIG, outside of the repository, and stay there for the next run.
# QEMU, kernels and guest files are unpacked and not installed: installing qemu-system-* may remove a newer qemu-utils.
set -euo pipefail
RIG=${HEMILUX_RIG_CACHE:-${XDG_CACHE_HOME:-$HOME/.cache}/hemilux-rig}
mkdir -p "$RIG"
APT=(apt-get -q -y -o DPkg::Lock::Timeout=300 -o APT::Sandbox::User=root)

die() { echo "rig: $*" >&2; exit 1; }

# later_package DEB OUT: writes a later version of the package, whose configuration file differs
later_package() {
    local unpacked
    unpacked=$(mktemp -d "${TMPDIR:-/tmp}/hemilux-later.XXXXXX")
    dpkg-deb -R "$1" "$unpacked"
    sed -i 's/^Version: .*/&+later/' "$unpacked/DEBIAN/control"
    echo '# A line of the later version.' >>"$unpacked/etc/hemilux/hemilux.conf"
    dpkg-deb -Zgzip -z1 --root-owner-group -b "$unpacked" "$2" >/dev/null
    rm -r "$unpacked"
    [ "$(dpkg-deb -f "$2" Version)" != "$(dpkg-deb -f "$1" Version)" ] || die "$2: found the version of $1, expected a later one"
}

# Packages that are not available are no failure of the tested program: status 77, the status of skipped tests in test harnesses.
absent() { echo "rig: $*" >&2; exit 77; }
command -v apt-get >/dev/null && command -v dpkg >/dev/null || absent "found no apt-get and dpkg, expected a Debian or one of its kin"

# Updates package lists with armhf. An error of one index does not stop the run while the required packages are listed.
apt_lists() {
    dpkg --print-foreign-architectures | grep -qx armhf || dpkg --add-architecture armhf || absent "found no armhf, expected the right to add it"
    if apt-cache show linux-image-armmp:armhf >/dev/null 2>&1 && [ -n "$(find "$RIG/lists" -mmin -720 2>/dev/null)" ]; then
        return
    fi
    "${APT[@]}" update >"$RIG/lists.log" 2>&1 || echo "rig: apt-get update had errors; going on with the lists there are"
    apt-cache show linux-image-armmp:armhf >/dev/null 2>&1 || absent "no armhf package lists: see $RIG/lists.log"
    touch "$RIG/lists"
}

# unpack DIR full|missing PACKAGE...: unpacks the packages with all dependencies (full), or with those that this machine lacks (missing)
unpack() {
    local dir=$RIG/$1 mode=(--reinstall) deb
    [ "$2" = full ] && mode=(-o Dir::State::status=/dev/null)
    shift 2
    [ "$(cat "$dir/.ok" 2>/dev/null)" = "$*" ] && return
    apt_lists
    rm -rf "$dir" "$dir.debs"
    mkdir -p "$dir" "$dir.debs/partial"
    "${APT[@]}" "${mode[@]}" -o Dir::Cache::archives="$dir.debs" --download-only --no-install-recommends install "$@" \
        >"$dir.log" 2>&1 || absent "download of $*: see $dir.log"
    for deb in "$dir.debs"/*.deb; do dpkg -x "$deb" "$dir"; done
    rm -rf "$dir.debs"
    echo "$*" >"$dir/.ok"
}

# kernel DIR METAPACKAGE: unpacks the kernel package on which the metapackage depends
kernel() {
    local dir=$RIG/$1 package
    [ -e "$dir/.ok" ] && return
    apt_lists
    package=$(apt-cache depends "$2" | sed -n 's/^ *Depends: *\(linux-image-\)/\1/p' | head -1)
    [ -n "$package" ] || absent "no kernel package behind $2"
    rm -rf "$dir"
    mkdir -p "$dir"
    (cd "$dir" && "${APT[@]}" download "$package" >"$dir.log" 2>&1 && dpkg -x ./*.deb . && rm -f ./*.deb) || absent "kernel $package: see $dir.log"
    touch "$dir/.ok"
}
