"""Names of fields that are derived from others, such as ``truncated(u)`` and ``recovered(d(u,x))``.

A derived field has coefficients like any other field, so all commands treat it as one.  `Dataset.field` makes it on
request (`elvis.core.resolution.derived_fields`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Sequence

from elvis.core.base.errors import ElvisError
from elvis.core.quantities.tree import AXES, Node, call, field, fold, leaves

#: functions whose value is a field
TRUNCATED, RECOVERED = "truncated", "recovered"
DERIVED = (TRUNCATED, RECOVERED)
_DERIVED = re.compile(rf"({'|'.join(DERIVED)})\((.+)\)", re.S)
_DERIVATIVE = re.compile(rf"d\((.+),([{''.join(AXES)}])\)", re.S)


def derived_name(function: str, name: str, axes: Sequence[int] = ()) -> str:
    """The name of the field that a function makes of a field, or of its derivative along some axes."""
    for axis in axes:
        name = f"d({name},{AXES[axis]})"
    return f"{function}({name})"


def derived_of(name: str) -> tuple[str, str, tuple[int, ...]] | None:
    """The function of `DERIVED`, the field and the axes of its derivatives in a name; None for other names."""
    found = _DERIVED.fullmatch(name)
    if found is None:
        return None
    inner, axes = found[2], list[int]()
    while (step := _DERIVATIVE.fullmatch(inner)) is not None:
        inner = step[1]
        axes.append(AXES.index(step[2]))
    return found[1], inner, tuple(reversed(axes))


def original_of(name: str) -> str:
    """The field that a derived field comes from, through all functions; other names are their own."""
    while (found := derived_of(name)) is not None:
        name = found[1]
    return name


def is_recovered(name: str) -> bool:
    """Whether a field is recovered, or derived from a recovered one."""
    while (found := derived_of(name)) is not None:
        if found[0] == RECOVERED:
            return True
        name = found[1]
    return False


def with_derived_fields(function: str, root: Node, places: Collection[str] = ()) -> Node:
    """An expression in which a function of `DERIVED` replaces each field.

    ``recovered`` also replaces derivatives as a whole: the derivative itself is recovered, not the field.

    places  names of fields that hold coordinates and stay as they are
    Raises ElvisError without fields, and for attributes that depend on fields.
    """
    named = [leaf.name for leaf in leaves(root) if leaf.op == "field" and leaf.name not in places]
    beyond = [leaf.name for leaf in leaves(root) if leaf.op == "attribute" and (":" in leaf.name or "(" in leaf.name)]
    if beyond or not named:
        found = beyond[0] if beyond else "none"
        raise ElvisError(f"expected fields or expressions of fields in {function}(…), found {found}")

    def leaf(node: Node) -> Node:
        if node.op != "field" or node.name in places:
            return node
        if function == RECOVERED:
            return field(derived_name(function, node.name, node.axes))
        return field(derived_name(function, node.name), node.axes)

    return fold(root, leaf, lambda node, operands: call(node.op, *operands))


def derived_rate(name: str, rate: Callable[[str], Node]) -> Node | None:
    """The derivative in time of a derived field; None for other fields.

    The functions are linear and act in space, so the derivative in time may be taken first.
    """
    found = derived_of(name)
    if found is None:
        return None
    function, inner, axes = found
    return field(derived_name(function, rate(inner).name, axes))
