"""Quantities read from text, in the grammar of `elvis.core.base.grammar`.

A predefined quantity takes parameters of the flow by name: mach(gamma=1.3).  In addition to `functions` there are

- step(a), which is 1 where a > 0, else 0, and if(a, b, c), which is b where a > 0, else c
- d(f, x), the partial derivative, also d(f, t) of a series
- grad(f), the length of the gradient
- laplacian(f)
- jump(u), the largest jump of a field across an element's faces
- decay(u) and tail(u), the decay rate of a field's modes on an element, and the share of the highest ones
- recovered_error(u), the estimated error of a field's gradient on an element
- truncated(f), which replaces each field of f by the field without its highest modes
- recovered(f), which replaces each field and each derivative in f by a continuous field fitted to it
- abs(E), arg(E), real(E), imag(E) and real(E, degrees) of a complex field, amplitude(E) also of a complex vector
- distance(b), the distance to a boundary, by name, number or as "all", or to the triangles of a file, whose name is
  quoted
- indicator(b, s), the smoothed indicator of a closed file of triangles at the scale s
- u_bfc(b), v_bfc(b), w_bfc(b) and their directions bfc_dir0_x(b), …, with the assisting vector as three numbers after
  b (see `body_fitted`)

ref:p is p in another dataset named ref here; ref:(u^2+v^2) and ref:d(p,x) are expressions in it.  If both share one
mesh, these become fields of the data, by coefficients.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import reduce
from typing import Any, Protocol, TypeVar

from elvis.core.base.errors import ElvisError
from elvis.core.base.grammar import Grammar
from elvis.core.data.complex_fields import Pairs
from elvis.core.quantities.body_fitted import ASSIST, DIRECTIONS, VELOCITIES
from elvis.core.quantities.complex_functions import OF_ONE, is_complex, real_at
from elvis.core.quantities.derived import DERIVED, with_derived_fields
from elvis.core.quantities.flows import PUBLIC
from elvis.core.quantities.functions import FUNCTIONS
from elvis.core.quantities.tree import (
    AXES,
    MEASURES,
    ONE,
    TIME,
    ZERO,
    Node,
    at_time,
    attribute,
    call,
    in_dataset,
    leaves,
    measure_name,
    negative,
    number,
    other,
    time_derivative,
)

#: functions that inspect their arguments, and their numbers of operands
SPECIAL = {
    "step": 1,
    "if": 3,
    "d": 2,
    "grad": 1,
    "laplacian": 1,
    **dict.fromkeys((*MEASURES, *DERIVED), 1),
    "distance": 1,
}
#: functions of a boundary
AT_WALLS = ("distance", "indicator", *VELOCITIES, *DIRECTIONS)

T = TypeVar("T")


class Scope(Protocol):
    """The meaning of names during parsing; see `elvis.core.quantities.names.Names`."""

    @property
    def fields(self) -> tuple[str, ...]: ...  # noqa: D102

    @property
    def dimension(self) -> int: ...  # noqa: D102

    @property
    def others(self) -> Mapping[str, Any]: ...  # noqa: D102

    @property
    def shared(self) -> frozenset[str]: ...  # noqa: D102

    @property
    def places(self) -> tuple[str, ...]: ...  # noqa: D102

    @property
    def complexes(self) -> Pairs: ...  # noqa: D102

    @property
    def phase(self) -> float | None: ...  # noqa: D102

    def meaning(self, name: str) -> Node | None: ...  # noqa: D102

    def quantity(self, name: str, given: Mapping[str, Node]) -> Node: ...  # noqa: D102

    def unknown(self, name: str) -> str: ...  # noqa: D102

    def distance(self, target: str) -> Node: ...  # noqa: D102

    def indicator(self, target: str, scale: float) -> Node: ...  # noqa: D102

    def body_fitted(self, name: str, target: str, assist: Sequence[float]) -> Node: ...  # noqa: D102

    def rate(self, name: str) -> Node: ...  # noqa: D102

    def derivative(self, of: Node, axis: int) -> Node: ...  # noqa: D102


class Parser(Grammar[Node]):
    """Expressions of a dataset's names, as graphs."""

    def __init__(self, text: str, names: Scope) -> None:
        super().__init__(text)
        self._names = names
        self._is_in_time = False

    def _number(self, value: float) -> Node:
        return number(value)

    def _negative(self, operand: Node) -> Node:
        return negative(operand)

    def _call(self, operator: str, first: Node, second: Node) -> Node:
        return call(operator, first, second)

    def _resolve(self, name: str, is_quoted: bool) -> Node:
        if name in self._names.others and self._take(":"):
            return self._elsewhere(name)
        if not is_quoted and name in OF_ONE and self._is_of_complex():
            return self._of_complex(name)
        if not is_quoted and name in (*FUNCTIONS, *SPECIAL, *AT_WALLS) and self._take("("):
            return self._called(name)
        if not is_quoted and name in PUBLIC and name not in self._names.fields and self._take("("):
            first, given = self._next - 2, self._named_values()
            return self._guard(lambda: self._names.quantity(name, given), first)
        node = self._guard(lambda: self._names.meaning(name))
        if name == "t" and self._is_in_time and node is not None and node.op == "number":
            return TIME
        if node is None:
            raise self._mistaken(self._sentence(name))
        return node

    def _is_of_complex(self) -> bool:
        """Whether a parenthesis and the name of a complex field follow."""
        following = self._tokens[self._next : self._next + 3]
        texts = [text for _, text, _ in following]
        return len(texts) == 3 and texts[0] == "(" and texts[2] in ",)" and is_complex(texts[1], self._names.complexes)

    def _of_complex(self, name: str) -> Node:
        """A function of a complex field, from the parenthesis after its name on."""
        first = self._next - 1
        of, pairs = self._tokens[self._next + 1][1], self._names.complexes
        self._next += 2
        if name == "real" and self._take(","):
            degrees = self._sum()
            if degrees.op != "number":
                raise self._mistaken(f"expected a constant phase in degrees after {of}, such as real({of}, 30)", first)
            found = self._guard(lambda: real_at(of, pairs, degrees.value, self._names.phase), first)
        else:
            found = self._guard(lambda: OF_ONE[name](of, pairs), first)
        if not self._take(")"):
            raise self._unexpected(f") after {of}")
        return found

    def _elsewhere(self, name: str) -> Node:
        """An operand in another dataset, the colon taken: the text that it is."""
        scope, first = self._names, self._token()[2]
        self._names = scope.others[name]
        operand = self._operand()
        self._names = scope
        _, last, start = self._tokens[self._next - 1]
        text = self._text[first : start + len(last)]
        if name in scope.shared and not any(leaf.op == "attribute" for leaf in leaves(operand)):
            return in_dataset(operand, name)
        return other(name, text)

    def _sentence(self, name: str) -> str:
        """A message about an unknown name."""
        if name in (*FUNCTIONS, *SPECIAL):
            return f"expected ( after {name}"
        if self._token()[1] == "(":
            if name in OF_ONE:
                return f"{name} takes a complex field; {self._complex_fields}"
            return f"there is no function {name!r}; there are {', '.join((*FUNCTIONS, *SPECIAL))}"
        return self._names.unknown(name)

    @property
    def _complex_fields(self) -> str:
        """The complex fields in words."""
        known = ", ".join(self._names.complexes)
        return f"these are {known}" if known else "the data have none, which are pairs such as E_re and E_im"

    def _called(self, name: str) -> Node:
        """A function, the parenthesis after its name taken."""
        first = self._next - 2
        if name == "d":
            return self._derivative()
        if name in AT_WALLS:
            return self._at_wall(name, first)
        if name in FUNCTIONS:
            return call("^" if name == "pow" else name, *self._arguments(FUNCTIONS[name].arity))
        if name == "step":
            return call("step", ZERO, *self._arguments(1))
        if name == "if":
            return _chosen(*self._arguments(3))
        (of,) = self._arguments(1)
        if name in MEASURES:
            if of.op != "field" or of.axes:
                raise self._mistaken(f"expected a field in {name}(…)", first)
            return attribute(measure_name(name, of.name))
        if name in DERIVED:
            return self._guard(lambda: with_derived_fields(name, of, self._names.places), first)
        rule = _gradient if name == "grad" else _laplacian
        return self._guard(lambda: rule(of, self._names), first)

    def _named_values(self) -> dict[str, Node]:
        """``name=value`` with commas between, up to the closing parenthesis."""
        found: dict[str, Node] = {}
        while True:
            kind, name, _ = self._token()
            if kind != "name":
                raise self._unexpected("the name of a parameter")
            if name in found:
                raise self._unexpected("each parameter once")
            self._next += 1
            if not self._take("="):
                raise self._unexpected(f"= after {name}")
            found[name] = self._sum()
            if not self._take(","):
                break
        if not self._take(")"):
            raise self._unexpected(", or ) after a parameter")
        return found

    def _derivative(self) -> Node:
        """d(f, x) from its first operand on, in which the time is a variable until all are differentiated."""
        first, is_inner = self._next - 2, self._is_in_time
        self._is_in_time = True
        of = self._sum()
        self._is_in_time = is_inner
        if not self._take(","):
            raise self._unexpected(", and a coordinate")
        axis = self._token()[1]
        if axis not in (*AXES, "t"):
            raise self._unexpected("x, y, z or t")
        self._next += 1
        if not self._take(")"):
            raise self._unexpected(")")
        if axis == "t":
            found = self._guard(lambda: time_derivative(of, self._names.rate), first)
        else:
            found = self._guard(lambda: self._names.derivative(of, AXES.index(axis)), first)
        if is_inner or TIME not in leaves(found):
            return found
        # the time of the data, which is known where an expression has it; along paths it stays a variable
        time = self._names.meaning("t")
        assert time is not None
        return found if time is TIME else at_time(found, time.value)

    def _at_wall(self, name: str, first: int) -> Node:
        """A function of a boundary from its operand on."""
        kind, text, _ = self._token()
        if kind not in ("name", "quoted", "number"):
            raise self._unexpected("a boundary, or a file in quotes")
        self._next += 1
        target = text[1:-1] if kind == "quoted" else text
        self._guard(lambda: self._names.distance(target))
        numbers = self._numbers_after(name, target, first)
        if not self._take(")"):
            raise self._unexpected(") after a boundary, or quotes around a file")
        if name == "distance":
            return self._names.distance(target)
        if name == "indicator":
            return self._guard(lambda: self._names.indicator(target, numbers[0]), first)
        return self._guard(lambda: self._names.body_fitted(name, target, numbers or ASSIST), first)

    def _numbers_after(self, name: str, target: str, first: int) -> list[float]:
        """Numbers after a boundary: the scale of an indicator, an assisting vector, or none."""
        count, words = (1, "one number") if name == "indicator" else (len(AXES), "three numbers")
        example = "0.1" if name == "indicator" else "0, 1, 0"
        expected = f"{words} after {target}, such as {name}({target}, {example})"
        found: list[float] = []
        while name != "distance" and len(found) < count and self._take(","):
            value = self._sum()
            if value.op != "number":
                raise self._mistaken(f"expected {expected}", first)
            found.append(value.value)
        if len(found) != count and (found or name == "indicator"):
            raise self._unexpected(expected)
        return found

    def _guard(self, work: Callable[[], T], first: int | None = None) -> T:
        """Result of ``work``; its errors are reported at a token."""
        try:
            return work()
        except ElvisError as error:
            raise self._mistaken(str(error), first) from error


def _chosen(of: Node, positive: Node, otherwise: Node) -> Node:
    """One of two operands, by the sign of the first; both must have values everywhere."""
    is_positive, is_other = call("step", ZERO, of), call("-", ONE, call("step", ZERO, of))
    return call("+", call("*", is_positive, positive), call("*", is_other, otherwise))


def _gradient(of: Node, names: Scope) -> Node:
    """The length of the gradient."""
    parts = [names.derivative(of, axis) for axis in range(names.dimension)]
    return call("sqrt", _total([call("*", part, part) for part in parts]))


def _laplacian(of: Node, names: Scope) -> Node:
    """The divergence of the gradient."""
    return _total([names.derivative(names.derivative(of, axis), axis) for axis in range(names.dimension)])


def _total(terms: list[Node]) -> Node:
    return reduce(lambda total, term: call("+", total, term), terms)
