"""Records don't depend on how many lanes a device works with at once: software Vulkan at 128, 256 and 512 bits.

No driver takes 512 bits by itself, and compiling for them takes long: `make every-test` draws with them.
The other tests run at 128 bits with kernels that are not optimised (see tests/conftest.py), so that what they prove
holds at the widths that users have, and with optimised kernels.
"""

import os
import subprocess
import sys

import pytest
from archives import arrays_of

from elvis.renderer.device.adapters import adapters

WIDTHS = ("256", "512") if "EVERY_TEST" in os.environ else ("256",)
CASES = ("cut-HEXAHEDRON", "isosurface-TETRAHEDRON", "faces-TETRAHEDRON", "volume-HEXAHEDRON")
DRAWING = """
import sys
import numpy as np
from elvis.core.testing import approximated, curved, grid
from elvis import (
    Camera,
    Contours,
    CutSurface,
    Dataset,
    Faces,
    Isosurface,
    MeshLines,
    Plane,
    Renderer,
    Scene,
    Shape,
    Style,
    Transfer,
    VolumeRendering,
)

def bend(points):
    return points + 0.05 * np.sin(4 * points[..., [1, 2, 0]])

def wave(points):
    return np.sin(4 * points[..., 0]) + points[..., 1] * points[..., 2]

device, folder, *cases = sys.argv[1:]
items = {
    "cut": CutSurface(Plane((0.5, 0.5, 0.52), (0.1, 0.2, 1.0))),
    "faces": Faces(style=Style(contours=Contours(count=4), mesh_lines=MeshLines())),
    "isosurface": Isosurface((0.6,)),
    "volume": VolumeRendering(Transfer((-1.0, 2.0), (0.0, 2.0))),
}
camera = Camera((2.9, 2.1, 1.9), (0.5, 0.5, 0.5), (0.0, 0.0, 1.0), height=1.8)
with Renderer(device) as renderer:
    for case in cases:
        kind, shape = case.split("-")
        solid = grid(Shape[shape], 2)
        # tetrahedra are straight, others bent
        mesh = solid if shape == "TETRAHEDRON" else curved(solid, bend, 3)
        dataset = Dataset(mesh)
        field = approximated(dataset, "u", wave, 4)
        renderer.load(Dataset(mesh, fields=(field,)), "u")
        renderer.render(Scene("u", camera=camera, size=(64, 48), objects=(items[kind],))).save(f"{folder}/{case}.npz")
"""


@pytest.fixture
def records(tmp_path):
    """The arrays of each case, drawn at a vector width: with the tests' own kernels, or such as are compiled for it."""
    device = next((item.name for item in adapters() if "llvmpipe" in item.label), None)
    if device is None:
        pytest.skip("no software Vulkan that works with vectors")

    def drawn(width, *cases):
        folder = tmp_path / width
        folder.mkdir()
        environment = dict(os.environ)
        if width != os.environ["LP_NATIVE_VECTOR_WIDTH"]:
            # as users have it; the driver takes kernels of another width for its own
            for name in ("GALLIVM_PERF", "ELVIS_SLANG_OPTIMIZATION"):
                environment.pop(name, None)
            environment |= {name: str(folder / name) for name in ("XDG_CACHE_HOME", "MESA_SHADER_CACHE_DIR")}
            environment["LP_NATIVE_VECTOR_WIDTH"] = width
        subprocess.run([sys.executable, "-c", DRAWING, device, folder, *cases], check=True, env=environment)
        return {case: arrays_of(folder / f"{case}.npz") for case in cases}

    return drawn


def check_equal(one, other):
    for case, arrays in one.items():
        background = arrays["color"][0, 0]
        assert (arrays["color"] != background).any(axis=-1).sum() > 200, case
        for name, array in arrays.items():
            assert array.tobytes() == other[case][name].tobytes(), (case, name)


@pytest.mark.thorough
@pytest.mark.sampled
@pytest.mark.parametrize("width", WIDTHS)
def test_records_match_those_of_128_bits(records, width):
    check_equal(records("128", *CASES), records(width, *CASES))
