"""Rules of prose and size: see `check.sh`. The rules are the functions called in `main`."""

import pathlib
import re
import subprocess
import sys

from imports import imports
from source import blanked, body, is_test, line, test_modules

WORDS = re.compile(r"\b(who|nobody|somebody|everybody|whoever)\b", re.IGNORECASE)
PROSE = {".rs", ".js", ".mjs", ".md", ".py", ".sh", ".html", ".json", ".toml", ".txt", ".yaml", ".1", ".conf"}
MOST_FUNCTION_LINES = 80
MOST_FILE_LINES = 400
MOST_OPENAPI_COLUMNS = 160

FUNCTION = re.compile(r"\bfn\s+(\w+)")


def tracked(root):
    listed = subprocess.run(["git", "-C", root, "ls-files", "-z"], check=True, capture_output=True, text=True).stdout
    return [pathlib.Path(name) for name in listed.split("\0") if name and (root / name).is_file()]


def words(root, paths):
    """Yields pronouns for people outside of the lines of `people.txt`, which has lines PATH: TEXT."""
    allowed, used = [], set()
    for entry in (pathlib.Path(__file__).parent / "people.txt").read_text().splitlines():
        if entry and not entry.startswith("#"):
            allowed.append(tuple(entry.split(": ", 1)))
    for path in paths:
        if path.suffix not in PROSE or path.parts[:2] == ("tests", "style"):
            continue
        for number, text in enumerate((root / path).read_text().splitlines(), 1):
            if not WORDS.search(text):
                continue
            fits = [a for a in allowed if a[0] == str(path) and a[1] in text]
            used.update(fits)
            if not fits:
                yield f"{path}:{number}: found '{WORDS.search(text).group()}', expected it for people alone: {text.strip()[:100]}"
    for path, text in set(allowed) - used:
        yield f"tests/style/people.txt: found '{path}: {text}', expected a line that is there"


def functions(root, paths):
    for path in paths:
        if path.suffix != ".rs":
            continue
        code = blanked((root / path).read_text())
        for match in FUNCTION.finditer(code):
            span = body(code, match.end())
            lines = line(code, span[1]) - line(code, match.start()) + 1 if span else 0
            if lines > MOST_FUNCTION_LINES:
                where = f"{path}:{line(code, match.start())}"
                yield f"{where}: found {lines} lines in fn {match[1]}, expected at most {MOST_FUNCTION_LINES}"


def files(root, paths):
    for path in paths:
        if path.suffix not in (".rs", ".js") or is_test(path):
            continue
        code = blanked((root / path).read_text())
        lines = code.count("\n")
        for start, end in test_modules(code):
            lines -= line(code, end - 1) - line(code, start) + 1
        if lines > MOST_FILE_LINES:
            yield f"{path}: found {lines} lines without tests, expected at most {MOST_FILE_LINES}"


def openapi(root, paths):
    for path in paths:
        if path.name != "openapi.json":
            continue
        for number, text in enumerate((root / path).read_text().splitlines(), 1):
            if len(text) > MOST_OPENAPI_COLUMNS:
                yield f"{path}:{number}: found {len(text)} characters, expected at most {MOST_OPENAPI_COLUMNS}"


def artefacts(root, paths):
    for path in paths:
        if path.suffix in (".so", ".o", ".a", ".pyc", ".rlib"):
            yield f"{path}: found a build product, expected sources alone"


def main():
    root = pathlib.Path(sys.argv[1]).resolve()
    paths = tracked(root)
    found = [v for rule in (words, functions, files, imports, openapi, artefacts) for v in rule(root, paths)]
    for violation in found:
        print(violation)
    print(f"style: {len(found)} violations in {len(paths)} files")
    sys.exit(1 if found else 0)


main()
