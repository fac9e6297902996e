"""Quantities read from text, in the grammar of `elvis.core.grammar`.

In addition to those of `functions` there are d(f, x), the partial derivative, grad(f), the length of the gradient,
laplacian(f), jump(u), the greatest jump of a field across an element's faces, and distance(b), the distance to a
boundary, by name, number or as "all", or to the triangles of a file, whose name stands in quotes.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from elvis.core.errors import ElvisError
from elvis.core.grammar import Grammar
from elvis.core.quantities import predefined
from elvis.core.quantities.functions import FUNCTIONS
from elvis.core.quantities.names import Names
from elvis.core.quantities.tree import AXES, Node, attribute, call, negative, number, world_derivative

#: functions that look into what they are given, and their numbers of operands
SPECIAL = {"d": 2, "grad": 1, "laplacian": 1, "jump": 1, "distance": 1}

T = TypeVar("T")


class Parser(Grammar[Node]):
    """Expressions of a dataset's names, as graphs."""

    def __init__(self, text: str, names: Names) -> None:
        super().__init__(text)
        self._names = names

    def _number(self, value: float) -> Node:
        return number(value)

    def _negative(self, operand: Node) -> Node:
        return negative(operand)

    def _call(self, operator: str, first: Node, second: Node) -> Node:
        return call(operator, first, second)

    def _named(self, name: str, is_quoted: bool) -> Node:
        if not is_quoted and name in (*FUNCTIONS, *SPECIAL) and self._take("("):
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
        rule = predefined.gradient if name == "grad" else predefined.laplacian
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
