"""Expressions read from text.

sum      = product (("+" | "-") product)*
product  = signed (("*" | "/") signed)*
signed   = ("+" | "-") signed | power
power    = operand ("^" signed)?
operand  = number | name | function "(" sum ("," sum)* ")" | "(" sum ")"

A name that is no word stands in quotes.  Beside the functions of `functions` there are d(f, x), the partial derivative,
grad(f), the length of the gradient, laplacian(f), jump(u), the greatest jump of a field across an element's faces, and
distance(b), the distance to a boundary, by name, number or as "all", or to the triangles of a file, whose name stands
in quotes.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from math import isfinite
from typing import TypeVar

from elvis.core.errors import ElvisError
from elvis.core.quantities import ready
from elvis.core.quantities.functions import FUNCTIONS
from elvis.core.quantities.names import Names
from elvis.core.quantities.tree import AXES, Node, attribute, call, negative, number, world_derivative

#: functions that look into what they are given, and their numbers of operands
SPECIAL = {"d": 2, "grad": 1, "laplacian": 1, "jump": 1, "distance": 1}

_TOKEN = re.compile(
    r"\s*(?:(?P<number>\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)|(?P<name>[^\W\d]\w*)"
    r"|(?P<quoted>\"[^\"]*\"|'[^']*')|(?P<symbol>\S))"
)
_LONGEST, _DEEPEST = 1000, 60
#: characters of an expression that messages repeat
_SHOWN = 80

T = TypeVar("T")


class Parser:
    """Recursive descent, a method for each rule of the grammar."""

    def __init__(self, text: str, names: Names) -> None:
        self._text, self._names = text, names
        self._tokens = [
            (str(found.lastgroup), found[found.lastgroup or 0], found.start(found.lastgroup or 0))
            for found in _TOKEN.finditer(text)
        ]
        self._next = self._depth = 0
        if len(self._tokens) > _LONGEST:
            raise ElvisError(f"expected an expression of at most {_LONGEST} words, found {len(self._tokens)}")

    def whole(self) -> Node:
        """The expression; ElvisError that tells where it isn't one."""
        node = self._sum()
        if self._next < len(self._tokens):
            raise self._unexpected("an operator")
        return node

    def _sum(self) -> Node:
        node = self._product()
        while sign := self._take("+-"):
            node = call(sign, node, self._product())
        return node

    def _product(self) -> Node:
        node = self._signed()
        while sign := self._take("*/"):
            node = call(sign, node, self._signed())
        return node

    def _signed(self) -> Node:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ElvisError(f"expected an expression of at most {_DEEPEST} levels, found more")
        sign = self._take("+-")
        node = self._signed() if sign else self._power()
        self._depth -= 1
        return negative(node) if sign == "-" else node

    def _power(self) -> Node:
        node = self._operand()
        return call("^", node, self._signed()) if self._take("^") else node

    def _operand(self) -> Node:
        if self._take("("):
            return self._arguments(1)[0]
        kind, text, _ = self._token()
        if kind not in ("number", "name", "quoted"):
            raise self._unexpected("a number, a name or (")
        self._next += 1
        if kind == "number":
            if not isfinite(float(text)):
                raise self._mistaken(f"expected a number of double precision, found {text}")
            return number(float(text))
        name = text if kind == "name" else text[1:-1]
        if kind == "name" and name in (*FUNCTIONS, *SPECIAL) and self._take("("):
            return self._called(name)
        node = self._guarded(lambda: self._names.meaning(name))
        if node is None:
            raise self._mistaken(self._sentence(name))
        return node

    def _sentence(self, name: str) -> str:
        """What is wrong with a name that says nothing."""
        if name in (*FUNCTIONS, *SPECIAL):
            return f"expected ( after {name}"
        if self._token()[1] == "(":
            return f"there is no function {name!r}; there are {', '.join((*FUNCTIONS, *SPECIAL))}"
        return self._names.unknown(name)

    def _called(self, name: str) -> Node:
        """A function, the parenthesis after its name taken."""
        first = self._next - 2
        if name == "d":
            return self._derivative()
        if name == "distance":
            return self._distance()
        if name in FUNCTIONS:
            return call("^" if name == "pow" else name, *self._arguments(FUNCTIONS[name].arity))
        (of,) = self._arguments(1)
        if name == "jump":
            if of.op != "field" or of.axes:
                raise self._mistaken("expected a field in jump(…)", first)
            return attribute(f"jump({of.name})")
        rule = ready.gradient if name == "grad" else ready.laplacian
        return self._guarded(lambda: rule(of, self._names.dimension), first)

    def _derivative(self) -> Node:
        """d(f, x) from its first operand on."""
        first, of = self._next - 2, self._sum()
        if not self._take(","):
            raise self._unexpected(", and a coordinate")
        axis = self._token()[1]
        if axis not in AXES:
            raise self._unexpected("x, y or z")
        self._next += 1
        if not self._take(")"):
            raise self._unexpected(")")
        return self._guarded(lambda: world_derivative(of, AXES.index(axis)), first)

    def _distance(self) -> Node:
        """distance(b) from its operand on."""
        kind, text, _ = self._token()
        if kind not in ("name", "quoted", "number"):
            raise self._unexpected("a boundary, or a file in quotes")
        self._next += 1
        node = self._guarded(lambda: self._names.distance(text[1:-1] if kind == "quoted" else text))
        if not self._take(")"):
            raise self._unexpected(") after a boundary, or quotes around a file")
        return node

    def _guarded(self, work: Callable[[], T], first: int | None = None) -> T:
        """What ``work`` makes; its errors are said to be at a token."""
        try:
            return work()
        except ElvisError as error:
            raise self._mistaken(str(error), first) from error

    def _arguments(self, count: int) -> list[Node]:
        """``count`` sums up to the closing parenthesis."""
        nodes = [self._sum()]
        while self._take(","):
            nodes.append(self._sum())
        if len(nodes) != count or not self._take(")"):
            raise self._unexpected(") after " + ("one operand" if count == 1 else f"{count} operands"))
        return nodes

    def _token(self) -> tuple[str, str, int]:
        return self._tokens[self._next] if self._next < len(self._tokens) else ("end", "", len(self._text))

    def _take(self, symbols: str) -> str | None:
        kind, symbol, _ = self._token()
        if kind != "symbol" or symbol not in symbols:
            return None
        self._next += 1
        return symbol

    def _unexpected(self, wanted: str) -> ElvisError:
        kind, text, _ = self._token()
        found = "its end" if kind == "end" else repr(text)
        return self._mistaken(f"expected {wanted}, found {found}", self._next)

    def _mistaken(self, sentence: str, token: int | None = None) -> ElvisError:
        """An error at a token, the last one that was taken by default."""
        token = self._next - 1 if token is None else token
        text = self._text if len(self._text) <= _SHOWN else self._text[:_SHOWN] + "…"
        if token >= len(self._tokens):
            return ElvisError(f"expression {text!r}: {sentence}")
        return ElvisError(f"expression {text!r}: character {self._tokens[token][2] + 1}: {sentence}")
