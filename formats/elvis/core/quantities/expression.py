"""Expressions: the meaning of a text for a dataset."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset, is_rate
from elvis.core.quantities.derived import is_recovered, original_of
from elvis.core.quantities.elements.sides import DUALS, SIDES
from elvis.core.quantities.names import Names
from elvis.core.quantities.parsing import Parser
from elvis.core.quantities.tree import Node, field, fold, jumping_of, leaves, target_of, whole_exponent

#: the highest power that is treated as a polynomial
_MOST_POWER = 64
#: attributes of an element that are independent of its surroundings
_OWN = ("element", "composite", "h", "shape", "order", "jacobian", "scaled_jacobian", "quality", *SIDES, *DUALS)


@dataclass(frozen=True, eq=False)
class Expression:
    """A quantity: the text and its meaning."""

    text: str
    root: Node

    @staticmethod
    def parse(text: str, names: Names) -> Expression:
        """The quantity that a text says, given the names of a dataset; a field's whole name is that field.

        ElvisError, with the place in the text and the known names, where it says none.
        """
        if not isinstance(text, str):
            raise ElvisError(f"expected the text of a quantity, found {type(text).__name__}")
        if text in names.fields:
            return Expression(text, field(text))
        name, equals, rest = text.partition("=")
        if equals and name.strip().isidentifier():
            raise ElvisError(f"expression {text!r}: expected no name in front, found {name.strip()}=: write {rest!r}")
        return Expression(text, Parser(text, names).whole())

    @staticmethod
    def of(dataset: Dataset, text: str) -> Expression:
        """The quantity that a text says of a dataset (see `parse`)."""
        return Expression.parse(text, Names.of(dataset))

    @cached_property
    def leaves(self) -> tuple[Node, ...]:
        """Its fields, coordinates, derivatives and attributes."""
        return tuple(leaves(self.root))

    @property
    def fields(self) -> tuple[str, ...]:
        """The names of its fields, each once."""
        return tuple(dict.fromkeys(leaf.name for leaf in self.leaves if leaf.op == "field"))

    @property
    def has_rates(self) -> bool:
        """Whether it contains derivatives in time."""
        return any(is_rate(original_of(name)) for name in self.fields)

    @property
    def attributes(self) -> tuple[str, ...]:
        """The names of its attributes."""
        return tuple(leaf.name for leaf in self.leaves if leaf.op == "attribute")

    @property
    def is_local(self) -> bool:
        """Whether its values on an element depend only on that element."""
        return all(name in _OWN for name in self.attributes) and not self.has_recovered

    @property
    def is_borrowed(self) -> bool:
        """Whether its values on an element depend on that one and on what parts of data borrow: see `borrowing`."""
        beyond = [name for name in self.attributes if name not in _OWN]
        is_known = all(target_of(name) is not None or jumping_of(name) is not None for name in beyond)
        return is_known and not self.has_recovered

    @property
    def has_recovered(self) -> bool:
        """Whether it contains recovered fields."""
        return any(map(is_recovered, self.fields))

    @property
    def order(self) -> int:
        """The highest derivative of a field in it."""
        return max((len(leaf.axes) for leaf in self.leaves if leaf.op == "field"), default=0)

    def degree(self, leaf: Callable[[Node], int | None]) -> int | None:
        """The degree as a polynomial, from the degrees of its leaves; None if it is not known to be a polynomial."""

        def inner(node: Node, degrees: list[int | None]) -> int | None:
            known = [degree for degree in degrees if degree is not None]
            if len(known) < len(degrees):
                return None
            first, second = known[0], known[-1]
            if node.op in "+-*":
                return first + second if node.op == "*" else max(first, second)
            exponent = whole_exponent(node)
            if exponent is not None and 0 <= exponent <= _MOST_POWER:
                return first * exponent
            if node.op == "/" and node.operands[1].op == "number":
                return first
            return 0 if max(known) == 0 else None

        return fold(self.root, lambda node: 0 if node.op == "number" else leaf(node), inner)

    @property
    def is_field(self) -> bool:
        """Whether it is just a field."""
        return self.root.op == "field" and not self.root.axes


def column_expressions(texts: Sequence[str], names: Names, taken: Sequence[str]) -> list[Expression]:
    """Quantities that become columns of a table, each once.

    Raises ElvisError for one with the name of a column of its own.

    taken  the names of those
    """
    found = [Expression.parse(text, names) for text in dict.fromkeys(texts)]
    bad = [each.text for each in found if each.text in taken]
    if bad:
        raise ElvisError(taken_name(bad[0]))
    return found


def taken_name(field: str) -> str:
    """A message about a field whose name is also a standard column of tables."""
    return f"the field {field!r} has the name of a column; write it as an expression, such as 1*{field}"
