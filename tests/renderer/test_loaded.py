"""What a loaded volume knows of its parts, once for all stages."""

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest

from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.renderer.volume.traversal import Traversal


class Part:
    """Two elements; counts how often it is requested bounds."""

    boxes, element_ids, buffers, degree = np.zeros((2, 6)), np.arange(2), {}, 1
    rounding = None

    def __init__(self, known=True):
        self.asked = Counter()
        self.bounds = (lambda: self._answer("field")) if known else None
        self.quantities = {"p": SimpleNamespace(bounds=lambda: self._answer("p"), rounding=None, degree=1)}

    def __len__(self):
        return 2

    def quantity(self, name):
        return self if name is None else self.quantities[name]

    def _answer(self, name):
        self.asked[name] += 1
        return np.array([-1.0, 2.0]), np.array([3.0, 4.0])


@pytest.fixture
def loaded():
    """Loads a part where there is no device."""
    device = SimpleNamespace(include=lambda _: None, buffer=lambda data: data)
    return lambda part: DeviceVolume(device, SimpleNamespace(parts=[part], dimension=3, shader_folder=None))


def test_bounds_are_computed_once(loaded):
    part = Part()
    volume = loaded(part)
    for quantity in (None, "p"):
        for traversal in (Traversal(volume), Traversal(volume)):
            traversal.steepest(0, quantity, 0.0)
            traversal.flat(0, quantity, 0.0)
        ends, held = volume.every(quantity)
        assert held is ends
        assert (ends[:, 0] < [-1.0, 2.0]).all()
        assert (ends[:, 1] > [3.0, 4.0]).all()
    assert part.asked == {"field": 1, "p": 1}


def test_bounds_that_are_not_known_are_infinite(loaded):
    volume = loaded(Part(known=False))
    assert np.array_equal(volume.ends(0, None), [[-np.inf, np.inf]] * 2)
