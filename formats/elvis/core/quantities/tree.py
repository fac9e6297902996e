"""Expressions as graphs: every different part is there once, and derivatives are graphs again.

leaves      number (its value), coordinate (its axis), field (its name and the axes that it is differentiated along,
            ascending), attribute (of an element, by name, or of another dataset)
operators   + - * / ^ and the functions of `functions`; ``step(a, b)`` is 1 if a < b, else 0
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar
from weakref import WeakValueDictionary

from elvis.core.base.errors import ElvisError

LEAVES = ("number", "coordinate", "field", "attribute")
AXES = ("x", "y", "z")
#: derivatives of fields that can be evaluated
HIGHEST = 2
#: functions of a field that are one number throughout each element
MEASURES = ("jump", "decay", "tail", "recovered_error")
#: parts of an expression, its derivatives included
MOST = 20000

T = TypeVar("T")


@dataclass(frozen=True, eq=False)
class Node:
    """A part of an expression.  Equal parts are one object, so that they are equal where they are the same.

    op        a leaf's kind, an operator or the name of a function
    operands  of operators and functions
    value     of a number
    name      of a field or attribute
    axes      of a coordinate, or of a field's derivatives
    """

    op: str
    operands: tuple[Node, ...] = ()
    value: float = 0.0
    name: str = ""
    axes: tuple[int, ...] = ()


_known: WeakValueDictionary[tuple[object, ...], Node] = WeakValueDictionary()


def _node(
    op: str, operands: tuple[Node, ...] = (), value: float = 0.0, name: str = "", axes: tuple[int, ...] = ()
) -> Node:
    key = (op, operands, repr(value), name, axes)
    found = _known.get(key)
    if found is None:
        found = _known[key] = Node(op, operands, value, name, axes)
    return found


def number(value: float) -> Node:
    """A constant."""
    return _node("number", value=float(value))


def coordinate(axis: int) -> Node:
    """x, y or z."""
    return _node("coordinate", axes=(axis,))


def field(name: str, axes: Iterable[int] = ()) -> Node:
    """A field, or its derivative along the axes."""
    return _node("field", name=name, axes=tuple(sorted(axes)))


def attribute(name: str) -> Node:
    """An attribute of elements (see `attributes`)."""
    return _node("attribute", name=name)


def other(dataset: str, text: str) -> Node:
    """The value of an expression in another dataset, identified by its name here, at the same position in the world."""
    return attribute(f"{dataset}:{text}")


def other_of(name: str) -> tuple[str, str] | None:
    """The dataset and the text that an attribute names; None for other attributes."""
    found = _OTHER.fullmatch(name)
    return None if found is None else (found[1], found[2])


def target_of(name: str) -> str | None:
    """The surface of an attribute that is a distance to it or a `Direction`; None for other attributes."""
    direction = direction_of(name)
    if direction is not None:
        return direction.target
    return name[9:-1] if name.startswith("distance(") else None


@dataclass(frozen=True)
class Direction:
    """A component of a unit vector that the nearest point of a surface gives.

    axis     0, 1 or 2
    is_away  the vector points away from the surface, on it into the data; otherwise it is the gradient of the distance,
             which is the opposite vector where distances are negative
    """

    target: str
    axis: int
    is_away: bool

    @property
    def attribute(self) -> Node:
        """The attribute, by the name that FieldConvert gives the vector away from a wall."""
        axis = AXES[self.axis]
        text = f"bfc_dir1_{axis}({self.target})" if self.is_away else f"d(distance({self.target}),{axis})"
        return attribute(text)


def direction_of(name: str) -> Direction | None:
    """The direction that an attribute is; None for other attributes."""
    found = _DIRECTION.fullmatch(name)
    if found is None:
        return None
    gradient, axis, away, target = found.groups()
    return Direction(gradient or target, AXES.index(axis or away), gradient is None)


def measured_of(name: str) -> tuple[str, str] | None:
    """The function of `MEASURES` and the field that an attribute is made of; None for other attributes."""
    function, _, rest = name.partition("(")
    return (function, rest[:-1]) if function in MEASURES and rest.endswith(")") else None


def measure_name(function: str, name: str) -> str:
    """The name of the attribute that a function of `MEASURES` makes of a field."""
    return f"{function}({name})"


def jumping_of(name: str) -> str | None:
    """The field whose jumps an attribute is; None for other attributes."""
    return name[5:-1] if name.startswith("jump(") else None


def jump_name(name: str) -> str:
    """The name of the attribute that the jumps of a field are."""
    return f"jump({name})"


def in_dataset(root: Node, dataset: str) -> Node:
    """An expression of fields of another dataset on the same mesh, by the names that these have here."""

    def leaf(node: Node) -> Node:
        return field(f"{dataset}:{node.name}", node.axes) if node.op == "field" else node

    return fold(root, leaf, lambda node, operands: call(node.op, *operands))


_DIRECTION = re.compile(r"d\(distance\((.+)\),([xyz])\)|bfc_dir1_([xyz])\((.+)\)", re.S)
_OTHER = re.compile(r"([^\W\d]\w*):(.+)", re.S)
ZERO, ONE = number(0.0), number(1.0)
#: the time, while an expression is differentiated along it
TIME = coordinate(len(AXES))


def call(op: str, *operands: Node) -> Node:
    """An operator or a function, left out where it changes nothing."""
    rule = _SIMPLER.get(op)
    simpler = rule(*operands) if rule else None
    return _node(op, operands) if simpler is None else simpler


def _sum(a: Node, b: Node) -> Node | None:
    if a.op == b.op == "number":
        return number(a.value + b.value)
    return b if a is ZERO else a if b is ZERO else None


def _difference(a: Node, b: Node) -> Node | None:
    if a.op == b.op == "number":
        return number(a.value - b.value)
    return a if b is ZERO else None


def _product(a: Node, b: Node) -> Node | None:
    if a.op == b.op == "number":
        return number(a.value * b.value)
    if a is ZERO or b is ZERO:
        return ZERO
    return b if a is ONE else a if b is ONE else None


def _quotient(a: Node, b: Node) -> Node | None:
    return a if b is ONE else None


def _power(a: Node, b: Node) -> Node | None:
    return a if b is ONE else ONE if b is ZERO else None


_SIMPLER: Mapping[str, Callable[[Node, Node], Node | None]] = {
    "+": _sum,
    "-": _difference,
    "*": _product,
    "/": _quotient,
    "^": _power,
}


def whole_exponent(node: Node) -> int | None:
    """The exponent of a power, if it is an integer; None otherwise, and for other operations."""
    if node.op != "^":
        return None
    exponent = node.operands[1]
    if exponent.op != "number" or not exponent.value.is_integer():
        return None
    return int(exponent.value)


def negative(a: Node) -> Node:
    """-a."""
    return number(-a.value) if a.op == "number" else call("-", ZERO, a)


def ordered(*roots: Node) -> list[Node]:
    """All parts of some expressions, each once and after its operands; raises ElvisError if there are too many."""
    result: dict[Node, None] = {}
    waiting = list(reversed(roots))
    while waiting:
        node = waiting[-1]
        missing = [operand for operand in node.operands if operand not in result]
        waiting.extend(reversed(missing))
        if not missing:
            result[waiting.pop()] = None
        if len(result) > MOST or len(waiting) > MOST:
            raise ElvisError(f"expected an expression of at most {MOST} parts, derivatives included, found more")
    return list(result)


def fold(root: Node, leaf: Callable[[Node], T], inner: Callable[[Node, list[T]], T]) -> T:
    """Evaluate ``leaf`` at leaves and ``inner`` at all other nodes, from the results of their operands."""
    return fold_all((root,), leaf, inner)[0]


def dot(one: Sequence[Node], other: Sequence[Node]) -> Node:
    """The scalar product of two vectors of expressions."""
    total = ZERO
    for a, b in zip(one, other, strict=True):
        total = call("+", total, call("*", a, b))
    return total


def fold_all(roots: Sequence[Node], leaf: Callable[[Node], T], inner: Callable[[Node, list[T]], T]) -> list[T]:
    """Results of `fold` for several expressions; those of common parts are computed once."""
    found: dict[Node, T] = {}
    for node in ordered(*roots):
        operands = [found[operand] for operand in node.operands]
        found[node] = inner(node, operands) if node.op not in LEAVES else leaf(node)
    return [found[root] for root in roots]


def derivative(root: Node, along: Callable[[Node], Node]) -> Node:
    """The derivative of an expression, given the derivatives of its leaves that aren't numbers."""
    from elvis.core.quantities.functions import partials

    def inner(node: Node, moved: list[Node]) -> Node:
        total = ZERO
        for partial, part in zip(partials(node), moved, strict=True):
            if part is not ZERO:
                total = call("+", total, call("*", partial(), part))
        return total

    return fold(root, lambda leaf: ZERO if leaf.op == "number" else along(leaf), inner)


def world_derivative(root: Node, axis: int) -> Node:
    """The partial derivative along x, y or z; raises ElvisError if a part of it has none that can be evaluated."""

    def along(leaf: Node) -> Node:
        if leaf.op == "coordinate":
            return number(float(leaf.axes == (axis,)))
        if leaf.op == "attribute":
            elsewhere, target = other_of(leaf.name), target_of(leaf.name)
            if target is not None and direction_of(leaf.name) is None:
                return Direction(target, axis, is_away=False).attribute
            if elsewhere is None:
                raise ElvisError(f"there is no derivative of {leaf.name}")
            return other(elsewhere[0], f"d({elsewhere[1]},{AXES[axis]})")
        if len(leaf.axes) == HIGHEST:
            raise ElvisError(f"expected derivatives of at most second order, found a third one of {leaf.name}")
        return field(leaf.name, (*leaf.axes, axis))

    return derivative(root, along)


def time_derivative(root: Node, rate: Callable[[str], Node]) -> Node:
    """The derivative in time, represented by `TIME`, given the derivative of each field.

    Raises ElvisError if a part of it has none.
    """

    def along(leaf: Node) -> Node:
        if leaf.op == "coordinate":
            return ONE if leaf is TIME else ZERO
        if leaf.op == "attribute":
            raise ElvisError(f"there is no derivative of {leaf.name} in time")
        return field(rate(leaf.name).name, leaf.axes)

    return derivative(root, along)


def at_time(root: Node, time: float) -> Node:
    """An expression with `TIME` replaced by a number."""

    def inner(node: Node, operands: list[Node]) -> Node:
        return call(node.op, *operands)

    return fold(root, lambda leaf: number(time) if leaf is TIME else leaf, inner)


def leaves(*roots: Node) -> list[Node]:
    """The leaves that aren't numbers."""
    return [node for node in ordered(*roots) if node.op in LEAVES and node.op != "number"]


def partial(root: Node, leaf: Node) -> Node:
    """The derivative of an expression in one of its leaves."""
    return derivative(root, lambda own: ONE if own is leaf else ZERO)
