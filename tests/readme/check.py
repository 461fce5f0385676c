"""Runs the commands of the READMEs: see `check.sh`."""

import contextlib
import os
import pathlib
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time

PROGRAM, SIMULATOR = sys.argv[1:3]
ROOT = pathlib.Path(__file__).resolve().parents[2]
PAGES = ["README.md", "board/README.md", "core/README.md", "tests/README.md", *sorted(str(p.relative_to(ROOT)) for p in ROOT.glob("board/clients/*/README.md"))]
LONGEST = 1800
DIRECTIVE = re.compile(r"<!-- (run|output): (.*?) -->")


def blocks(page):
    """Yields line, language, directive and text of each fenced block."""
    directive, start, language, lines = None, None, "", []
    for number, line in enumerate((ROOT / page).read_text().splitlines(), 1):
        if start is not None:
            if line.startswith("```"):
                yield start, language, directive, "\n".join(lines)
                directive, start = None, None
            else:
                lines.append(line)
        elif line.startswith("```"):
            start, language, lines = number, line[3:].strip(), []
        elif DIRECTIVE.fullmatch(line.strip()):
            directive = DIRECTIVE.fullmatch(line.strip()).groups()
        elif line.strip():
            directive = None


def free_port():
    with socket.socket() as bound:
        bound.bind(("127.0.0.1", 0))
        return bound.getsockname()[1]


class Place:
    """A folder with links to the repository's files in which commands write, and a port that replaces 8080."""

    def __init__(self, folder):
        self.folder, self.port = pathlib.Path(folder), free_port()
        for path in ROOT.iterdir():
            if path.name not in ("out", "target", ".git"):
                (self.folder / path.name).symlink_to(path)
        (self.folder / "out").mkdir()
        programs = self.folder / ".programs"
        programs.mkdir()
        (programs / "hemilux").symlink_to(PROGRAM)
        (programs / "hemilux-sim").symlink_to(SIMULATOR)
        self.environment = {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}"}
        self.environment.pop("RUST_LOG", None)

    def script(self, text):
        """Returns the commands with built programs in place of `cargo run`, and with the port of this object."""
        text = re.sub(r"cargo run --release -p hemilux-sim -- ", "hemilux-sim ", text)
        text = re.sub(r"cargo run --release(?: -- |$)", "hemilux ", text, flags=re.M)
        return text.replace(":8080", f":{self.port}")

    def run(self, text, timeout=LONGEST):
        command = ["bash", "-euo", "pipefail", "-c", self.script(text)]
        options = {"cwd": self.folder, "env": self.environment, "stdin": subprocess.DEVNULL, "timeout": timeout}
        return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", **options)

    @contextlib.contextmanager
    def serving(self, text):
        """Runs commands of which the last is a server; yields the address of the server."""
        text = self.script(text).rstrip()
        if "--listen" not in text.splitlines()[-1]:
            text += f" --listen 127.0.0.1:{self.port}"
        *before, last = text.splitlines()
        command = ["bash", "-euo", "pipefail", "-c", "\n".join([*before, "exec " + last])]
        with subprocess.Popen(command, cwd=self.folder, env=self.environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
            lines = []
            for line in process.stdout:
                lines.append(line)
                if "serving http://" in line:
                    break
            else:
                raise AssertionError(f"found no address: {''.join(lines)[-300:]}")
            try:
                yield re.search(r"http://[^/ ]+", lines[-1]).group()
            finally:
                process.send_signal(signal.SIGTERM)
                process.communicate(timeout=10)
        if process.returncode != 0:
            raise AssertionError(f"found exit status {process.returncode}, expected 0 after SIGTERM")


def succeeded(done):
    if done.returncode != 0:
        raise AssertionError(f"found exit status {done.returncode}: {done.stdout[-500:]}")


def normal(line):
    return " ".join(re.sub(r"\d+(\.\d+)?", "N", line).split())


def compare(expected, printed):
    """Checks that each expected line is printed, in order; between two lines there is no other unless `...` is between them."""
    found, at, is_free = [normal(line) for line in printed.splitlines()], 0, True
    for line in map(normal, expected.splitlines()):
        if line == "...":
            is_free = True
            continue
        place = next((i for i in range(at, len(found)) if found[i] == line), None)
        if place is None or (place > at and not is_free):
            raise AssertionError(f"found no line '{line}' in its place in: {printed[-800:]}")
        at, is_free = place + 1, False


def check(place, kind, how, text):
    if kind == "output":
        return compare(text, place.run(how).stdout)
    if how == "serves":
        with place.serving(text):
            time.sleep(1)
    elif how == "probe":
        with place.serving("hemilux"):
            succeeded(place.run(text))
    else:
        succeeded(place.run(text))


def main():
    failures, skipped, ran = 0, 0, 0
    for page in PAGES:
        with tempfile.TemporaryDirectory(prefix="hemilux-readme-") as folder:
            place = Place(folder)
            for line, language, directive, text in blocks(page):
                kind, how = directive or ("run", "")
                if language not in ("sh", "bash") and kind == "run":
                    continue
                if how.startswith("not here"):
                    print(f"  skipped {page}:{line}: {how}")
                    skipped += 1
                    continue
                ran += 1
                try:
                    check(place, kind, how, text)
                    print(f"  ok      {page}:{line}", flush=True)
                except (AssertionError, subprocess.TimeoutExpired) as error:
                    failures += 1
                    print(f"  FAIL    {page}:{line}: {error}", flush=True)
    print(f"readme: {ran} blocks, {failures} failures, {skipped} not here")
    sys.exit(1 if failures or ran < 10 else 0)


main()
