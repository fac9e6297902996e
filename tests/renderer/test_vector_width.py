"""Records don't depend on how many lanes a device works with at once: software Vulkan at 128, 256 and 512 bits."""

import os
import subprocess
import sys

import numpy as np
import pytest

from elvis.renderer.adapters import adapters

DRAWING = """
import sys
import numpy as np
from elvis.core.testing import approximated, curved, grid
from elvis.formats import Dataset, Shape
from elvis.renderer import Camera, CutSurface, Isosurface, Plane, Renderer, Scene

def bend(points):
    return points + 0.05 * np.sin(4 * points[..., [1, 2, 0]])

def wave(points):
    return np.sin(4 * points[..., 0]) + points[..., 1] * points[..., 2]

# tetrahedra are straight, hexahedra bent
solid = grid(Shape[sys.argv[1]], 2)
mesh = curved(solid, bend, 3) if sys.argv[1] == "HEXAHEDRON" else solid
dataset = Dataset(mesh)
field = approximated(dataset, "u", wave, 4)
camera = Camera((2.9, 2.1, 1.9), (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), height=1.8)
plane = Plane((0.5, 0.5, 0.52), (0.1, 0.2, 1.0))
item = CutSurface(plane) if sys.argv[1] == "HEXAHEDRON" else Isosurface((0.6,))
with Renderer(sys.argv[2]) as renderer:
    renderer.load(Dataset(mesh, fields=(field,)), "u")
    scene = Scene("u", camera=camera, size=(64, 48), objects=(item,))
    renderer.render(scene).save(f"{sys.argv[3]}.npz")
"""


@pytest.mark.parametrize("shape", ["TETRAHEDRON", "HEXAHEDRON"])
def test_records_are_equal_at_any_vector_width(shape, tmp_path):
    device = next((item.name for item in adapters() if "llvmpipe" in item.label), None)
    if device is None:
        pytest.skip("no software Vulkan that works with vectors")
    for width in ("128", "256", "512"):
        caches = {name: str(tmp_path / name / width) for name in ("XDG_CACHE_HOME", "MESA_SHADER_CACHE_DIR")}
        command = [sys.executable, "-c", DRAWING, shape, device, str(tmp_path / width)]
        subprocess.run(command, check=True, env={**os.environ, **caches, "LP_NATIVE_VECTOR_WIDTH": width})
    first, *others = (dict(np.load(tmp_path / f"{width}.npz")) for width in ("128", "256", "512"))
    assert (first["status"] > 0).sum() > 200
    for name, array in first.items():
        assert all(array.tobytes() == other[name].tobytes() for other in others), name
