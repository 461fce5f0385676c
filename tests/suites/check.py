"""Compares the pixels and exposure times that hemilux-sim reads from public test images with those of OpenEXR and Pillow."""

import argparse
import collections
import os
import re
import shutil
import subprocess
import sys
import tomllib

import numpy
import OpenEXR
from PIL import Image

FAULTS = []


def fault(path, text):
    FAULTS.append(f"{path}: {text}")


def run(*command):
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


def is_refusal(path, result):
    """Returns whether the command failed; reports a fault unless it failed with status 1 and one line that names the file."""
    if result.returncode == 0:
        return False
    lines = result.stderr.strip().split("\n")
    if result.returncode != 1 or len(lines) != 1 or os.path.basename(path) not in lines[0]:
        fault(path, f"status {result.returncode}, {len(lines)} lines: {result.stderr[:200]}")
    return True


def channels(path):
    part = OpenEXR.File(path, separate_channels=True).parts[0]
    return part.header, {name: numpy.asarray(channel.pixels) for name, channel in part.channels.items()}


def openexr(sim, path, work):
    """Compares a latitude-longitude map texel by texel; returns the name of the outcome."""
    written = os.path.join(work, "map.exr")
    result = run(sim, "decompose", "--env", path, "--sphere", "--lights", "2", "--map", written)
    if is_refusal(path, result):
        return "refused"
    header, expected = channels(path)
    names = "RGB" if "R" in expected else "YYY"
    if any(name not in expected for name in names) or "envmap" in header:
        return "read, without a twin"
    expected = numpy.stack([expected[name].astype(numpy.float64) for name in names], -1)
    expected[~(expected > 0)] = 0
    _, found = channels(written)
    found = numpy.stack([found[name].astype(numpy.float64) for name in "RGB"], -1)
    window = header["dataWindow"][0] - header["displayWindow"][0]
    if expected.shape != found.shape:
        rows, columns = expected.shape[:2]
        found = found[window[1] : window[1] + rows, window[0] : window[0] + columns]
    # Infinities of half floats are read as the largest half float, and counted.
    expected[numpy.isinf(expected)] = 65504
    if not numpy.array_equal(expected, found):
        fault(path, f"differs by {numpy.abs(expected - found).max()} from what OpenEXR reads")
    return "equal"


def photograph(sim, path, lens, work):
    out = os.path.join(work, "burst")
    shutil.rmtree(out, ignore_errors=True)
    try:
        image = Image.open(path)
        exif = image.getexif()
        turned = exif.get(0x0112, 1) >= 5
        size = image.size[::-1] if turned else image.size
        seconds = exif.get_ifd(0x8769).get(33434)
    except (OSError, SyntaxError, ValueError):
        size, seconds = (64, 64), None
    fitted = os.path.join(work, "lens.toml")
    with open(lens, encoding="utf-8") as file, open(fitted, "w", encoding="utf-8") as copy:
        copy.write(re.sub(r"size = .*", f"size = [{size[0]}, {size[1]}]", file.read()))
    result = run(sim, "import", "--lens", fitted, path, "--out", out)
    if is_refusal(path, result):
        return "refused"
    with open(os.path.join(out, "burst.toml"), "rb") as file:
        found = tomllib.load(file)["frame"][0]["exposure_s"]
    if seconds is None:
        return "read, without a twin"
    if abs(found / float(seconds) - 1) > 1e-6:
        fault(path, f"exposure time {found}, Pillow reads {seconds}")
    return "equal"


def files(folders, endings):
    for folder in folders:
        for root, _, names in os.walk(folder):
            yield from sorted(os.path.join(root, name) for name in names if name.lower().endswith(endings))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+")
    for option in ("--sim", "--lens", "--work"):
        parser.add_argument(option, required=True)
    job = parser.parse_args()
    maps = collections.Counter(openexr(job.sim, path, job.work) for path in files(job.folders, ".exr"))
    kinds = (".jpg", ".jpeg", ".png", ".pgm", ".ppm")
    photos = collections.Counter(photograph(job.sim, p, job.lens, job.work) for p in files(job.folders, kinds))
    print(f"OpenEXR images: {dict(maps)}; photographs: {dict(photos)}")
    if maps["equal"] < 10 or photos["equal"] < 10:
        fault("the suites", "fewer than 10 equal images of each kind")
    print("\n".join(FAULTS))
    sys.exit(bool(FAULTS))


if __name__ == "__main__":
    main()
