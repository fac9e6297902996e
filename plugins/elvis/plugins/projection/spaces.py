"""Which native space holds what a source's elements carry."""

from __future__ import annotations

from collections.abc import Sequence

from elvis.core.shapes import Shape
from elvis.plugins.conversion.plugin import Elements, PyramidSpace, SourceField

#: orders up to which pyramids are held by the native one of the same order (Bergot's; collapsed tensor products that
#: have one value at the apex)
_RATIONAL_LIMIT, _TENSOR_LIMIT = 2, 1


def needs_hexahedra(block: Elements, number: int, fields: Sequence[SourceField]) -> bool:
    """Whether the functions on a block of pyramids are in no native pyramid, only in a collapsed hexahedron."""
    if block.shape is not Shape.PYRAMID or block.pyramid in (PyramidSpace.POLYNOMIAL, PyramidSpace.NATIVE):
        return False
    limit = _RATIONAL_LIMIT if block.pyramid is PyramidSpace.RATIONAL else _TENSOR_LIMIT
    held = [(field, field.order_on(number)) for field in fields]
    if block.order > limit or any(order is not None and order > limit for _, order in held):
        return True

    # a field with jumps needn't have one value at the apex
    is_tensor = block.pyramid is PyramidSpace.TENSOR
    return is_tensor and any(not field.is_continuous and order == 1 for field, order in held)


def is_contained(block: Elements, order: int, target: int, is_ortho: bool, is_collapsed: bool) -> bool:
    """Whether the native expansion of order ``target`` contains the functions of an order on a block."""
    if order > target:
        return False
    if block.shape is not Shape.PYRAMID or is_collapsed:
        return True
    if block.pyramid in (PyramidSpace.POLYNOMIAL, PyramidSpace.NATIVE):
        return is_ortho == (block.pyramid is PyramidSpace.POLYNOMIAL) or order == 0
    return order <= (_RATIONAL_LIMIT if block.pyramid is PyramidSpace.RATIONAL else _TENSOR_LIMIT)
