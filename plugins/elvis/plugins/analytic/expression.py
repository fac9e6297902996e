"""Functions of x, y and z in closed form, read from text: evaluated in NumPy, and written as Slang.

sum      = product (("+" | "-") product)*
product  = signed (("*" | "/") signed)*
signed   = ("+" | "-") signed | power
power    = operand ("^" signed)?
operand  = number | name | name "(" sum ("," sum)* ")" | "(" sum ")"
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from elvis.formats.arrays import Floats
from elvis.formats.errors import ElvisError

#: an operator or function and its operands, a coordinate, or a number
Node: TypeAlias = "tuple[Any, ...] | str | float"

#: number of operands, NumPy's function, and Slang's
FUNCTIONS: dict[str, tuple[int, Callable[..., Any], str]] = {
    "abs": (1, np.abs, "abs"),
    "sqrt": (1, np.sqrt, "sqrt"),
    "sin": (1, np.sin, "sine"),
    "cos": (1, np.cos, "cosine"),
    "tan": (1, np.tan, "tangent"),
    "exp": (1, np.exp, "exponential"),
    "log": (1, np.log, "logarithm"),
    "sinh": (1, np.sinh, "hyperbolic_sine"),
    "cosh": (1, np.cosh, "hyperbolic_cosine"),
    "tanh": (1, np.tanh, "hyperbolic_tangent"),
    "min": (2, np.minimum, "min"),
    "max": (2, np.maximum, "max"),
}
_OPERATORS: dict[str, Callable[..., Any]] = {
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "^": np.power,
}
CONSTANTS = {"pi": float(np.pi), "e": float(np.e)}
COORDINATES = ("x", "y", "z")

_TOKEN = re.compile(r"\s*(?:(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)|([A-Za-z_]\w*)|(\S))")
_LONGEST, _DEEPEST = 500, 60


@dataclass(frozen=True)
class Expression:
    """A function of world points."""

    text: str
    tree: Node

    @staticmethod
    def parse(text: str) -> Expression:
        """The function that the text says; ElvisError that tells where it isn't one."""
        return Expression(text, _Parser(text).whole())

    def __call__(self, points: Floats) -> Floats:
        """(n,) values at points (n, 3); NaN or infinite where the function has no value."""
        with np.errstate(all="ignore"):
            return np.asarray(np.broadcast_to(_value(self.tree, points), len(points)), np.float64)

    def derivative(self, coordinate: str) -> Expression:
        """The partial derivative with respect to ``x``, ``y`` or ``z``."""
        return Expression(f"d({self.text}, {coordinate})", _derivative(self.tree, coordinate))

    def slang(self, point: str = "p") -> str:
        """The same as an expression of a ``double3`` in Slang, with the functions of ``elementary``."""
        return _slang(self.tree, point)


def _value(node: Node, points: Floats) -> Any:
    if isinstance(node, str):
        return points[:, COORDINATES.index(node)]
    if isinstance(node, float):
        return np.float64(node)
    name, *operands = node
    if name == "step":
        return np.where(_value(operands[0], points) < _value(operands[1], points), 1.0, 0.0)
    function = _OPERATORS[name] if name in _OPERATORS else FUNCTIONS[name][1]
    return function(*(_value(operand, points) for operand in operands))


def _derivative(node: Node, coordinate: str) -> Node:
    if isinstance(node, str | float):
        return float(node == coordinate)
    name, *operands = node
    inner = [_derivative(operand, coordinate) for operand in operands]
    terms = [("*", rule, moved) for rule, moved in zip(_partials(name, *operands), inner, strict=True) if moved != 0.0]
    return ("+", *terms) if len(terms) == 2 else terms[0] if terms else 0.0


def _partials(name: str, a: Node, b: Node = 0.0) -> list[Node]:
    """Partial derivatives of an operator or function with respect to its operands."""
    step: Node = ("step", a, b)
    whole: dict[str, list[Node]] = {
        "+": [1.0, 1.0],
        "-": [1.0, -1.0],
        "*": [b, a],
        "/": [("/", 1.0, b), ("-", 0.0, ("/", a, ("^", b, 2.0)))],
        "min": [step, ("-", 1.0, step)],
        "max": [("-", 1.0, step), step],
        "abs": [("-", ("*", 2.0, ("step", 0.0, a)), 1.0)],
        "sqrt": [("/", 0.5, ("sqrt", a))],
        "sin": [("cos", a)],
        "cos": [("-", 0.0, ("sin", a))],
        "tan": [("+", 1.0, ("^", ("tan", a), 2.0))],
        "exp": [("exp", a)],
        "log": [("/", 1.0, a)],
        "sinh": [("cosh", a)],
        "cosh": [("sinh", a)],
        "tanh": [("-", 1.0, ("^", ("tanh", a), 2.0))],
    }
    if name == "^":
        lower = b - 1.0 if isinstance(b, float) else ("-", b, 1.0)
        rest: Node = 0.0 if isinstance(b, float) else ("*", ("^", a, b), ("log", a))
        return [("*", b, ("^", a, lower)), rest]
    return whole[name]


def _slang(node: Node, point: str) -> str:
    if isinstance(node, str):
        return f"{point}.{node}"
    if isinstance(node, float):
        return f"{node!r}lf"
    name, *operands = node
    inner = [_slang(operand, point) for operand in operands]
    if name == "step":
        return f"({inner[0]} < {inner[1]} ? 1.0lf : 0.0lf)"
    if name == "^":
        exponent = operands[1]
        whole = isinstance(exponent, float) and exponent.is_integer() and abs(exponent) <= 1024
        return f"integer_power({inner[0]}, {int(exponent)})" if whole else f"power({inner[0]}, {inner[1]})"
    if name in _OPERATORS:
        return f"({inner[0]} {name} {inner[1]})"
    return f"{FUNCTIONS[name][2]}({', '.join(inner)})"


class _Parser:
    """Recursive descent, a method for each rule of the grammar."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._tokens = [(match.group(1, 2, 3), match.start(match.lastindex or 0)) for match in _TOKEN.finditer(text)]
        self._next = self._depth = 0
        if len(self._tokens) > _LONGEST:
            raise ElvisError(f"expected an expression of at most {_LONGEST} words, found {len(self._tokens)}")

    def whole(self) -> Node:
        node = self._sum()
        if self._next < len(self._tokens):
            raise self._unexpected("an operator")
        return node

    def _sum(self) -> Node:
        node = self._product()
        while sign := self._take("+-"):
            node = (sign, node, self._product())
        return node

    def _product(self) -> Node:
        node = self._signed()
        while sign := self._take("*/"):
            node = (sign, node, self._signed())
        return node

    def _signed(self) -> Node:
        self._deeper()
        sign = self._take("+-")
        node = self._signed() if sign else self._power()
        self._depth -= 1
        if sign != "-":
            return node
        return -node if isinstance(node, float) else ("-", 0.0, node)

    def _power(self) -> Node:
        node = self._operand()
        return ("^", node, self._signed()) if self._take("^") else node

    def _operand(self) -> Node:
        if self._take("("):
            return self._arguments(1)[0]
        number, name, _ = self._token()
        if number:
            self._next += 1
            return float(number)
        if not name:
            raise self._unexpected("a number, a name or (")
        self._next += 1
        return self._named(name)

    def _named(self, name: str) -> Node:
        if name in COORDINATES:
            return name
        if name in CONSTANTS:
            return CONSTANTS[name]
        if name in FUNCTIONS and self._take("("):
            function: tuple[Any, ...] = (name, *self._arguments(FUNCTIONS[name][0]))
            return function
        self._next -= 1
        raise self._unexpected(f"{', '.join((*COORDINATES, *CONSTANTS))} or {', '.join(FUNCTIONS)} with (")

    def _arguments(self, count: int) -> list[Node]:
        """``count`` sums up to the closing parenthesis."""
        nodes = [self._sum()]
        while self._take(","):
            nodes.append(self._sum())
        if len(nodes) != count or not self._take(")"):
            raise self._unexpected(") after " + ("one operand" if count == 1 else f"{count} operands"))
        return nodes

    def _token(self) -> Sequence[str | None]:
        return self._tokens[self._next][0] if self._next < len(self._tokens) else (None, None, None)

    def _take(self, symbols: str) -> str | None:
        symbol = self._token()[2]
        if not symbol or symbol not in symbols:
            return None
        self._next += 1
        return symbol

    def _deeper(self) -> None:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ElvisError(f"expected an expression of at most {_DEEPEST} levels, found more")

    def _unexpected(self, wanted: str) -> ElvisError:
        if self._next >= len(self._tokens):
            return ElvisError(f"expression {self._text!r}: expected {wanted}, found its end")
        token, place = self._tokens[self._next]
        found = "".join(part or "" for part in token)
        return ElvisError(f"expression {self._text!r}: character {place + 1}: expected {wanted}, found {found!r}")
