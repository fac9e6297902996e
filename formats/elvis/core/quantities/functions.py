"""The operators and functions of expressions: in NumPy, as intervals, and their derivatives.

A function has the value NaN where it isn't defined: for division by zero, roots and logarithms of negative numbers.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from elvis.core.quantities import intervals as i
from elvis.core.quantities.intervals import Interval
from elvis.core.quantities.tree import ONE, ZERO, Node, call, negative, number

Partial = Callable[..., Node]


@dataclass(frozen=True)
class Function:
    """A function of one or two operands.

    numpy     of arrays
    interval  that holds all values which the function has on intervals
    partials  derivative in each operand, from the operands
    """

    numpy: Callable[..., Any]
    interval: Callable[..., Interval]
    partials: tuple[Partial, ...]

    @property
    def arity(self) -> int:
        """The number of operands."""
        return len(self.partials)


def divided(a: Any, b: Any) -> Any:
    """a / b, NaN where b is zero."""
    return np.where(np.equal(b, 0), np.nan, np.divide(a, np.where(np.equal(b, 0), 1.0, b)))


def raised(a: Any, b: Any) -> Any:
    """a^b, NaN for negative powers of zero."""
    return np.where(np.equal(a, 0) & np.less(b, 0), np.nan, np.power(np.asarray(a, np.float64), b))


def logarithm(a: Any) -> Any:
    """The natural logarithm, NaN unless a > 0."""
    return np.where(np.greater(a, 0), np.log(np.where(np.greater(a, 0), a, 1.0)), np.nan)


def _step(a: Node, b: Node) -> Node:
    return call("step", a, b)


def _less_one(a: Node, b: Node) -> Node:
    """b a^(b - 1)."""
    return call("*", b, call("^", a, call("-", b, ONE)))


def _square(a: Node) -> Node:
    return call("*", a, a)


def _reciprocal(a: Node) -> Node:
    return call("/", ONE, a)


def _bell(a: Node) -> Node:
    """1 - a^2."""
    return call("-", ONE, _square(a))


def _length(a: Node, b: Node) -> Node:
    return call("+", _square(a), _square(b))


OPERATORS: Mapping[str, Function] = {
    "+": Function(np.add, i.plus, (lambda a, b: ONE, lambda a, b: ONE)),
    "-": Function(np.subtract, i.minus, (lambda a, b: ONE, lambda a, b: number(-1.0))),
    "*": Function(np.multiply, i.times, (lambda a, b: b, lambda a, b: a)),
    "/": Function(divided, i.over, (lambda a, b: _reciprocal(b), lambda a, b: negative(call("/", a, _square(b))))),
    "^": Function(raised, i.power, (_less_one, lambda a, b: call("*", call("^", a, b), call("log", a)))),
    "step": Function(lambda a, b: np.where(np.less(a, b), 1.0, 0.0), i.step, (lambda a, b: ZERO, lambda a, b: ZERO)),
}

FUNCTIONS: Mapping[str, Function] = {
    "abs": Function(np.abs, i.absolute, (lambda a: call("sign", a),)),
    "sign": Function(np.sign, i.sign, (lambda a: ZERO,)),
    "sqrt": Function(np.sqrt, i.root, (lambda a: call("/", number(0.5), call("sqrt", a)),)),
    "exp": Function(np.exp, i.increasing(np.exp), (lambda a: call("exp", a),)),
    "log": Function(logarithm, i.logarithm, (_reciprocal,)),
    "sin": Function(np.sin, i.sine, (lambda a: call("cos", a),)),
    "cos": Function(np.cos, i.cosine, (lambda a: negative(call("sin", a)),)),
    "tan": Function(np.tan, i.tangent, (lambda a: call("+", ONE, _square(call("tan", a))),)),
    "asin": Function(np.arcsin, i.arcsine, (lambda a: _reciprocal(call("sqrt", _bell(a))),)),
    "acos": Function(np.arccos, i.arccosine, (lambda a: negative(_reciprocal(call("sqrt", _bell(a)))),)),
    "atan": Function(np.arctan, i.increasing(np.arctan), (lambda a: _reciprocal(call("+", ONE, _square(a))),)),
    "sinh": Function(np.sinh, i.increasing(np.sinh), (lambda a: call("cosh", a),)),
    "cosh": Function(np.cosh, i.hyperbolic_cosine, (lambda a: call("sinh", a),)),
    "tanh": Function(np.tanh, i.increasing(np.tanh), (lambda a: _bell(call("tanh", a)),)),
    "atan2": Function(
        np.arctan2,
        i.angle,
        (lambda a, b: call("/", b, _length(a, b)), lambda a, b: negative(call("/", a, _length(a, b)))),
    ),
    "min": Function(np.minimum, i.least, (lambda a, b: _step(a, b), lambda a, b: call("-", ONE, _step(a, b)))),
    "max": Function(np.maximum, i.greatest, (lambda a, b: call("-", ONE, _step(a, b)), lambda a, b: _step(a, b))),
    "pow": Function(raised, i.power, OPERATORS["^"].partials),
}

_EVERY = {**OPERATORS, **FUNCTIONS}


def function(node: Node) -> Function:
    """The function that a part of an expression is."""
    return _EVERY[node.op]


def partials(node: Node) -> list[Callable[[], Node]]:
    """The derivative of an operator or function in each operand, made when it is called for."""
    return [lambda rule=rule: rule(*node.operands) for rule in function(node).partials]  # type: ignore[misc]
