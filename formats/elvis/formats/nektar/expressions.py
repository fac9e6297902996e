"""Constant expressions in attributes and parameters: ``1/(2*PI)``, ``sqrt(3)*Scale^2`` (format notes 1.3)."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping

from elvis.core.errors import FormatError

_TOKEN = re.compile(r"\s*(?:([0-9]+\.?[0-9]*(?:[eE][+-]?[0-9]+)?|\.[0-9]+(?:[eE][+-]?[0-9]+)?)|([A-Za-z_]\w*)|(\S))")
_LONGEST, _DEEPEST = 10_000, 50

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


def evaluate(text: str, parameters: Mapping[str, float] | None = None) -> float:
    """The value of an expression with ``+ - * / ^``, parentheses, functions, constants and parameters.

    FormatError for anything else, an unknown name, or a value that isn't finite.
    """
    if len(text) > _LONGEST:
        raise FormatError(f"expected an expression, found {len(text)} characters")
    try:
        value = _Parser(text, parameters or {}).whole()
    except (ArithmeticError, ValueError) as error:
        raise FormatError(f"expected an expression with a value, found {text!r} ({error})") from error
    if isinstance(value, complex) or not math.isfinite(value):
        raise FormatError(f"expected an expression with a finite value, found {text!r}")
    return float(value)


class _Parser:
    """Recursive descent, one method a level of precedence: sums, products, signs, powers, operands."""

    def __init__(self, text: str, parameters: Mapping[str, float]) -> None:
        self._text, self._parameters = text, parameters
        self._tokens = [match.group(1, 2, 3) for match in _TOKEN.finditer(text)]
        self._next, self._depth = 0, 0

    def whole(self) -> float:
        value = self._sum()
        if self._next < len(self._tokens):
            raise self._unexpected()
        return value

    def _sum(self) -> float:
        value = self._product()
        while sign := self._take("+-"):
            value = value + self._product() if sign == "+" else value - self._product()
        return value

    def _product(self) -> float:
        value = self._signed()
        while sign := self._take("*/"):
            value = value * self._signed() if sign == "*" else value / self._signed()
        return value

    def _signed(self) -> float:
        """A sign binds less than a power: -2^2 is -4."""
        negative = False
        while sign := self._take("+-"):
            negative ^= sign == "-"
        return -self._power() if negative else self._power()

    def _power(self) -> float:
        base = self._operand()
        return math.pow(base, self._exponent()) if self._take("^") else base

    def _exponent(self) -> float:
        self._deeper()
        value = self._signed()
        self._depth -= 1
        return value

    def _operand(self) -> float:
        number, name, symbol = self._tokens[self._next] if self._next < len(self._tokens) else (None, None, None)
        self._next += 1
        if number:
            return float(number)
        if name:
            return self._named(name)
        if symbol == "(":
            return self._arguments(1)[0]
        self._next -= 1
        raise self._unexpected()

    def _named(self, name: str) -> float:
        if name in _FUNCTIONS and self._take("("):
            count, function = _FUNCTIONS[name]
            return function(*self._arguments(count))
        for values in (self._parameters, CONSTANTS):
            if name in values:
                return values[name]
        raise FormatError(f"expected a known name in the expression {self._text!r}, found {name!r}")

    def _arguments(self, count: int) -> list[float]:
        """``count`` sums up to the closing parenthesis."""
        self._deeper()
        values = [self._sum()]
        while self._take(","):
            values.append(self._sum())
        if not self._take(")") or len(values) != count:
            raise self._unexpected()
        self._depth -= 1
        return values

    def _take(self, symbols: str) -> str | None:
        symbol = self._tokens[self._next][2] if self._next < len(self._tokens) else None
        if not symbol or symbol not in symbols:
            return None
        self._next += 1
        return symbol

    def _deeper(self) -> None:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise FormatError(f"expected an expression of at most {_DEEPEST} levels, found more")

    def _unexpected(self) -> FormatError:
        at_end = self._next >= len(self._tokens)
        found = "its end" if at_end else repr("".join(part or "" for part in self._tokens[self._next]))
        return FormatError(f"expected an operand or operator in the expression {self._text!r}, found {found}")
