"""Elements and fields from arrays in memory: positions of nodes, and values there.

``from_arrays({"quadrilateral": places}, u=values)``; the nodes of the reference element are given, or are
Gauss-Lobatto points on lines, squares and cubes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps
from elvis.core.base.terminal import one_line
from elvis.core.base.texts import check_name
from elvis.core.data.dataset import Dataset
from elvis.core.polynomials.quadrature import lobatto
from elvis.core.shapes import TENSOR, Shape
from elvis.plugins.conversion.converting import converted_object
from elvis.plugins.conversion.nodal import (
    NodalBasis,
    NodalBlock,
    NodalConverter,
    NodalValues,
    component_names,
    order_of_space,
    tensor_nodes,
)
from elvis.plugins.conversion.plugin import Elements

#: the highest order of elements
_HIGHEST = 30
#: shapes by the names that messages have for them
_SHAPES = {shape.label.lower(): shape for shape in Shape}


def from_arrays(
    positions: Mapping[str, Any],
    fields: Mapping[str, Any] | None = None,
    *,
    reference: Mapping[str, Any] | None = None,
    time: float | None = None,
    **named: Any,
) -> Dataset:
    """A dataset of elements with values at nodes, such as ``from_arrays({"hexahedron": nodes}, u=values)``.

    positions  by the name of a shape (segment, triangle, quadrilateral, tetrahedron, pyramid, prism, hexahedron):
               (n, m, d) world coordinates of the m nodes of n elements; elements that share corners are neighbours
    fields     by name, like the keywords: (n, m) values or (n, m, c) components at the same nodes; by shape, as
               ``{"triangle": …}``, if there are several
    reference  by shape, (m, d) positions of the nodes in the reference element, whose coordinates go from -1 to 1 and
               whose corners are those of `Shape.vertices`.  Without it segments, quadrilaterals and hexahedra have the
               products of Gauss-Lobatto points, first coordinate fastest, and other shapes of first order only corners
    time       of the data

    The nodes must determine a polynomial of some order.  Remarks of the dataset state the error of the conversion.
    Raises ElvisError if arrays don't fit.

    >>> ds = elvis.from_arrays({"triangle": [[[0, 0], [1, 0], [0, 1]]]}, u=[[0, 1, 0]], v=[[0, 0, 0]])
    >>> round(ds["u"](0.25, 0.5), 12)
    0.25
    """
    source = Arrays(positions, fields_by_name(fields, named), {} if reference is None else reference)
    source.time = checked_time(time)
    return converted_object(source, "arrays")


class Arrays(NodalConverter):
    """Elements by shape with values at their nodes, from memory: no plugin opens them."""

    format = "arrays in memory"

    @classmethod
    def opens(cls, paths: Sequence[Path]) -> bool:
        """No files at all."""
        return False

    def __init__(self, positions: Mapping[str, Any], fields: Mapping[str, Any], reference: Mapping[str, Any]) -> None:
        if not isinstance(positions, Mapping) or not positions:
            raise ElvisError(
                f"expected positions of nodes by shape, as {{'hexahedron': …}}, found {short_text(positions)}"
            )
        if not isinstance(reference, Mapping):
            raise ElvisError(f"reference: expected coordinates of nodes by shape, found {short_text(reference)}")
        self.blocks = [_block(name, nodes, reference.get(name)) for name, nodes in positions.items()]
        self._shapes = list(positions)
        self.take(fields)

    def take(self, fields: Mapping[str, Any]) -> None:
        """Replace all fields with these; ElvisError if arrays don't fit."""
        check_by_name(fields)
        self.clear_fields()
        for name, values in fields.items():
            self._add(name, values, self._shapes)

    def _add(self, name: str, values: Any, shapes: Sequence[str]) -> None:
        """A field, a component or all of them."""
        given = values if isinstance(values, Mapping) else {shapes[0]: values}
        if not isinstance(values, Mapping) and len(shapes) > 1:
            raise ElvisError(f"{name}: expected values by shape, as {{'{shapes[0]}': …}}, as there are several")
        for shape in given:
            if shape not in shapes:
                raise ElvisError(
                    f"{name}: there are no elements of the shape {short_text(shape)}{perhaps(str(shape)[:60], shapes)}"
                )
        missing = [shape for shape in shapes if shape not in given]
        if missing:
            raise ElvisError(f"{name}: expected values on every shape, found none on {', '.join(missing)}")
        own = [self._values(name, block, given[shape]) for shape, block in zip(shapes, self.blocks, strict=True)]
        counts = {each.values.shape[-1] for each in own}
        if len(counts) != 1:
            raise ElvisError(f"{name}: expected the same number of components on every shape, found {sorted(counts)}")
        self.add_field(name, component_names(name, counts.pop()), own, is_continuous=True)

    def _values(self, name: str, block: Elements, values: Any) -> NodalValues:
        """The values of a field at the nodes of a block, by component."""
        geometry = self.nodal(block).geometry
        shape = geometry.values.shape[:2]
        found = host_array(name, values)
        if found.shape[:2] != shape or found.ndim not in (2, 3) or not found.size:
            raise ElvisError(f"{name}: expected {shape} values, or components of these, found {found.shape}")
        return NodalValues(found.reshape(*shape, -1), geometry.functions)


def _block(name: str, nodes: Any, reference: Any) -> Elements:
    """The elements of a shape."""
    if name not in _SHAPES:
        raise ElvisError(
            f"there is no shape {short_text(name)}{perhaps(str(name)[:60], _SHAPES)}: there are {', '.join(_SHAPES)}"
        )
    shape, positions = _SHAPES[name], host_array(name, nodes)
    if positions.ndim != 3 or not positions.size or not shape.dimension <= positions.shape[2] <= 3:
        raise ElvisError(f"{name}: expected positions (elements, nodes, {shape.dimension}), found {positions.shape}")
    count = positions.shape[1]
    order = order_of_space(shape, count, _HIGHEST)
    if not order:
        raise ElvisError(f"{name}: expected the nodes of a complete polynomial, found {count}")
    basis = NodalBasis(shape, order, _nodes(name, shape, order, count, reference))
    return Elements(shape, len(positions), order, key=NodalBlock(NodalValues(positions, basis)))


def _nodes(name: str, shape: Shape, order: int, count: int, reference: Any) -> Floats:
    """Positions (count, d) of the nodes in the reference element."""
    if reference is not None:
        found = host_array(f"reference of {name}", reference)
        if found.shape != (count, shape.dimension):
            raise ElvisError(f"reference of {name}: expected {(count, shape.dimension)} numbers, found {found.shape}")
        return found
    if shape in TENSOR:
        return tensor_nodes(shape, tuple(lobatto(order + 1)[0].tolist()))
    if order == 1:
        return np.asarray(shape.vertices, np.float64)
    wanted = f"{(count, shape.dimension)} positions of the nodes in the element"
    raise ElvisError(f"{name}: expected the argument reference, with {wanted}, found none")


def fields_by_name(fields: Any, named: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a live bridge, including its keywords; ElvisError if they are not given by names."""
    if fields is not None:
        check_by_name(fields)
    return {**(fields or {}), **named}


def checked_time(time: Any) -> float | None:
    """The time of data, None without; ElvisError for anything but a finite number."""
    if time is None:
        return None
    found = host_array("time", time)
    if found.size != 1 or not np.isfinite(found).all():
        raise ElvisError(f"time: expected a finite number, found {short_text(time)}")
    return float(found.item())


def check_by_name(fields: Any) -> None:
    """ElvisError for fields that are not arrays by name."""
    if not isinstance(fields, Mapping):
        raise ElvisError(f"expected arrays by the names of fields, as {{'u': …}}, found {short_text(fields)}")
    for name in fields:
        if not isinstance(name, str) or not name:
            raise ElvisError(f"expected names of fields that are texts, found {short_text(name)}")
        check_name(name, "a field")


def host_array(what: str, values: Any) -> Floats:
    """An array of real numbers as float64, copied only if necessary; also from objects that support DLPack.

    ElvisError, which calls it ``what``, for anything else and for memory of another device.
    """
    try:
        has_dlpack = hasattr(values, "__dlpack__") and not isinstance(values, np.ndarray)
        found = np.from_dlpack(values) if has_dlpack else np.asarray(values)
        if found.dtype.kind not in "biufO":
            raise TypeError
        # numbers beyond the range become infinite
        with np.errstate(over="ignore"):
            return np.asarray(found, np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise ElvisError(f"{what}: expected an array of real numbers, found {short_text(values)}") from error
    except (BufferError, RuntimeError) as error:
        raise ElvisError(
            f"{what}: expected an array in the memory of the host, found one that is not: {error}"
        ) from error


def short_text(value: Any) -> str:
    """The beginning of what Python shows of a value, on one line."""
    return one_line(f"{value!r:.60}")
