"""States of a running solver: datasets on one mesh, whose fields are arrays in memory, one after another."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps
from elvis.core.data.dataset import Block, Dataset, Field
from elvis.plugins.conversion.arrays import Arrays, check_by_name, host_array
from elvis.plugins.conversion.converting import Conversion, convert, convert_again
from elvis.plugins.conversion.plugin import Converter
from elvis.plugins.series.between import on_mesh_of


class States(Protocol):
    """Interface through which `Session` requests a dataset at each step."""

    def at(self, time: float, fields: Any, quantities: Sequence[str] = ()) -> Dataset:
        """The state at a time; ElvisError for invalid fields.

        quantities  the only ones that will be requested, the empty one for the first field: fields that these don't
                    need may be
                    missing; none if they are not known
        """


class ValuedSource(Protocol):
    """A converter with fixed elements, whose fields are given to it; they state no modes of their own."""

    time: float | None

    def take(self, fields: Any) -> None:
        """Replace all fields with these."""


class NodalStates:
    """States given by values at nodes of elements.

    source  a converter with a method `take`, as in `ValuedSource`
    name    of the source in remarks

    The first state is converted completely, with its error measured; for others only the needed fields are.
    """

    def __init__(self, source: Any, name: str) -> None:
        self._source, self._name = source, name
        self._first: Conversion | None = None
        #: the names of the fields that the last state has; none before there is one
        self.carried: tuple[str, ...] = ()

    def at(self, time: float, fields: Any, quantities: Sequence[str] = ()) -> Dataset:
        """The state whose fields the source takes."""
        source: Converter = self._source
        self._source.take(fields)
        source.time = time
        if self._first is None:
            self._first = convert(source, files=(self._name,))
            dataset = self._first.dataset
        else:
            dataset = convert_again(source, self._first, quantities)
        self.carried = tuple(dataset)
        return replace(dataset, remarks=self._first.report.remarks())


class ModalStates:
    """States given by coefficients of the expansions of a dataset's fields.

    dataset  its mesh, and fields that are not replaced, belong to all states

    Coefficients are (n, m), as in `Block`: an array if the field has one block, a list with one per block, or arrays by
    shape.  A new name gets the expansions of the dataset's first field.
    """

    def __init__(self, dataset: Dataset) -> None:
        if not dataset.solution:
            raise ElvisError(
                "expected a dataset with a field, whose expansions have the coefficients, or positions of nodes by "
                "shape; found a mesh without fields"
            )
        self._dataset = dataset

    def at(self, time: float, fields: Mapping[str, Any] | Dataset, quantities: Sequence[str] = ()) -> Dataset:
        """The state with these coefficients, copied; or another dataset, whose mesh is known where it is the same."""
        known = self._dataset
        if isinstance(fields, Dataset):
            return replace(on_mesh_of(known, fields), time=time, rates=None)
        check_by_name(fields)
        given = {name: self._field(name, values) for name, values in fields.items()}
        kept = [given.pop(field.name, field) for field in known.fields]
        metadata = {**known.metadata, **({"Time": repr(time)} if "Time" in known.metadata else {})}
        return replace(known, fields=(*kept, *given.values()), time=time, metadata=metadata, rates=None)

    def _field(self, name: str, values: Any) -> Field:
        """A field of the dataset with other coefficients, or a new one like the first."""
        known = self._dataset
        like = known.field(name) if name in known else replace(known.solution[0], name=name, continuous=None)
        pairs = zip(like.blocks, _by_block(name, like.blocks, values), strict=True)
        blocks = (replace(block, coefficients=_coefficients(name, block, own)) for block, own in pairs)
        return replace(like, blocks=tuple(blocks))


def states_of(mesh: Any, reference: Mapping[str, Any] | None = None) -> States:
    """The states of a mesh for `Session`.

    mesh       a dataset, whose fields are then coefficients, or positions of nodes by shape as in `from_arrays`
    reference  as of `from_arrays`

    Objects with a method ``at`` are used unchanged.  ElvisError for anything else.
    """
    if isinstance(mesh, Dataset):
        if reference is not None:
            raise ElvisError("expected no argument reference with a dataset, whose fields are coefficients")
        return ModalStates(mesh)
    if isinstance(mesh, Mapping):
        return NodalStates(Arrays(mesh, {}, reference or {}), "arrays of a running solver")
    if callable(getattr(mesh, "at", None)):
        states: States = mesh
        return states
    raise ElvisError(f"expected a dataset, or positions of nodes by shape, as {{'hexahedron': …}}, found {mesh!r:.60}")


def _by_block(name: str, blocks: Sequence[Block], values: Any) -> list[Any]:
    """The arrays of a field, one for each of its blocks; ElvisError for another number of arrays."""
    labels = [block.expansion.shape.label.lower() for block in blocks]
    if isinstance(values, Mapping):
        for shape in values:
            if shape not in labels:
                raise ElvisError(f"{name}: there are no elements of the shape {shape!r}{perhaps(str(shape), labels)}")
        if sorted(values) != sorted(labels):
            raise ElvisError(
                f"{name}: expected one array for each block, {', '.join(labels)}; found {', '.join(values)}"
            )
        return [values[label] for label in labels]
    found = list(values) if isinstance(values, (list, tuple)) and len(values) == len(blocks) else [values]
    if len(found) != len(blocks):
        raise ElvisError(f"{name}: expected a list of {len(blocks)} arrays, of {', '.join(labels)}; found one thing")
    return found


def _coefficients(name: str, block: Block, values: Any) -> Floats:
    """(n, m) coefficients of a block, copied: the solver goes on with its own."""
    found = host_array(name, values)
    if found.shape != block.coefficients.shape:
        shape = block.expansion.shape.label.lower()
        raise ElvisError(f"{name}: {shape}: expected coefficients {block.coefficients.shape}, found {found.shape}")
    return frozen_floats(np.array(found))
