"""Finds import cycles between the modules of a crate."""

import pathlib
import re
from collections import defaultdict

from source import blanked, is_test, line, test_modules

USE = re.compile(r"\b(pub(?:\([^)]*\))?\s+)?use\s+([^;]+);")
TEST_FILE = re.compile(r"#\[cfg\((?:test|all\(test[^\n]*)\)\]\s*(?:#\[[^\n]*\]\s*)*(?:pub\S*\s+)?mod\s+(\w+)\s*;")
PATH = re.compile(r"\b(?:crate|super)(?:::\w+)+")


def leaves(tree):
    """Returns the paths of a `use` tree, each a list of names; a renamed item keeps its first name, with the new name after `as`."""
    tree = tree.strip()
    if "{" not in tree:
        yield [part.strip() for part in tree.split("::")]
        return
    head, rest = tree.split("{", 1)
    prefix = [part.strip() for part in head.split("::") if part.strip()]
    depth, start, inner = 0, 0, rest.rsplit("}", 1)[0]
    for at, c in enumerate(inner + ","):
        depth += {"{": 1, "}": -1}.get(c, 0)
        if c == "," and depth == 0:
            if inner[start:at].strip():
                for path in leaves(inner[start:at]):
                    yield prefix + path
            start = at + 1


def module_of(path, source):
    """Returns the names of the module that a file defines, without those of the crate root."""
    parts = list(path.relative_to(source).with_suffix("").parts)
    if parts[-1] in ("mod", "lib"):
        parts.pop()
    return parts


def exports(code):
    """Returns the names that a module re-exports, each with its path from the module."""
    names = {}
    for match in USE.finditer(code):
        if match[1]:
            for path in leaves(match[2]):
                path = path[1:] if path[0] == "self" else path
                if path[0] not in ("crate", "super"):
                    names[path[-1].split(" as ")[-1].strip()] = path
    return names


def used_paths(code):
    """Returns the paths that begin with `crate` or `super`, with their positions: those of `use` declarations, then all others."""
    spans = []
    for match in USE.finditer(code):
        spans.append(match.span())
        for path in leaves(match[2]):
            if path[0] in ("crate", "super"):
                yield path, match.start()
    for match in PATH.finditer(code):
        if not any(a <= match.start() < b for a, b in spans):
            yield match.group().split("::"), match.start()


class Crate:
    """The modules of a crate, without those that are compiled for tests only."""

    def __init__(self, root, source, files):
        self.code, self.file, tests = {}, {}, set()
        for f in files:
            module = tuple(module_of(f, source))
            if module[:1] in (("main",), ("bin",)):
                continue
            code = blanked((root / f).read_text())
            for start, end in test_modules(code):
                code = code[:start] + re.sub(r"[^\n]", " ", code[start:end]) + code[end:]
            tests.update(module + (name,) for name in TEST_FILE.findall(code))
            self.code[module], self.file[module] = code, f
        for module in [m for m in self.code if any(m[: len(test)] == test for test in tests)]:
            del self.code[module]
        self.names = {module: exports(code) for module, code in self.code.items()}

    def resolve(self, path, module):
        """Returns the module to which a path leads from `module`, through re-exports."""
        base = tuple(module) if path[0] == "super" else ()
        for name in path:
            name = name.split(" as ")[0].strip()
            if name == "super":
                base = base[:-1]
            elif name in ("crate", "self"):
                continue
            elif base + (name,) in self.code:
                base += (name,)
            else:
                found = self.names.get(base, {}).get(name)
                return self.resolve(["crate", *base, *found], ()) if found and found != [name] else base
        return base

    def edges(self):
        """Returns, for each parent module, the imports among its children: from, to, and one position."""
        found = defaultdict(lambda: defaultdict(dict))
        for module, code in self.code.items():
            for path, at in used_paths(code):
                to = self.resolve(path, module)
                depth = next((i for i, (a, b) in enumerate(zip(module, to)) if a != b), None)
                if depth is not None:
                    place = f"{self.file[module]}:{line(code, at)}"
                    found[module[:depth]][module[depth]].setdefault(to[depth], place)
        return found


def shortest_cycle(found, start):
    """Returns the shortest cycle from `start` back to `start`, as a list of modules; None if there is none."""
    ways, seen = [[start]], set()
    while ways:
        following = []
        for way in ways:
            for to in found.get(way[-1], ()):
                if to == start:
                    return way
                if to not in seen:
                    seen.add(to)
                    following.append(way + [to])
        ways = following
    return None


def imports(root, paths):
    """Yields violations of the rule that modules with the same parent do not import each other, directly or through others."""
    crates = defaultdict(list)
    for path in paths:
        if path.suffix == ".rs" and "src" in path.parts and not is_test(path):
            crates[pathlib.Path(*path.parts[: path.parts.index("src") + 1])].append(path)
    for source, files in sorted(crates.items()):
        for parent, found in sorted(Crate(root, source, files).edges().items()):
            told = set()
            for module in sorted(found):
                cycle = shortest_cycle(found, module)
                key = tuple(sorted(cycle or ()))
                if cycle and key not in told:
                    told.add(key)
                    steps = [f"{a} imports {b} ({found[a][b]})" for a, b in zip(cycle, cycle[1:] + cycle[:1])]
                    where = "/".join([str(source), *parent])
                    yield f"{where}: found an import cycle, expected none: {', '.join(steps)}"
