"""The grammar of expressions read from text; subclasses define the values.

sum      = product (("+" | "-") product)*
product  = signed (("*" | "/") signed)*
signed   = ("+" | "-") signed | power
power    = operand ("^" signed)?
operand  = number | name | function "(" sum ("," sum)* ")" | "(" sum ")"

Names that are not identifiers must be quoted.  A sign binds less than a power: -2^2 is -4.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from math import isfinite
from typing import Generic, TypeVar

from elvis.core.base.errors import ElvisError
from elvis.core.base.texts import check_name

_TOKEN = re.compile(
    r"\s*(?:(?P<number>\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)|(?P<name>[^\W\d]\w*)"
    r"|(?P<quoted>\"[^\"]*\"|'[^']*')|(?P<symbol>\S))"
)
_LONGEST, _DEEPEST = 1000, 60
#: characters of an expression that messages repeat
_SHOWN = 80

Value = TypeVar("Value")


class Grammar(ABC, Generic[Value]):
    """Recursive descent, a method for each rule; nothing of the text is executed, its length and depth are limited."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._tokens = [
            (str(found.lastgroup), found[found.lastgroup or 0], found.start(found.lastgroup or 0))
            for found in _TOKEN.finditer(text)
        ]
        self._next = self._depth = 0
        if len(self._tokens) > _LONGEST:
            raise ElvisError(f"expected an expression of at most {_LONGEST} tokens, found {len(self._tokens)}")
        for _, token, _ in self._tokens:
            check_name(token.strip("\"'"), "a part of an expression")

    @abstractmethod
    def _number(self, value: float) -> Value:
        """The value of a number."""

    @abstractmethod
    def _negative(self, operand: Value) -> Value:
        """The value of minus the operand."""

    @abstractmethod
    def _call(self, operator: str, first: Value, second: Value) -> Value:
        """The value of one of ``+ - * / ^`` applied to its operands."""

    @abstractmethod
    def _resolve(self, name: str, is_quoted: bool) -> Value:
        """The value of a name, whose token has been consumed; a function must consume its operands."""

    def whole(self) -> Value:
        """The expression; raises ElvisError with the position if the text is not an expression."""
        value = self._sum()
        if self._next < len(self._tokens):
            raise self._unexpected("an operator")
        return value

    def _sum(self) -> Value:
        value = self._product()
        while sign := self._take("+-"):
            value = self._call(sign, value, self._product())
        return value

    def _product(self) -> Value:
        value = self._signed()
        while sign := self._take("*/"):
            value = self._call(sign, value, self._signed())
        return value

    def _signed(self) -> Value:
        self._depth += 1
        if self._depth > _DEEPEST:
            raise ElvisError(f"expected an expression of at most {_DEEPEST} levels, found more")
        sign = self._take("+-")
        value = self._signed() if sign else self._power()
        self._depth -= 1
        return self._negative(value) if sign == "-" else value

    def _power(self) -> Value:
        value = self._operand()
        return self._call("^", value, self._signed()) if self._take("^") else value

    def _operand(self) -> Value:
        if self._take("("):
            return self._arguments(1)[0]
        kind, text, _ = self._token()
        if kind not in ("number", "name", "quoted"):
            raise self._unexpected("a number, a name or (")
        self._next += 1
        if kind != "number":
            return self._resolve(text if kind == "name" else text[1:-1], kind == "quoted")
        if not isfinite(float(text)):
            raise self._mistaken(f"expected a number of double precision, found {text}")
        return self._number(float(text))

    def _arguments(self, count: int) -> list[Value]:
        """``count`` sums up to the closing parenthesis."""
        values = [self._sum()]
        while self._take(","):
            values.append(self._sum())
        wanted = "one operand" if count == 1 else f"{count} operands"
        if len(values) != count and self._token()[1] == ")":
            raise self._mistaken(f"expected {wanted}, found {len(values)}", self._next)
        if len(values) != count or not self._take(")"):
            raise self._unexpected(f") after {wanted}")
        return values

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
