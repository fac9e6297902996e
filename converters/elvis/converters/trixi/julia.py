"""The arithmetic of Julia's functions of coordinates, as files of Trixi.jl hold them: read, never executed.

A text defines functions by ``name(x, y) = ...`` or ``function name(x, y) ... end`` and assigns values to names.  Code
other than formulas (loops, conditions on coordinates, other calls) raises FormatError.  Values are arrays with one
entry per point.  Source of the precedences: Julia's manual, "Mathematical Operations and Elementary Functions".
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import reduce
from typing import Any, TypeAlias

import numpy as np

from elvis.core.base.errors import FormatError

#: arrays of values, tuples of them, or functions
Value: TypeAlias = Any
Scope: TypeAlias = dict[str, Value]
Expression: TypeAlias = Callable[[Mapping[str, Value]], Value]

#: the longest text that is read, in characters
_MOST_CHARACTERS = 100_000
#: maximum depth of nested formulas
_DEEPEST = 60
#: maximum number of operations and calls in the evaluation of a text
_MOST_STEPS = 20_000

_TOKEN = re.compile(
    r"(?P<skip>[ \t\r]+|\#=.*?=\#|\#[^\n]*)"
    r"|(?P<number>(?:\d[\d_]*\.?\d*|\.\d+)(?:[eEf][+-]?\d+)?)"
    r"|(?P<name>@?[^\W\d]\w*!?)"
    r"|(?P<operator>\.[-+*/^]=?|->|::|//|[-+*/]=|[=!<>]=|[-+*/^÷%<>=?:,;.()\[\]{}\n]|&&|\|\|)",
    re.S,
)

#: precedence of operators; equal ones are evaluated from the left, powers from the right
_BINDING = {"?": 1, "<": 3, ">": 3, "<=": 3, ">=": 3, "==": 3, "!=": 3, "+": 5, "-": 5, "*": 7, "/": 7, "÷": 7, "%": 7}
_BINDING |= {"//": 8, "^": 11}
#: signs, and factors that are written next to each other, as in ``2x``
_SIGN, _NEXT_TO = 9, 10

_OPERATORS: dict[str, Callable[[Any, Any], Any]] = {
    "<": np.less,
    ">": np.greater,
    "<=": np.less_equal,
    ">=": np.greater_equal,
    "==": np.equal,
    "!=": np.not_equal,
    "+": np.add,
    "-": np.subtract,
    "*": np.multiply,
    "/": np.divide,
    "//": np.divide,
    "÷": np.floor_divide,
    "%": np.fmod,
    "^": np.power,
}

#: functions of one value, by NumPy's name where it is another
_SAME = ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp", "sqrt", "abs", "sign", "floor", "ceil", "log", "log2")
_UNARY = {name: name for name in (*_SAME, "log10", "log1p", "expm1", "cbrt", "deg2rad")}
_UNARY |= {"asin": "arcsin", "acos": "arccos", "abs2": "square", "one": "ones_like", "zero": "zeros_like"}


def _of_one(name: str) -> Callable[[Any], Any]:
    function = getattr(np, name)
    return lambda value: function(value)


def _folded(operator: Callable[[Any, Any], Any]) -> Callable[..., Any]:
    return lambda first, *others: reduce(operator, others, first)


_FUNCTIONS: dict[str, Callable[..., Any]] = {
    **{name: _of_one(own) for name, own in _UNARY.items()},
    "hypot": lambda x, y: np.hypot(x, y),
    "atan": lambda y, x=None: np.arctan(y) if x is None else np.arctan2(y, x),
    "sinpi": lambda x: np.sin(np.pi * x),
    "cospi": lambda x: np.cos(np.pi * x),
    "min": _folded(np.minimum),
    "max": _folded(np.maximum),
    "ifelse": lambda condition, first, second: np.where(condition, first, second),
    "SVector": lambda *values: _Vector(values),
    "Float64": lambda value: value,
    "RealT": lambda value: value,
    "float": lambda value: value,
    "convert": lambda _, value: value,
}
_CONSTANTS = {"pi": np.pi, "π": np.pi, "ℯ": np.e}

#: words that begin code other than formulas, and words before an assignment that have no effect here
_NO_FORMULAS = ("if", "for", "while", "let", "begin", "do", "try", "quote", "struct", "using", "import", "module")
_PASSED_OVER = ("const", "local", "global")

#: the place of the counter of steps among the names of a text
_COUNTER = ""


class _Vector(tuple[Value, ...]):
    """Components, with the arithmetic of vectors."""

    __slots__ = ()


class _Counter:
    """Number of steps of an evaluation."""

    def __init__(self) -> None:
        self.steps = 0

    def count(self) -> None:
        """One more; raises FormatError if there are too many."""
        self.steps += 1
        if self.steps > _MOST_STEPS:
            raise FormatError(f"expected formulas of at most {_MOST_STEPS} steps, found more")


@dataclass(frozen=True)
class Function:
    """A function of a text: its body with the names that it was defined next to."""

    parameters: Sequence[str]
    body: Expression
    outer: Mapping[str, Value]

    def __call__(self, *values: Value) -> Value:
        """The value at arguments; raises FormatError for another number of them."""
        if len(values) != len(self.parameters):
            raise FormatError(f"expected {len(self.parameters)} arguments, found {len(values)}")
        return self.body({**self.outer, **dict(zip(self.parameters, values, strict=True))})


def definitions(code: str, known: Mapping[str, Value]) -> Scope:
    """The names that a text defines; raises FormatError if it contains more than formulas.

    known  additional functions that it may call
    """
    if len(code) > _MOST_CHARACTERS:
        raise FormatError(f"expected a text of at most {_MOST_CHARACTERS} characters, found {len(code)}")
    reader = _Reader(_tokens(code))
    statements = reader.statements(("",))
    scope: Scope = {**_CONSTANTS, **_FUNCTIONS, **known, _COUNTER: _Counter()}
    with _formulas():
        _run(statements, scope)
    return scope


def evaluated(function: Value, points: Sequence[Any]) -> list[Any]:
    """The components of a function at points, an array for each coordinate; raises FormatError if it has none.

    Raises FormatError for values that are not numbers or not finite.
    """
    with _formulas():
        found = function(*points)
        parts = list(found) if isinstance(found, tuple) else [found]
        arrays = [np.broadcast_to(np.asarray(part, np.float64), points[0].shape) for part in parts]
    if not all(np.isfinite(array).all() for array in arrays):
        raise FormatError("expected finite coordinates, found others")
    return arrays


@contextmanager
def _formulas() -> Iterator[None]:
    """Context for evaluating formulas of a file; raises FormatError for invalid ones."""
    try:
        with np.errstate(all="ignore"):
            yield
    except RecursionError:
        raise FormatError("expected functions that don't call themselves, found some") from None
    except (TypeError, ValueError):
        raise FormatError("expected formulas of numbers and of functions with their arguments, found others") from None


#: a name and its value, or an empty name for a returned value
_Statement: TypeAlias = tuple[Sequence[str], Expression]


def _run(statements: Sequence[_Statement], scope: Scope) -> Value:
    """The value of the last statement, or of the first that returns."""
    result: Value = None
    for names, expression in statements:
        result = expression(scope)
        if names == ("return",):
            return result
        if len(names) == 1:
            scope[names[0]] = result
        elif names:
            if not isinstance(result, tuple) or len(result) != len(names):
                raise FormatError(f"expected {len(names)} values for {', '.join(names)}, found others")
            scope.update(zip(names, result, strict=True))
    return result


def _tokens(code: str) -> list[str]:
    """Words and signs; lines end with a newline outside brackets."""
    found, place, depth = [], 0, 0
    while place < len(code):
        match = _TOKEN.match(code, place)
        if match is None:
            raise FormatError(f"expected a formula, found {code[place : place + 20]!r}")
        place = match.end()
        word = match.group()
        depth += word in ("(", "[", "{")
        depth -= word in (")", "]", "}")
        if match.lastgroup != "skip" and not (word == "\n" and depth > 0):
            found.append(word)
    return found


@dataclass(eq=False)
class _Reader:
    """Statements and expressions of a list of words."""

    words: Sequence[str]
    place: int = 0
    depth: int = 0

    @property
    def word(self) -> str:
        """The next word, empty at the end."""
        return self.words[self.place] if self.place < len(self.words) else ""

    def take(self, wanted: str | None = None) -> str:
        """Pass the next word; raises FormatError if it isn't the one that is requested."""
        word = self.word
        if not word or (wanted is not None and word != wanted):
            raise FormatError(f"expected {wanted or 'a formula'!r}, found {word or 'the end'!r}")
        self.place += 1
        return word

    def skip(self, *words: str) -> None:
        """Pass all of these words that come next."""
        while self.word and self.word in words:
            self.place += 1

    def statements(self, ends: tuple[str, ...]) -> list[_Statement]:
        """Statements up to one of the words that end them."""
        found = []
        self.skip("\n", ";")
        while self.word not in ends:
            found.append(self.statement())
            if self.word not in (*ends, "\n", ";"):
                raise FormatError(f"expected the end of a statement, found {self.word or 'the end'!r}")
            self.skip("\n", ";")
        return found

    def statement(self) -> _Statement:
        """A definition, an assignment, or a value."""
        while self.word.startswith("@") or self.word in _PASSED_OVER:
            self.take()
        if self.word == "function":
            self.take()
            return self._function()
        if self.word == "return":
            self.take()
            return ("return",), self._values()
        short = self._short_function()
        if short is not None:
            return short
        names = self._targets()
        if names:
            return names, self._values()
        return self._update() or ((), self._values())

    def _values(self) -> Expression:
        """A value, or several with commas between them, which make a tuple."""
        parts = [self.expression()]
        while self.word == ",":
            self.take()
            parts.append(self.expression())
        return parts[0] if len(parts) == 1 else _tuple(parts)

    def _function(self) -> _Statement:
        name = self.take()
        parameters = self._parameters()
        statements = self.statements(("end", ""))
        self.take("end")
        return (name,), _closure(parameters, lambda scope: _run(statements, dict(scope)))

    def _short_function(self) -> _Statement | None:
        """``name(x) = value``; None if something else comes."""
        start = self.place
        name = self.word
        if name.isidentifier() and self.words[start + 1 : start + 2] == ["("]:
            self.take()
            try:
                parameters = self._parameters()
            except FormatError:
                parameters = None
            if parameters is not None and self.word == "=":
                self.take()
                self.skip("\n")
                return (name,), _closure(parameters, self._values())
        self.place = start
        return None

    def _parameters(self) -> list[str]:
        """Names in brackets; their types are skipped."""
        self.take("(")
        found = []
        while self.word != ")":
            name = self.take()
            if not name.isidentifier():
                raise FormatError(f"expected the name of an argument, found {name!r}")
            found.append(name)
            if self.word == "::":
                self.take()
                self.take()
            if self.word != ")":
                self.take(",")
        self.take(")")
        return found

    def _targets(self) -> tuple[str, ...]:
        """Names before an equals sign, which is passed; none if something else comes."""
        start, names = self.place, []
        while self.word.isidentifier():
            names.append(self.take())
            if self.word == "=":
                self.take()
                self.skip("\n")
                return tuple(names)
            if self.word != ",":
                break
            self.take()
        self.place = start
        return ()

    def _update(self) -> _Statement | None:
        """``name += value`` and the like."""
        name = self.word
        sign = self.words[self.place + 1] if self.place + 1 < len(self.words) else ""
        if not name.isidentifier() or sign not in ("+=", "-=", "*=", "/="):
            return None
        self.place += 2
        return (name,), _binary(sign[0], _variable(name), self._values())

    def expression(self, least: int = 0) -> Expression:
        """An expression whose operators bind at least as strongly as ``least``."""
        self.depth += 1
        if self.depth > _DEEPEST:
            raise FormatError(f"expected at most {_DEEPEST} formulas inside each other, found more")
        left = self._operand()
        while True:
            sign = self.word.removeprefix(".") if self.word[:1] == "." and len(self.word) > 1 else self.word
            strength = _BINDING.get(sign, -1)
            if strength < max(least, 1):
                break
            self.take()
            self.skip("\n")
            if sign == "?":
                left = self._choice(left)
            elif sign == "^":
                left = _binary(sign, left, self.expression(_SIGN))
            else:
                left = _binary(sign, left, self.expression(strength + 1))
        self.depth -= 1
        return left

    def _choice(self, condition: Expression) -> Expression:
        first = self.expression()
        self.take(":")
        self.skip("\n")
        second = self.expression()
        return lambda scope: np.where(condition(scope), first(scope), second(scope))

    def _operand(self) -> Expression:
        """A number with what stands next to it, a name, a call, a part of a vector, or a formula in brackets."""
        word = self.take()
        if word in ("-", "+"):
            value = self.expression(_SIGN)
            return value if word == "+" else _binary("*", lambda scope: -1.0, value)
        if word[0].isdigit() or (word[0] == "." and word[1:].isdigit()):
            number = float(word.replace("_", "").replace("f", "e"))
            constant: Expression = lambda scope: number  # noqa: E731
            if self.word.isidentifier() or self.word == "(":
                return _binary("*", constant, self.expression(_NEXT_TO))
            return constant
        if word == "(":
            return self._tail(self._bracket())
        if not word.isidentifier() or word in _NO_FORMULAS:
            raise FormatError(f"expected a formula, found {word!r}")
        if self.word == "->":
            self.take()
            return _closure([word], self.expression())
        return self._tail(_variable(word))

    def _bracket(self) -> Expression:
        """The content of brackets: a value, a tuple, or the arguments of a function without a name."""
        start = self.place - 1
        parts = self._list(")")
        if self.word == "->":
            self.place = start
            parameters = self._parameters()
            self.take("->")
            return _closure(parameters, self.expression())
        is_tuple = len(parts) != 1 or self.words[self.place - 2] == ","
        return _tuple(parts) if is_tuple else parts[0]

    def _list(self, end: str) -> list[Expression]:
        parts = []
        while self.word != end:
            parts.append(self.expression())
            if self.word != end:
                self.take(",")
        self.take(end)
        return parts

    def _tail(self, value: Expression) -> Expression:
        """Calls and parts of vectors that follow a value; the types of ``SVector{2}`` are skipped."""
        while self.word in ("(", "[", "{", "."):
            sign = self.take()
            if sign == "(":
                value = _call(value, self._list(")"))
            elif sign == "[":
                value = _part(value, self._list("]"))
            elif sign == "{":
                while self.take() != "}":
                    pass
            elif self.word == "(":  # f.(x)
                continue
            else:
                value = _variable(self.take())
        return value


def _variable(name: str) -> Expression:
    def value(scope: Mapping[str, Value]) -> Value:
        if name not in scope:
            raise FormatError(f"expected a formula of known names, found {name!r}, which the file doesn't define")
        return scope[name]

    return value


def _tuple(parts: Sequence[Expression]) -> Expression:
    def value(scope: Mapping[str, Value]) -> Value:
        found = _Vector(part(scope) for part in parts)
        if any(isinstance(each, tuple) for each in found):
            raise FormatError("expected vectors of numbers or functions, found vectors inside a vector")
        return found

    return value


def _closure(parameters: Sequence[str], body: Expression) -> Expression:
    return lambda scope: Function(parameters, body, scope)


def _binary(sign: str, left: Expression, right: Expression) -> Expression:
    operator = _OPERATORS[sign]

    def value(scope: Mapping[str, Value]) -> Value:
        scope[_COUNTER].count()
        return _applied(operator, left(scope), right(scope))

    return value


def _applied(operator: Callable[[Any, Any], Any], left: Value, right: Value) -> Value:
    """An operator on numbers, on vectors of equal length, or on a vector and a number."""
    if not isinstance(left, tuple) and not isinstance(right, tuple):
        return operator(np.asarray(left, np.float64), np.asarray(right, np.float64))
    count = len(left) if isinstance(left, tuple) else len(right)
    lefts = left if isinstance(left, tuple) else (left,) * count
    rights = right if isinstance(right, tuple) else (right,) * count
    if len(lefts) != len(rights):
        raise FormatError(f"expected vectors of equal length, found {len(lefts)} and {len(rights)}")
    return _Vector(_applied(operator, one, other) for one, other in zip(lefts, rights, strict=True))


def _call(function: Expression, arguments: Sequence[Expression]) -> Expression:
    def value(scope: Mapping[str, Value]) -> Value:
        scope[_COUNTER].count()
        known = function(scope)
        if not callable(known):
            raise FormatError("expected a function before brackets, found a value")
        return known(*(argument(scope) for argument in arguments))

    return value


def _part(vector: Expression, index: Sequence[Expression]) -> Expression:
    def value(scope: Mapping[str, Value]) -> Value:
        known, numbers = vector(scope), [own(scope) for own in index]
        is_whole = len(numbers) == 1 and np.ndim(numbers[0]) == 0 and float(numbers[0]).is_integer()
        if not isinstance(known, tuple) or not is_whole or not 1 <= numbers[0] <= len(known):
            raise FormatError("expected a part of a vector by its number, found something else")
        return known[int(numbers[0]) - 1]

    return value
