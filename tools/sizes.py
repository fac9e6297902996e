"""Tokens and lines of code of each slice, and the limits of functions and modules.

python tools/sizes.py       `make lint` prints the table and fails where a limit is exceeded

Comments, docstrings and layout do not count.  A function has at most 400 tokens, a module 4,000; those that were larger
when the limits came are listed in tools/oversized.txt, which only gets shorter.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
from array import array
from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
AREAS = ("formats", "plugins", "converters", "renderer", "reference")
MAX_FUNCTION, MAX_MODULE = 400, 4000
LISTED = Path(__file__).with_name("oversized.txt")
LAYOUT = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
SLANG_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.S)
SLANG_TOKEN = re.compile(r"[A-Za-z_]\w*|\d[\w.]*|[=!<>]=|&&|\|\||\+\+|--|[^\s\w]")


def main() -> None:
    """Print the table; the exit status is 1 where a limit is exceeded."""
    print_table()
    faults = list(size_faults(dict(oversized(ROOT)), set(LISTED.read_text(encoding="utf-8").split())))
    print("\n".join(faults))
    sys.exit(bool(faults))


def size_faults(found: dict[str, int], listed: set[str]) -> Iterator[str]:
    """A sentence for each function or module that is too large, and for each that is listed for nothing."""
    for name in sorted(found.keys() - listed):
        limit = MAX_FUNCTION if ":" in name else MAX_MODULE
        yield f"{name} has {found[name]} tokens, {limit} are allowed: divide it"
    for name in sorted(listed - found.keys()):
        yield f"{name} is within the limits: remove it from {LISTED.name}"


def oversized(root: Path) -> Iterator[tuple[str, int]]:
    """``path`` of modules and ``path:function`` of functions beyond the limits, with their tokens."""
    for path in sorted(path for area in AREAS for path in (root / area / "elvis").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        name = str(path.relative_to(root))
        tokens, _ = python_size(text)
        if tokens > MAX_MODULE:
            yield name, tokens
        for function, count in function_sizes(text):
            if count > MAX_FUNCTION:
                yield f"{name}:{function}", count


def function_sizes(text: str) -> Iterator[tuple[str, int]]:
    """Names of the functions of a module and their tokens, those of functions inside included."""
    tree = ast.parse(text)
    lines = token_lines(text)
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)):
            last = node.end_lineno or node.lineno
            yield node.name, bisect_right(lines, last) - bisect_left(lines, node.lineno)


def print_table() -> None:
    """Print modules, tokens and lines of each slice."""
    sums: dict[tuple[str, str], list[int]] = defaultdict(lambda: [0, 0, 0])
    for path in sorted(path for area in AREAS for path in (ROOT / area / "elvis").rglob("*")):
        if path.suffix not in (".py", ".slang"):
            continue
        text = path.read_text(encoding="utf-8")
        tokens, lines = python_size(text) if path.suffix == ".py" else slang_size(text)
        row = sums[path.relative_to(ROOT).parts[2], path.suffix[1:]]
        row[:] = row[0] + 1, row[1] + tokens, row[2] + lines

    print(f"{'slice':12} {'':6} {'modules':>8} {'tokens':>8} {'lines':>8} {'tokens a line':>14}")
    for (slice_, kind), (modules, tokens, lines) in sorted(sums.items()):
        print(f"{slice_:12} {kind:6} {modules:8} {tokens:8} {lines:8} {tokens / max(lines, 1):14.1f}")


def python_size(text: str) -> tuple[int, int]:
    """Tokens and lines of a module, docstrings aside."""
    lines = token_lines(text)
    return len(lines), len(set(lines))


@cache
def token_lines(text: str) -> Sequence[int]:
    """Lines, in order, of the tokens of a module without comments, docstrings and layout."""
    silent = docstring_lines(ast.parse(text))
    tokens = whole_strings(tokenize.generate_tokens(io.StringIO(text).readline))
    lines = (token.start[0] for token in tokens if token.type not in LAYOUT)
    return array("l", sorted(line for line in lines if line not in silent))


def whole_strings(tokens: Iterator[tokenize.TokenInfo]) -> Iterator[tokenize.TokenInfo]:
    """The tokens with an f-string as one, as before Python 3.12: all versions count alike."""
    depth = 0
    for token in tokens:
        name = tokenize.tok_name[token.type]
        if depth == 0:
            yield token
        depth += {"FSTRING_START": 1, "FSTRING_END": -1}.get(name, 0)


def docstring_lines(tree: ast.Module) -> set[int]:
    """Numbers of the lines that docstrings take."""
    found: set[int] = set()
    for node in ast.walk(tree):
        if not isinstance(node, (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)):
            continue
        if ast.get_docstring(node, clean=False) is not None:
            first = node.body[0]
            found.update(range(first.lineno, (first.end_lineno or first.lineno) + 1))
    return found


def slang_size(text: str) -> tuple[int, int]:
    """Tokens and lines of a Slang file, nearly: its lexer is simpler than the language's."""
    bare = SLANG_COMMENT.sub("", text)
    return len(SLANG_TOKEN.findall(bare)), sum(bool(line.strip()) for line in bare.splitlines())


if __name__ == "__main__":
    main()
