"""The polynomials of elements on the device: one degree in all directions, in pyramids one more for the height."""

from __future__ import annotations

from dataclasses import replace

from elvis.core.mapping.patch import Patch
from elvis.core.polynomials.bernstein import BernsteinSpace, bernstein_space
from elvis.core.shapes import Shape


def map_space(patch: Patch) -> BernsteinSpace:
    """The space that holds the map on the device."""
    return even_space(bernstein_space(patch.geometry), 1)


def field_space(patch: Patch, number: int | None) -> BernsteinSpace:
    """The space that holds a field on the device; constants where there is none."""
    expansion = None if number is None else patch.fields[number]
    if expansion is None:
        return even_space(BernsteinSpace(patch.shape, (0,) * len(bernstein_space(patch.geometry).degrees)), 0)
    return even_space(bernstein_space(replace(expansion, homogeneous=None)), 0)


def even_space(space: BernsteinSpace, least: int) -> BernsteinSpace:
    """The smallest space with one degree (pyramids: one for the base, one for the height) that holds ``space``."""
    degrees = [max(degree, least) for degree in space.degrees]
    if space.shape is Shape.PYRAMID:
        base = max(degrees[:2])
        return BernsteinSpace(space.shape, (base, base, degrees[2]))
    return BernsteinSpace(space.shape, (max(degrees),) * len(degrees))


def type_arguments(space: BernsteinSpace) -> list[int]:
    """Arguments of the Slang type of polynomials in a space of one degree, or on pyramids with two."""
    return [space.degrees[0], space.degrees[2]] if space.shape is Shape.PYRAMID else [space.degrees[0]]


def degrees_of(geometry: BernsteinSpace, field: BernsteinSpace) -> tuple[int, int]:
    """`Part.degree` and `Part.base_degree` of elements with a map and a field in these spaces."""
    own, given = geometry.degrees, field.degrees
    base = max(*own[:2], *given[:2]) if geometry.shape is Shape.PYRAMID else 0
    return max(*own, *given), base
