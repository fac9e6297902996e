"""Fields derived from others: without their highest modes, or recovered.  Each is computed once for a field."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

from elvis.core.dataset import Dataset, Field
from elvis.core.resolution.truncation import truncated

#: derived fields by their field and name
_KNOWN: WeakKeyDictionary[Field, dict[Any, Field]] = WeakKeyDictionary()


def derived_field(dataset: Dataset, name: str, function: str, original: str, axes: tuple[int, ...]) -> Field:
    """The field of a name that `elvis.core.quantities.derived.derived_of` takes apart.

    KeyError for an unknown field, ElvisError for one that the function does not take.
    """
    field = dataset.field(original)
    known = _KNOWN.setdefault(field, {})
    if name not in known:
        known[name] = truncated(field, name)
    return known[name]
