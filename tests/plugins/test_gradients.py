"""Gradients of fields in the kernels against NumPy's, for every shape and order."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from elvis import Dataset
from elvis.core.polynomials.evaluation import evaluate_at_with_gradients
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, mixed_plane, mixed_volume, ripple, scattered
from elvis.plugins.native import NativeVolume

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


@pytest.mark.parametrize("modes", [3, 9])
def test_native_gradients_match_numpy(renderer, modes):
    solid = wild(Dataset(curved(mixed_volume(seed=1), ripple(0.02), n=3)), modes)
    plane = wild(Dataset(curved(mixed_plane(seed=1), ripple(0.02), n=3)), modes)
    drawing = renderer("vulkan")
    seen = compare(drawing, NativeVolume.of(solid, "u")) | compare(drawing, NativeVolume.of(plane, "u"))
    assert seen == {shape for shape in Shape if shape.dimension > 1}
