"""Isosurfaces of elements of high order: the models by which rays are followed leave roots where they are.

Errors of models are tested in test_iso_truncate.py.
"""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Camera, Status
from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.plugins.runtime.serving import volume_of
from elvis.renderer.passes.isosurface import isosurface
from elvis.renderer.passes.isosurface.isosurface import IsosurfaceDrawer
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene.cameras.view import View

VIEW = View.through(Camera((2.6, -1.9, 1.9), (0.5, 0.5, 0.5), fov=32), (60, 50))


#: the fields, by functions of points (n, 3); the isosurfaces of a polynomial and of a rational quantity
WAVES = {
    "u": lambda p: np.sin(5 * p[:, 0] + 3 * p[:, 1] * p[:, 2]),
    "v": lambda p: np.cos(3 * p[:, 0]) * p[:, 1],
    "w": lambda p: np.sin(2 * p[:, 1] + p[:, 2]),
}
LEVELS = {"u": 0.3, "q_criterion": -0.5}


@pytest.fixture(scope="module", params=LEVELS)
def quantity(request):
    return request.param


@pytest.fixture(scope="module")
def loaded(renderer, quantity):
    dataset = Dataset(curved(grid(Shape.HEXAHEDRON, 1), ripple(0.1), n=5))
    fields = tuple(approximated(dataset, name, wave, 7) for name, wave in WAVES.items())
    return DeviceVolume(renderer("vulkan").device, volume_of(replace(dataset, fields=fields), [quantity]))


def drawn(loaded, quantity, monkeypatch, room, off):
    """The hits, and the degrees of the models that found them: models with a limited room and error."""
    monkeypatch.setattr(isosurface, "_OF_MODELS", room)
    monkeypatch.setattr(isosurface, "_MODELS_OFF", off)
    monkeypatch.setattr(isosurface, "_ENCLOSED_MODELS_OFF", off)
    degrees = []

    class Watched(IsosurfaceDrawer):
        def _sub_elements(self, *given, **named):
            found = super()._sub_elements(*given, **named)
            degrees.extend(found["model_degree"].tolist())
            return found

    return Watched(loaded).draw(VIEW, None, LEVELS[quantity]), np.array(degrees)


@pytest.mark.thorough
def test_models_preserve_roots(loaded, quantity, monkeypatch):
    plain, none = drawn(loaded, quantity, monkeypatch, room=1, off=1e-6)
    assert not none.any()
    hit = np.isfinite(plain.depth)
    assert hit.mean() > 0.1
    for off, most_degree in ((1e-3, 5), (0.1, 2)):
        found, degrees = drawn(loaded, quantity, monkeypatch, room=1 << 20, off=off)
        assert (degrees > 0).mean() > 0.5
        assert np.median(degrees[degrees > 0]) <= most_degree
        assert (np.isfinite(found.depth) == hit).all()
        sure = hit & (found.status == Status.CERTAIN) & (plain.status == Status.CERTAIN)
        assert sure.sum() > 0.95 * hit.sum()
        apart = np.abs(found.depth[sure] - plain.depth[sure])
        assert (apart <= (found.uncertainty + plain.uncertainty)[sure]).all()
        assert np.abs(found.reference[sure] - plain.reference[sure]).max() < 1e-10
