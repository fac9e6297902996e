"""Tokens and lines of code of each slice: comments, docstrings and layout count nothing.

python tools/sizes.py       `make lint` prints it; nothing is demanded of the numbers, a reader's eye decides
"""

from __future__ import annotations

import ast
import io
import re
import tokenize
from collections import defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
AREAS = ("formats", "plugins", "converters", "renderer", "reference")
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
    """Print the table."""
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
    silent = docstring_lines(ast.parse(text))
    tokens = [token for token in tokenize.generate_tokens(io.StringIO(text).readline) if token.type not in LAYOUT]
    told = [token.start[0] for token in tokens if token.start[0] not in silent]
    return len(told), len(set(told))


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
