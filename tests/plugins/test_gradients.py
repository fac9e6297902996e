"""Gradients of fields in the kernels against NumPy's, for every shape and order."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elvis import Dataset
from elvis.core.data.dataset import Block, Homogeneous
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.evaluation import evaluate_at_with_gradients
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, ripple, scattered
from elvis.plugins.native import NativeVolume
from elvis.plugins.testing.runtime import _check_derivatives, probes

NEKTAR = Path(__file__).resolve().parents[3] / "shared" / "data" / "nektar"
#: of the largest gradient
GRADIENT = 1e-11


def wild(dataset, modes):
    """A field with random coefficients, of all that the basis holds."""
    rng = np.random.default_rng(modes)
    field = approximated(dataset, "u", lambda p: p[:, 0], modes)
    blocks = [replace(block, coefficients=rng.normal(size=block.coefficients.shape)) for block in field.blocks]
    return replace(dataset, fields=(replace(field, blocks=tuple(blocks)),))


def asked(part, count=40):
    """Elements of a part and places in them, as the device is asked and as NumPy is."""
    for first, patch in zip(np.cumsum([0, *map(len, part.solve.patches)]), part.solve.patches, strict=False):
        rows = np.resize(np.arange(len(patch)), count)
        reference = scattered(patch.shape, count, seed=1)
        offsets = np.zeros((count, 3))
        offsets[:, : patch.shape.dimension] = reference
        yield patch, rows, reference, first + rows, offsets


def compare(drawing, volume):
    """Values and gradients on the device are NumPy's; returns the shapes seen."""
    drawing.show(volume)
    shapes = set()
    for number, part in enumerate(volume.parts):
        for patch, rows, reference, elements, offsets in asked(part):
            centre = drawing.sample_elements(number, elements[:1], offsets[:1]).center
            found = drawing.sample_elements(number, elements, offsets - centre)
            value, gradient = evaluate_at_with_gradients(patch.fields[0], patch.coefficients[0], rows, reference)
            apart = np.abs(reference[:, -1] - 1) > 1e-6 if patch.shape is Shape.PYRAMID else np.full(len(rows), True)
            assert np.abs(found.value - value).max() < GRADIENT * np.ptp(value)
            error = np.abs(found.gradient[:, : gradient.shape[1]] - gradient)[apart]
            assert error.max() < GRADIENT * np.abs(gradient).max(), part.type
            shapes.add(patch.shape)
    return shapes


def bent(mesh):
    """A surface in space."""
    x, y = mesh.vertices[:, 0], mesh.vertices[:, 1]
    return replace(mesh, space=3, vertices=mesh.vertices + np.outer(x * y + 0.3 * x, [0.1, 0.2, 0.7]))


@pytest.mark.parametrize(
    ("mesh", "waves"),
    [
        (curved(mixed_volume(seed=1), ripple(0.02), n=3), ()),
        (curved(mixed_plane(seed=1), ripple(0.02), n=3), ()),
        (curved(mixed_plane(seed=1), ripple(0.02), n=3), (1.5,)),
        (bent(mixed_plane(seed=1)), ()),
        (grid(Shape.SEGMENT, 3), (1.5,)),
        (grid(Shape.SEGMENT, 3), (1.5, 2.0)),
    ],
    ids=["solids", "plane", "waves", "surface", "line with waves", "line with waves along both"],
)
def test_positions_and_values_have_the_stated_derivatives(renderer, mesh, waves):
    """By central differences, also beside the surface or the line; normals of surfaces have the length 1."""
    field = approximated(Dataset(mesh), "u", lambda p: 0.3 + p[:, 0] ** 2 - p[:, 1], 3)
    if waves:
        blocks = []
        for block in field.blocks:
            homogeneous = Homogeneous((Basis.FOURIER,) * len(waves), waves, (0, 3, 2), (1, 0, 3) if waves[1:] else ())
            values = np.concatenate([block.coefficients, 0.5 * block.coefficients, -block.coefficients], axis=1)
            blocks.append(Block(replace(block.expansion, homogeneous=homogeneous), block.element_ids, values))
        field = replace(field, blocks=tuple(blocks))
    volume, drawing = NativeVolume.of(Dataset(mesh, (field,)), "u"), renderer("vulkan")
    drawing.show(volume)
    for number, part in enumerate(volume.parts):
        elements, offsets = probes(part, volume.dimension)
        offsets[:, mesh.dimension + len(waves) :] = 0.3 * (mesh.space == mesh.dimension)
        samples = drawing.sample_elements(number, elements, offsets)
        _check_derivatives(drawing, number, part, elements, offsets, samples)
        if mesh.dimension == 2 and not waves:
            normal = samples.jacobian[:, :, 2]
            assert np.linalg.norm(normal, axis=1) == pytest.approx(1)
            assert np.abs(np.einsum("nc,nca->na", normal, samples.jacobian[:, :, :2])).max() < 1e-12


@pytest.mark.parametrize("modes", [3, 9])
def test_native_gradients_match_numpy(renderer, modes):
    solid = wild(Dataset(curved(mixed_volume(seed=1), ripple(0.02), n=3)), modes)
    plane = wild(Dataset(curved(mixed_plane(seed=1), ripple(0.02), n=3)), modes)
    drawing = renderer("vulkan")
    seen = compare(drawing, NativeVolume.of(solid, "u")) | compare(drawing, NativeVolume.of(plane, "u"))
    assert seen == {shape for shape in Shape if shape.dimension > 1}
