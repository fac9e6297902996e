"""Small changes of one line of Python or Slang, each of a kind that a person could make by mistake."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass

#: pairs of names that a mutation exchanges
ENDS = [
    ("min", "max"),
    ("minimum", "maximum"),
    ("lower", "upper"),
    ("low", "high"),
    ("least", "most"),
    ("floor", "ceil"),
    ("any", "all"),
]
OTHER_END = {first: second for pair in ENDS for first, second in (pair, pair[::-1])}
STRICTER = {"<": "<=", "<=": "<", ">": ">=", ">=": ">"}
COMPARISONS = {ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">="}


@dataclass(frozen=True)
class Mutation:
    """``old`` at ``start`` (a position in the text of a file) becomes ``new``."""

    kind: str
    line: int
    start: int
    old: str
    new: str

    def apply(self, text: str) -> str:
        """The text of the file with the change."""
        assert text[self.start :].startswith(self.old)
        return text[: self.start] + self.new + text[self.start + len(self.old) :]


def mutations(text: str, suffix: str) -> Iterator[Mutation]:
    """All mutations of a file."""
    found = PythonMutations(text).all() if suffix == ".py" else slang_mutations(text)
    return (change for change in found if change.old != change.new)


class PythonMutations:
    """Mutations of the syntax tree of a module; messages, annotations and texts stay unchanged."""

    def __init__(self, text: str) -> None:
        self._text = text
        #: methods ``lower`` and ``upper`` of texts
        self._texts: set[ast.AST] = set()
        self._starts = [0]
        for line in text.splitlines(keepends=True):
            self._starts.append(self._starts[-1] + len(line))

    def all(self) -> Iterator[Mutation]:
        """All mutations of the module."""
        yield from self._of(ast.parse(self._text))

    def _of(self, node: ast.AST) -> Iterator[Mutation]:
        if isinstance(node, (ast.Raise, ast.JoinedStr, ast.Import, ast.ImportFrom, ast.Assert)):
            return
        rule = getattr(self, f"_{type(node).__name__.lower()}", None)
        if rule is not None:
            yield from rule(node)
        for name, value in ast.iter_fields(node):
            if name in ("annotation", "returns", "decorator_list"):
                continue
            for child in value if isinstance(value, list) else [value]:
                if isinstance(child, ast.AST):
                    yield from self._of(child)

    def _position(self, line: int, column: int) -> int:
        """Offsets of the syntax tree count bytes."""
        text = self._text[self._starts[line - 1] : self._starts[line]]
        return self._starts[line - 1] + len(text.encode()[:column].decode())

    def _span(self, node) -> tuple[int, int]:
        return self._position(node.lineno, node.col_offset), self._position(node.end_lineno, node.end_col_offset)

    def _source(self, node) -> str:
        start, end = self._span(node)
        return self._text[start:end]

    def _replace(self, kind: str, node, new: str) -> Mutation:
        return Mutation(kind, node.lineno, self._span(node)[0], self._source(node), new)

    def _between(self, kind: str, first, second, old: str, new: str) -> Iterator[Mutation]:
        """An operator stands between two operands."""
        start, end = self._span(first)[1], self._span(second)[0]
        at = self._text.find(old, start, end)
        if at >= 0:
            yield Mutation(kind, self._text.count("\n", 0, at) + 1, at, old, new)

    def _binop(self, node: ast.BinOp) -> Iterator[Mutation]:
        if any(is_text(side) for side in (node.left, node.right)):
            return
        if isinstance(node.op, (ast.Add, ast.Sub)):
            old, new = ("+", "-") if isinstance(node.op, ast.Add) else ("-", "+")
            yield from self._between("sign", node.left, node.right, old, new)
            yield self._replace("drop a term", node, f"({self._source(node.left)})")
        if isinstance(node.op, ast.Add):
            yield self._replace("drop a term", node, f"({self._source(node.right)})")
        if isinstance(node.op, (ast.Mult, ast.Div)):
            yield self._replace("halve a factor", node, f"(0.5 * ({self._source(node)}))")

    def _unaryop(self, node: ast.UnaryOp) -> Iterator[Mutation]:
        if isinstance(node.op, ast.USub):
            yield self._replace("sign", node, f"({self._source(node.operand)})")

    def _compare(self, node: ast.Compare) -> Iterator[Mutation]:
        for first, operator, second in zip([node.left, *node.comparators], node.ops, node.comparators, strict=False):
            old = COMPARISONS.get(type(operator))
            if old is not None:
                yield from self._between("flip a strictness", first, second, old, STRICTER[old])

    def _attribute(self, node: ast.Attribute) -> Iterator[Mutation]:
        if node.attr in OTHER_END and node not in self._texts:
            end = self._span(node)[1]
            start = end - len(node.attr)
            yield Mutation("exchange an end", node.end_lineno, start, node.attr, OTHER_END[node.attr])

    def _name(self, node: ast.Name) -> Iterator[Mutation]:
        if node.id in ("min", "max", "any", "all") and isinstance(node.ctx, ast.Load):
            yield self._replace("exchange an end", node, OTHER_END[node.id])

    def _call(self, node: ast.Call) -> Iterator[Mutation]:
        if isinstance(node.func, ast.Attribute) and node.func.attr in ("lower", "upper"):
            self._texts.add(node.func)
        if self._source(node.func) in ("np.abs", "abs") and len(node.args) == 1:
            yield self._replace("sign", node, f"({self._source(node.args[0])})")
        if self._source(node.func) == "np.nextafter":
            yield self._replace("drop a term", node, f"({self._source(node.args[0])})")

    def _subscript(self, node: ast.Subscript) -> Iterator[Mutation]:
        for index in ast.walk(node.slice):
            if isinstance(index, ast.Constant) and type(index.value) is int:
                yield self._replace("off by one", index, str(index.value + 1))


def is_text(node: ast.AST) -> bool:
    """Whether a sum joins texts, lists or tuples."""
    if isinstance(node, ast.BinOp):
        return is_text(node.left) or is_text(node.right)
    return isinstance(node, (ast.JoinedStr, ast.List, ast.Tuple)) or (
        isinstance(node, ast.Constant) and isinstance(node.value, (str, bytes))
    )


#: pattern of Slang's code, kind of mutation, and new text (a function of the match)
SLANG_PATTERNS = [
    (
        r"\b(?:min|max|any|all|floor|ceil|lower|upper)(?=\()|(?<=\.)(?:lower|upper)\b",
        "exchange an end",
        lambda m: OTHER_END[m[0]],
    ),
    (r"(?<= )[<>]=?(?= )", "flip a strictness", lambda m: STRICTER[m[0]]),
    (r"(?<=\[)\d(?=\])", "off by one", lambda m: str(int(m[0]) + 1)),
    (r"(?<= )[+-](?= )", "sign", lambda m: "-" if m[0] == "+" else "+"),
    (r"\babs(?=\()", "sign", lambda m: ""),
    (r"(?<== )-(?=\w)|(?<=return )-(?=\w)", "sign", lambda m: ""),
    (r"\b\d+\.\d+(?:e-?\d+)?(?=lf\b)", "halve a factor", lambda m: repr(0.5 * float(m[0]))),
]
#: what stands before the length of an array that is declared: a longer one is as good
SLANG_DECLARED = re.compile(r"\b(?!return\b|else\b)[A-Za-z]\w* \w+\[$")
SLANG_COMMENT = re.compile(r"//[^\n]*|/\*.*?\*/", re.S)


def slang_mutations(text: str) -> Iterator[Mutation]:
    """Mutations by patterns of the text, comments left out."""
    code = SLANG_COMMENT.sub(lambda m: re.sub(r"[^\n]", " ", m[0]), text)
    for pattern, kind, new in SLANG_PATTERNS:
        for match in re.finditer(pattern, code):
            if kind == "off by one" and SLANG_DECLARED.search(code, max(0, match.start() - 80), match.start()):
                continue
            yield Mutation(kind, code.count("\n", 0, match.start()) + 1, match.start(), match[0], new(match))
    for match in re.finditer(r" [+-] ", code):
        end = term_end(code, match.end())
        line = code.count("\n", 0, match.start()) + 1
        yield Mutation("drop a term", line, match.start(), text[match.start() : end], "")


def term_end(code: str, start: int) -> int:
    """Where a term of a sum ends: at the next sign, comma or closing bracket outside brackets."""
    depth = 0
    for at in range(start, len(code)):
        letter = code[at]
        depth += (letter in "([{") - (letter in ")]}")
        ends = depth < 0 or (depth == 0 and (letter in ",;?:<>=&|" or code[at : at + 3] in (" + ", " - ")))
        if ends:
            return at - (code[at - 1] == " ")
    return len(code)
