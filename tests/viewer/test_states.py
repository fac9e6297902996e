"""What the drawing process tells is about the geometry and the phase that the page shows."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, Deform, Scene, Shape
from elvis.core.testing import approximated, grid
from elvis.viewer.drawing_process import _Drawing
from elvis.viewer.moments import source_of

FUNCTIONS = {"E_re": lambda x: 1 + 0 * x[:, 0], "E_im": lambda x: x[:, 0]}


@pytest.fixture
def drawing():
    data = Dataset(grid(Shape.QUADRILATERAL, 1))
    data = replace(data, fields=tuple(approximated(data, name, own, 3) for name, own in FUNCTIONS.items()))
    scene = Scene("E", deform=Deform("E,0", 1.0), phase=0.0, device="reference")
    return _Drawing(source_of(scene, data), None), scene


def test_lines_of_values_belong_to_the_scale_and_the_phase(drawing):
    process, scene = drawing
    facts = process.answer("facts", 0, None)
    assert facts["fields"] == ["E_re", "E_im", "E"]
    assert facts["complex"] == ["E"]
    for scale, phase in ((1.0, 0.0), (2.0, 0.0), (2.0, 90.0)):
        shown = replace(scene, deform=replace(scene.deform, scale=scale), phase=phase)
        process._take(process._in_state(shown))
        # the map X = x + scale Re(E exp(i phase)) takes x = 0.25 to
        moved = 0.25 + scale * (np.cos(np.radians(phase)) - 0.25 * np.sin(np.radians(phase)))
        content = {"quantities": ["undeformed_x", "E"], "start": [moved, 0.2, 0.0], "end": [moved, 0.8, 0.0]}
        found = process.answer("line", 0, content)
        assert np.allclose(found["values"][0], 0.25, atol=1e-12)
        assert np.allclose(found["values"][1], (moved - 0.25) / scale, atol=1e-12)
