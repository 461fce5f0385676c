#!/usr/bin/env python3
"""Writes the extension as a zip for Blender's "Install from Disk": python3 build.py [hemilux.zip]. Equal sources give equal bytes."""

import pathlib
import sys
import zipfile


def main():
    here = pathlib.Path(__file__).resolve().parent
    # The module that receives sets is shared with the Python package.
    sources = [*(here / "hemilux").iterdir(), here.parent / "python/src/hemilux/feed.py"]
    target = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else "hemilux.zip")
    try:
        with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
            for path in sorted(sources, key=lambda path: path.name):
                if path.suffix in (".py", ".toml"):
                    archive.writestr(zipfile.ZipInfo(path.name), path.read_bytes(), zipfile.ZIP_DEFLATED)
    except OSError as error:
        sys.exit(f"{target}: found {error.strerror}, expected a file that can be written")
    print(target)


main()
