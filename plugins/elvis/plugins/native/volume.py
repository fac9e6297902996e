"""Patches of a dataset turned into the buffers of the native Slang modules."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from elvis.formats.arrays import Floats, frozen_floats, frozen_ints
from elvis.formats.bernstein import BernsteinSpace, bernstein_coefficients, bernstein_space
from elvis.formats.boxes import element_boxes
from elvis.formats.dataset import Dataset
from elvis.formats.errors import ElvisError
from elvis.formats.patch import Patch, patches
from elvis.formats.shapes import Shape
from elvis.plugins.native.solving import Solver
from elvis.plugins.native.weights import weights
from elvis.plugins.volume import Part

#: coefficients that may all be raised to one order
FEW_BYTES = 1 << 24


@dataclass(frozen=True, eq=False)
class NativeVolume:
    """The elements of a dataset that carry one field."""

    dimension: int
    parts: Sequence[Part]

    @property
    def shader_folder(self) -> Path:
        """Where the Slang modules of the shapes stand."""
        return Path(__file__).parent

    @staticmethod
    def of(dataset: Dataset, field: str) -> NativeVolume:
        """The 2D or 3D elements that have the field; elements of one shape and one pair of degrees make a part.

        Raises ElvisError for lines, surfaces in space and homogeneous data, which have no volume to cut.
        """
        mesh = dataset.mesh
        if mesh.dimension < 2 or mesh.space != mesh.dimension:
            raise ElvisError(
                f"pictures are made of 2D data in the plane and of 3D data, "
                f"found DIM={mesh.dimension} SPACE={mesh.space}"
            )
        found = [patch for patch in patches(dataset, [field]) if patch.fields[0] is not None]
        if any(patch.fields[0] and patch.fields[0].homogeneous for patch in found):
            raise ElvisError(f"pictures of homogeneous (Fourier) data can't be made, as of field {field!r}")

        found.sort(key=lambda patch: repr((_map_space(patch), _field_space(patch))))
        parts = [part for space, group in groupby(found, key=_map_space) for part in _parts(space, list(group))]
        return NativeVolume(mesh.dimension, parts)


def _map_space(patch: Patch) -> BernsteinSpace:
    return _even(bernstein_space(patch.geometry), 1)


def _field_space(patch: Patch) -> BernsteinSpace:
    field = patch.fields[0]
    assert field is not None
    return _even(bernstein_space(field), 0)


def _parts(geometry: BernsteinSpace, found: list[Patch]) -> Iterator[Part]:
    """Parts of elements with one kind of map: by order of the field, unless so few that one order does for all.

    A part costs kernels of its own, which take longer to prepare than a few elements of higher degree to draw.
    """
    degrees = zip(*(_field_space(patch).degrees for patch in found), strict=True)
    largest = BernsteinSpace(geometry.shape, tuple(map(max, degrees)))
    if sum(map(len, found)) * largest.count * 8 <= FEW_BYTES:
        yield _part(geometry, largest, found)
    else:
        for space, group in groupby(found, key=_field_space):
            yield _part(geometry, space, list(group))


def _even(space: BernsteinSpace, least: int) -> BernsteinSpace:
    """The smallest space with one degree (pyramids: one for the base, one for the height) that holds ``space``."""
    degrees = [max(degree, least) for degree in space.degrees]
    if space.shape is Shape.PYRAMID:
        base = max(degrees[:2])
        return BernsteinSpace(space.shape, (base, base, degrees[2]))
    return BernsteinSpace(space.shape, (max(degrees),) * len(degrees))


def _part(geometry: BernsteinSpace, field: BernsteinSpace, found: list[Patch]) -> Part:
    """One part of all elements of like spaces."""
    shape = geometry.shape
    controls = np.concatenate([_controls(p, geometry) for p in found])
    points, indices = _shared(controls * weights(geometry)[:, None], geometry)
    del controls
    coefficients = [_coefficients(p, field) for p in found]
    solver, affine = Solver(found), shape in (Shape.TRIANGLE, Shape.TETRAHEDRON) and max(geometry.degrees) == 1
    return Part(
        module=f"native_{shape.name.lower()}",
        type=f"{shape.label}<{', '.join(map(str, _arguments(geometry) + _arguments(field)))}>",
        element_ids=frozen_ints(np.concatenate([p.element_ids for p in found])),
        boxes=np.concatenate([element_boxes(p) for p in found]),
        buffers={
            "control_points": points,
            "control_indices": indices,
            "coefficients": frozen_floats(coefficients[0] if len(coefficients) == 1 else np.concatenate(coefficients)),
        },
        solve=solver,
        bends=None if affine else solver.bends,
    )


def _arguments(space: BernsteinSpace) -> list[int]:
    return [space.degrees[0], space.degrees[2]] if space.shape is Shape.PYRAMID else [space.degrees[0]]


def _coefficients(patch: Patch, space: BernsteinSpace) -> Floats:
    """(n, k) scaled Bernstein coefficients of the patch's field."""
    expansion, modal = patch.fields[0], patch.coefficients[0]
    assert expansion is not None
    assert modal is not None
    # infinities become NaN where they meet
    with np.errstate(invalid="ignore"):
        return np.asarray(bernstein_coefficients(expansion, modal, space) * weights(space))


def _controls(patch: Patch, space: BernsteinSpace) -> Floats:
    """(n, k, 3) Bernstein control points of the patch's maps."""
    n, directions, modes = patch.geometry_coefficients.shape
    flat = patch.geometry_coefficients.reshape(n * directions, modes)
    nets = bernstein_coefficients(patch.geometry, flat, space).reshape(n, directions, space.count)
    return np.ascontiguousarray(nets.transpose(0, 2, 1))


def _shared(points: Floats, space: BernsteinSpace) -> tuple[Floats, NDArray[np.uint32]]:
    """Points (n, k, 3) of all elements as a list of points and (n * k) indices; straight elements share vertices."""
    flat = points.reshape(-1, 3)
    if max(space.degrees) > 1:
        return frozen_floats(flat), np.arange(len(flat), dtype=np.uint32)

    # equal points have equal hashes; should different ones collide, nothing is shared
    bits = (flat + 0.0).view(np.uint64)
    factors = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
    mixed = (bits ^ (bits >> np.uint64(29))) * factors
    hashes = mixed[:, 0] ^ (mixed[:, 1] >> np.uint64(7)) ^ (mixed[:, 2] << np.uint64(9))
    _, first, inverse = np.unique(hashes, return_index=True, return_inverse=True)
    unique = flat[first]
    if not np.array_equal(unique[inverse], flat):
        return frozen_floats(flat), np.arange(len(flat), dtype=np.uint32)
    return frozen_floats(unique), inverse.astype(np.uint32)
