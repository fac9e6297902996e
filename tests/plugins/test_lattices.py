"""Elements at the points of a lattice, which share sums: what they are one by one, to the bit."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, with_field
from elvis.plugins.native import NativeVolume
from elvis.renderer.volume.device_volume import DeviceVolume

NODES = np.cos(np.pi * np.arange(1, 18, 2) / 18)
CHECK = Path(__file__).parent / "shaders" / "lattice_check.slang"
SOLIDS = [shape for shape in Shape if shape.dimension == 3]


@pytest.fixture(scope="module")
def taken(renderer, tmp_path_factory):
    """(elements, points, 4) places and field of a shape at all nodes of a box: together, by fours, one by one."""
    device, folder = renderer("vulkan").device, tmp_path_factory.mktemp("shaders")

    def take(shape, box):
        mesh = curved(grid(shape, 1), lambda points: points + 0.1 * np.sin(2 * points[..., [1, 2, 0]]), 4)
        dataset = with_field(mesh, lambda points: np.cos(3 * points).prod(axis=-1), 6)
        volume = NativeVolume.of(dataset, dataset.fields[0].name)
        loaded = DeviceVolume(device, volume)
        shutil.copytree(volume.shader_folder, folder, dirs_exist_ok=True)
        shutil.copy(CHECK, folder)
        device.include(folder)
        (part,) = loaded.parts
        kernel = device.kernel("lattice_check", part)
        device.include(volume.shader_folder)
        size = 4 * len(part) * len(NODES) ** 3
        lists = {name: device.empty(np.float64, size) for name in ("together", "fours", "alone")}
        given = {"nodes": device.buffer(np.append(len(NODES), NODES)), "box": device.buffer(np.array(box))}
        kernel(len(part), {**loaded.bindings(0, None), **given, **lists})
        return [device.read(each, np.float64)[:size].reshape(len(part), -1, 4) for each in lists.values()]

    return take


@pytest.mark.sampled(least=2, free=("shape",))
@pytest.mark.parametrize("shape", SOLIDS)
def test_points_of_a_lattice_match_single_evaluation(shape, taken):
    for box in ((0.0, 0.0, 0.0, 1.0, 1.0, 1.0), (-0.25, 0.5, -0.375, 0.25, 0.125, 0.0625)):
        together, fours, alone = taken(shape, box)
        assert np.ptp(alone, axis=1).min() > 0.01
        assert np.array_equal(together, alone)
        assert np.abs(fours - alone).max() < 1e-14 * np.abs(alone).max()
