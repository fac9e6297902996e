"""Fields derived from others: without their highest modes, or recovered.  Each is computed once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from weakref import WeakKeyDictionary, ref

from elvis.core.data.dataset import Dataset, Field
from elvis.core.data.mesh import Mesh
from elvis.core.quantities.derived import TRUNCATED
from elvis.core.resolution.averaging import averaged
from elvis.core.resolution.recovery import enriched
from elvis.core.resolution.truncation import truncated

#: name of the enriched field
ENRICHED = "enriched"


@dataclass(frozen=True, eq=False)
class _Derived:
    """A derived field, and the mesh and fields of the map that it belongs to."""

    field: Field
    mesh: ref[Mesh]
    maps: tuple[ref[Field], ...]

    def is_of(self, dataset: Dataset) -> bool:
        """Whether it belongs to a dataset with the same map."""
        maps = [own() for own in self.maps]
        return self.mesh() is dataset.mesh and list(map(id, maps)) == list(map(id, dataset.map_fields))


#: derived fields by their field and name
_KNOWN: WeakKeyDictionary[Field, dict[str, _Derived]] = WeakKeyDictionary()


def derived_field(dataset: Dataset, name: str, function: str, original: str, axes: tuple[int, ...]) -> Field:
    """The field of a name that `elvis.core.quantities.derived.derived_of` takes apart.

    KeyError for an unknown field, ElvisError for one that the function does not take.
    """
    if function == TRUNCATED:
        return _once(dataset, original, name, lambda own: truncated(own, name))
    return _once(dataset, original, name, lambda own: _recovered(dataset, own, original, name, axes))


def enriched_field(dataset: Dataset, name: str) -> Field:
    """The field of one order more (see `recovery`)."""
    return _once(dataset, name, ENRICHED, lambda own: enriched(dataset, name))


def _recovered(dataset: Dataset, own: Field, original: str, name: str, axes: Sequence[int]) -> Field:
    """A continuous field of one order more than a field, or of its derivatives, one after another."""
    found = enriched_field(dataset, original)
    for axis in axes or (None,):
        found = averaged(dataset, found, name, axis)
    return found


def _once(dataset: Dataset, original: str, name: str, make: Callable[[Field], Field]) -> Field:
    """The derived field of a name, made unless it is known."""
    own = dataset.field(original)
    known = _KNOWN.setdefault(own, {})
    if name not in known or not known[name].is_of(dataset):
        known[name] = _Derived(make(own), ref(dataset.mesh), tuple(map(ref, dataset.map_fields)))
    return known[name].field
