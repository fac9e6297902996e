"""Sentences on recovered fields in quantities: that they are recovered, and how much they differ from the data."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import isfinite
from weakref import WeakKeyDictionary

from elvis.core.bounds.quantity_extrema import quantity_extrema
from elvis.core.data.dataset import Dataset, Field
from elvis.core.quantities.derived import RECOVERED, derived_name, derived_of
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.tree import call, field

#: sentences by recovered field
_KNOWN: WeakKeyDictionary[Field, str] = WeakKeyDictionary()


def remarks_on_recovered(dataset: Dataset, expressions: Sequence[Expression]) -> list[str]:
    """Remarks on recovered fields in quantities, each with a certified bound of its difference to the data."""
    names = [name for each in expressions for leaf in each.fields for name in _recovered_in(leaf)]
    return [_remark(dataset, name) for name in dict.fromkeys(names)]


def _recovered_in(name: str) -> Iterator[str]:
    """The recovered fields that a field comes from."""
    while (found := derived_of(name)) is not None:
        if found[0] == RECOVERED:
            yield name
        name = found[1]


def _remark(dataset: Dataset, name: str) -> str:
    """The sentence on one recovered field."""
    own, found = dataset.field(name), derived_of(name)
    assert found is not None
    if own not in _KNOWN:
        _, original, axes = found
        raw = derived_name("", original, axes)[1:-1]
        difference = Expression(name, call("-", field(name), field(original, axes)))
        least, greatest = quantity_extrema(dataset, difference)
        attained = max(-least.value, greatest.value)
        bound = max(-least.bound, greatest.bound)
        most = f"at most {bound:.4g} ({attained:.4g} is attained)"
        by = most if isfinite(bound) else f"at least {attained:.4g} (no bound is known)"
        _KNOWN[own] = f"{name} is recovered: a continuous field fitted to the data, which differs from {raw} by {by}"
    return _KNOWN[own]
