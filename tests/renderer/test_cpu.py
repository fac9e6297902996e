"""The device without a graphics driver: it draws every kind of object on every shape, as Vulkan does."""

import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

from elvis import (
    Camera,
    Contours,
    CutSurface,
    Dataset,
    Faces,
    Glyphs,
    Isosurface,
    MeshLines,
    Plane,
    Sphere,
    Streamlines,
    Style,
    Transfer,
    VolumeRendering,
)
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.renderer.adapters import Adapter
from elvis.renderer.device import SHADERS
from elvis.renderer.device_errors import DeviceError
from elvis.renderer.kernel_failures import DRAWN, drawn_by, naming_what_fails

VIEW = {"camera": Camera((2.2, -1.7, 1.9), (0.5, 0.5, 0.5), fov=28.0), "size": (24, 20)}
CENTRE = (0.5, 0.45, 0.5)
PLANE = Plane(CENTRE, (0.2, 0.1, 1.0))
SEEDS = ("point:0.4,0.3,0.4", "point:0.6,0.5,0.6")
FLOW = "u,v,w"
HAZE = Transfer((-2.0, 3.0), (0.2, 2.0))
#: what stands for each kernel family; expressions that are not polynomials have other kernels than fields
OBJECTS = {
    "cuts": (CutSurface(PLANE, Style(contours=Contours(count=3))), CutSurface(Sphere(CENTRE, 0.35))),
    "faces": (Faces(style=Style(mesh_lines=MeshLines())),),
    "isosurface": (Isosurface((0.7,)),),
    "isosurface of an expression": (Isosurface((1.5,), "exp(u) - v"),),
    "volume": (VolumeRendering(HAZE),),
    "volume of an expression": (VolumeRendering(HAZE, "exp(u) - v"),),
    "volumes together": (VolumeRendering(HAZE), VolumeRendering(HAZE, "v")),
    "streamlines": (Streamlines(SEEDS, FLOW, length=0.5, radius=0.02),),
    "arrows": (Glyphs(SEEDS, FLOW, length=0.2),),
}
#: kinds whose kernels are close to those of others
AKIN = ("faces", "volume of an expression", "volumes together", "arrows")
KINDS = [pytest.param(kind, marks=pytest.mark.thorough if kind in AKIN else ()) for kind in OBJECTS]
SHAPES = [shape.name.lower() for shape in Shape.of_dimension(3)]
#: differences of rounding between two compilers
CLOSE = 1e-12


def wave(points):
    x, y, z = np.moveaxis(points, -1, 0)
    return np.sin(2 * x + y) * np.cos(1.5 * z) + x


@pytest.fixture(scope="module")
def solution():
    """Three smooth fields on a few curved elements of a shape."""

    def make(shape):
        mesh = curved(grid(Shape[shape.upper()], 1), ripple(0.04, seed=2), 2)
        factors = {"u": 1.0, "v": 0.7, "w": 1.3}
        fields = [approximated(Dataset(mesh), name, lambda x, f=f: wave(f * x), modes=4) for name, f in factors.items()]
        return Dataset(mesh, tuple(fields))

    return make


@pytest.mark.sampled(free=("shape",))
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("kind", KINDS)
def test_the_cpu_matches_vulkan(draw, solution, kind, shape):
    frames = [draw(solution(shape), device, objects=OBJECTS[kind], **VIEW) for device in ("cpu", "vulkan")]
    cpu, vulkan = frames
    assert np.ptp(vulkan.color, axis=(0, 1)).max() > 0.1
    assert np.array_equal(cpu.element, vulkan.element)
    assert np.array_equal(cpu.status, vulkan.status)
    for name in ("field", "depth", "color"):
        assert np.allclose(getattr(cpu, name), getattr(vulkan, name), rtol=CLOSE, atol=CLOSE, equal_nan=True), name


DRAW_A_SPHERE = """
import numpy as np
from elvis import Dataset, Isosurface, render
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid
mesh = grid(Shape.TETRAHEDRON, 1)
field = approximated(Dataset(mesh), "u", lambda x: (x**2).sum(axis=-1), modes=3)
frame = render(Dataset(mesh, (field,)), objects=(Isosurface((0.7,)),), size=(24, 20), device="cpu")
points = frame.position[frame.seen]
assert len(points) > 20 and np.abs((points**2).sum(axis=-1) - 0.7).max() < 1e-12
"""
#: slang recognizes the name and the version of g++ alone
CLANG_AS_GCC = """#!/bin/sh
[ "$1" = -v ] || exec {clang} "$@"
echo "gcc version 12.2.0" >&2
"""


@pytest.mark.thorough
def test_kernels_compile_with_clang(tmp_path):
    clang = shutil.which("clang++")
    if clang is None:
        pytest.skip("there is no clang++")
    compiler = tmp_path / "g++"
    compiler.write_text(CLANG_AS_GCC.format(clang=clang))
    compiler.chmod(0o755)
    settings = {**os.environ, "PATH": str(tmp_path)}
    command = [sys.executable, "-c", DRAW_A_SPHERE]
    done = subprocess.run(command, env=settings, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-2000:]


def test_a_kernel_that_does_not_compile_names_the_unsupported_object():
    adapter = Adapter("cpu", "slang's CPU target, one thread", software=True)
    output = "failed: slang: gcc 12.2: /a/b/iso_follow.slang(266): error :  no match for '-'\n" + "  | ^~~\n" * 300
    with pytest.raises(DeviceError) as found, naming_what_fails("iso_draw", SHADERS, adapter):
        raise RuntimeError(output)
    assert str(found.value) == (
        "the device cpu (slang's CPU target, one thread) can't draw isosurfaces of these data:"
        " it fails to make the kernel iso_draw at iso_follow.slang:266; choose another device"
    )
    assert str(found.value.__cause__) == output


def test_every_folder_of_kernels_has_a_name():
    folders = {path.name for path in SHADERS} - {"shaders"}
    assert folders == set(DRAWN)
    assert {drawn_by(stage, SHADERS) for stage in ("cut_draw", "volume_trace", "compose")} >= {
        "cut planes",
        "any object",
    }
