#!/usr/bin/env python3
"""Reads OpenEXR's own test images with hemilux-sim and with the OpenEXR library, and compares the flux of each.

usage: openexr.py HEMILUX-SIM FOLDER

Needs Python 3.10 and the PyPI packages OpenEXR (3.3 or newer) and numpy. FOLDER holds the unpacked source archive of the same package, which
has about fifty images. The exit status is 1 where a flux differs by more than 1e-6, where a file that the library cannot read is read,
or where a refusal is not one line with exit status 1.
"""
import json
import pathlib
import subprocess
import sys

import numpy
import OpenEXR

# What hemilux refuses by name although the library reads it: kinds of data, and files whose type attribute contradicts their data.
REFUSED = ("deep data", "channel subsampling", "several colour layers", "expected a flat layer with channels", "block type attribute",
           "missing or invalid tiles attribute", "zlib-compressed data malformed")
LARGEST_HALF = 65504.0


def reference(path):
    """Flux of the display window as a latitude-longitude map, or nothing for what the library cannot read or has no colours."""
    try:
        parts = OpenEXR.File(str(path), separate_channels=True).parts
        part = next(p for p in parts if {"R", "G", "B"} <= p.channels.keys() or "Y" in p.channels)
        planes = [part.channels[name].pixels.astype(numpy.float64) for name in ("RGB" if "R" in part.channels else "YYY")]
    except Exception:  # The library raises several kinds for broken files.
        return None
    data, display = ([[int(v) for v in corner] for corner in part.header[name]] for name in ("dataWindow", "displayWindow"))
    size = [display[1][axis] - display[0][axis] + 1 for axis in (1, 0)]
    whole = numpy.zeros((*size, 3))
    for y in range(max(data[0][1], display[0][1]), min(data[1][1], display[1][1]) + 1):
        left, right = max(data[0][0], display[0][0]), min(data[1][0], display[1][0]) + 1
        row = [plane[y - data[0][1], left - data[0][0]:right - data[0][0]] for plane in planes]
        whole[y - display[0][1], left - display[0][0]:right - display[0][0]] = numpy.stack(row, -1)
    whole = numpy.maximum(numpy.nan_to_num(whole, nan=0.0, posinf=LARGEST_HALF, neginf=0.0), 0.0)
    edges = numpy.cos(numpy.arange(size[0] + 1) / size[0] * numpy.pi)
    weights = (edges[:-1] - edges[1:]) * 2 * numpy.pi / size[1]
    return (whole * weights[:, None, None]).sum((0, 1))


def judged(sim, path):
    """What is wrong, or nothing, and what was found."""
    command = [sim, "decompose", "--env", str(path), "--lights", "16", "--sphere"]
    done = subprocess.run(command, capture_output=True, text=True)
    expected = reference(path)
    if done.returncode != 0:
        line = done.stderr.strip()
        is_one_line = done.returncode == 1 and "\n" not in line and path.name in line
        is_known = expected is None or any(reason in line for reason in REFUSED)
        return not (is_one_line and is_known), line
    if expected is None:
        return True, "read, which the library refuses"
    if "Cube" in path.name:
        return False, "a cube map, whose flux a test of board/src/maps holds"
    flux = numpy.array(json.loads(done.stdout)["scalar_flux"])
    off = numpy.abs(flux / expected - 1).max()
    return off > 1e-6, f"flux off by {off:.1e}"


def main():
    sim, folder = sys.argv[1], pathlib.Path(sys.argv[2])
    files = sorted(folder.rglob("*.exr"))
    if not files:
        sys.exit(f"openexr.py: {folder}: found no image, expected the source archive of OpenEXR")
    wrong = 0
    for path in files:
        is_wrong, found = judged(sim, path)
        wrong += is_wrong
        print(f"{'WRONG ' if is_wrong else '      '}{path.name:40} {found[-110:]}")
    print(f"{len(files)} files, {wrong} wrong")
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
