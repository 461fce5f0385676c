"""Checks the layout of a Unity package: upm.py FOLDER. Unity ignores files of a package without a .meta file with a unique GUID."""

import json
import pathlib
import re
import sys

root = pathlib.Path(sys.argv[1])
package = json.loads((root / "package.json").read_text())
assert re.fullmatch(r"[a-z0-9-]+(\.[a-z0-9-]+){2,}", package["name"]), package["name"]
assert re.fullmatch(r"\d+\.\d+\.\d+", package["version"]) and re.fullmatch(r"\d{4}\.\d", package["unity"])
assemblies = {json.loads(path.read_text())["name"] for path in root.rglob("*.asmdef")}
assert assemblies == {"Hemilux", "Hemilux.Tests"}, assemblies
guids = set()
for path in (p for p in root.rglob("*") if p.suffix != ".meta"):
    meta = pathlib.Path(f"{path}.meta")
    assert meta.is_file(), f"{path}: found no .meta file"
    guids.add(re.search(r"^guid: ([0-9a-f]{32})$", meta.read_text(), re.M).group(1))
files = sum(p.suffix != ".meta" for p in root.rglob("*"))
assert len(guids) == files, "found a GUID twice"
assert all(pathlib.Path(str(p)[: -len(".meta")]).exists() for p in root.rglob("*.meta")), "found a .meta file without its file"
