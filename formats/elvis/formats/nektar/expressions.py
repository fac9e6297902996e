"""Constant expressions in attributes and parameters: ``1/(2*PI)``, ``sqrt(3)*Scale^2`` (format notes 1.3)."""

from __future__ import annotations

import math
import operator
from collections.abc import Callable, Mapping

from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.base.grammar import Grammar

CONSTANTS: Mapping[str, float] = {
    "PI": math.pi,
    "E": math.e,
    "LOG2E": math.log2(math.e),
    "LOG10E": math.log10(math.e),
    "LN2": math.log(2.0),
    "LN10": math.log(10.0),
    "PI_2": math.pi / 2,
    "PI_4": math.pi / 4,
    "SQRT2": math.sqrt(2.0),
    "SQRT1_2": math.sqrt(0.5),
}

_UNARY = ("sin", "cos", "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "exp", "log", "log10", "sqrt", "ceil")
_FUNCTIONS: Mapping[str, tuple[int, Callable[..., float]]] = {
    **{name: (1, getattr(math, name)) for name in (*_UNARY, "floor")},
    "abs": (1, abs),
    "fabs": (1, abs),
    "sign": (1, lambda x: math.copysign(1.0, x)),
    "atan2": (2, math.atan2),
    "pow": (2, math.pow),
    "min": (2, min),
    "max": (2, max),
    "fmod": (2, math.fmod),
}


_OPERATORS: Mapping[str, Callable[[float, float], float]] = {
    "+": operator.add,
    "-": operator.sub,
    "*": operator.mul,
    "/": operator.truediv,
    "^": math.pow,
}


def evaluate(text: str, parameters: Mapping[str, float] | None = None) -> float:
    """The value of an expression with ``+ - * / ^``, parentheses, functions, constants and parameters.

    Raises FormatError for anything else, an unknown name, or a value that isn't finite.
    """
    try:
        value = _Constant(text, parameters or {}).whole()
    except ElvisError as error:
        raise FormatError(str(error)) from error
    except (ArithmeticError, ValueError) as error:
        raise FormatError(f"expected an expression with a value, found {text!r} ({error})") from error
    if not math.isfinite(value):
        raise FormatError(f"expected an expression with a finite value, found {text!r}")
    return float(value)


class _Constant(Grammar[float]):
    """An expression of numbers, evaluated while it is parsed."""

    def __init__(self, text: str, parameters: Mapping[str, float]) -> None:
        super().__init__(text)
        self._parameters = parameters

    def _number(self, value: float) -> float:
        return value

    def _negative(self, operand: float) -> float:
        return -operand

    def _call(self, operator: str, first: float, second: float) -> float:
        return _OPERATORS[operator](first, second)

    def _resolve(self, name: str, is_quoted: bool) -> float:
        if name in _FUNCTIONS and self._take("("):
            count, function = _FUNCTIONS[name]
            return function(*self._arguments(count))
        for values in (self._parameters, CONSTANTS):
            if name in values:
                return values[name]
        raise self._mistaken(f"expected a known name, found {name!r}")
