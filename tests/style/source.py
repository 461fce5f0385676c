"""Blanks comments and strings of Rust and JavaScript, and finds blocks."""

import re

# Comments, strings and characters are blanked, so that braces in them do not count. A lifetime has no second quote.
BLANKED = re.compile(
    r"//[^\n]*|/\*.*?\*/|b?r(#*)\".*?\"\1|b?\"(?:\\.|[^\"\\])*\"|'(?:\\(?:x..|u\{[^}]*\}|.)|[^'\\\n])'",
    re.DOTALL,
)
TEST_MODULE = re.compile(r"#\[cfg\((?:test|all\(test[^\n]*)\)\]\s*(?:#\[[^\n]*\]\s*)*(?:pub\S*\s+)?mod\s+\w+")


def blanked(source):
    return BLANKED.sub(lambda m: re.sub(r"[^\n]", " ", m.group()), source)


def body(code, start):
    """Returns the span of the block that follows `start`, or None for a declaration without a block."""
    depth = 0
    for at in range(start, len(code)):
        c = code[at]
        if c in "([":
            depth += 1
        elif c in ")]":
            depth -= 1
        elif depth == 0 and c == ";":
            return None
        elif depth == 0 and c == "{":
            level = 0
            for end in range(at, len(code)):
                level += {"{": 1, "}": -1}.get(code[end], 0)
                if level == 0:
                    return at, end
    return None


def line(text, at):
    return text.count("\n", 0, at) + 1


def test_modules(code):
    """Returns the spans of the modules that are compiled for tests only."""
    for match in TEST_MODULE.finditer(code):
        span = body(code, match.end())
        if span:
            yield match.start(), span[1] + 1


def is_test(path):
    return "tests" in path.parts or path.stem in ("tests", "test")
