"""The device without a graphics driver: it draws every kind of object on every shape, as Vulkan does.

``CPU_COMPILER=clang++ EVERY_TEST=1`` draws them by kernels that another compiler makes, such as that of macOS.
"""

import os
import shutil
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from elvis import (
    Camera,
    Clip,
    Cone,
    Contours,
    Copies,
    CutSurface,
    Cylinder,
    Dataset,
    Deform,
    Faces,
    Glyphs,
    Implicit,
    Isosurface,
    Lic,
    MeshLines,
    Plane,
    Repeat,
    Scene,
    Sphere,
    Streamlines,
    Style,
    Transfer,
    TriangleMesh,
    VolumeRendering,
    render,
)
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.renderer.device.adapters import Adapter, compiler
from elvis.renderer.device.device import SHADERS
from elvis.renderer.device.errors import DeviceError
from elvis.renderer.device.kernels.failures import DRAWN, drawn_by, naming_what_fails

#: kernels of this device are libraries, which stay in memory until it is closed
pytestmark = pytest.mark.apart
VIEW = {"camera": Camera((2.2, -1.7, 1.9), (0.5, 0.5, 0.5), fov=28.0), "size": (24, 20)}
CENTRE = (0.5, 0.45, 0.5)
PLANE = Plane(CENTRE, (0.2, 0.1, 1.0))
SEEDS = ("point:0.4,0.3,0.4", "point:0.6,0.5,0.6")
FLOW = "u,v,w"
HAZE = Transfer((-2.0, 3.0), (0.2, 2.0))
STREAKS = Lic(FLOW, length=6.0)
#: what stands for each kernel family; expressions that are not polynomials have other kernels than fields
OBJECTS = {
    "cuts": (CutSurface(PLANE, Style(contours=Contours(count=3))), CutSurface(Sphere(CENTRE, 0.35))),
    "cuts by other surfaces": (
        CutSurface(Cylinder((0.5, 0.5, 0.0), (0.5, 0.5, 1.0), 0.3)),
        CutSurface(Cone((0.5, 0.5, 1.2), (0.0, 0.0, -1.0), 20.0)),
        CutSurface(TriangleMesh("blade.obj")),
        CutSurface(Implicit("u - 0.7*v - 0.3")),
    ),
    "faces": (Faces(style=Style(mesh_lines=MeshLines(), contours=Contours(count=3))),),
    "transparent faces": (Faces(style=Style(opacity=0.5)),),
    "line integral convolution": (Faces(style=Style(lic=STREAKS)), CutSurface(PLANE, Style(lic=STREAKS))),
    "isosurface": (Isosurface((0.7,)),),
    "isosurface of an expression": (Isosurface((1.5,), "exp(u) - v"),),
    "isosurface of Q": (Isosurface((0.0,), "q_criterion"),),
    "volume": (VolumeRendering(HAZE),),
    "volume of an expression": (VolumeRendering(HAZE, "exp(u) - v"),),
    "volumes together": (VolumeRendering(HAZE), VolumeRendering(HAZE, "v")),
    "streamlines": (Streamlines(SEEDS, FLOW, length=0.5, radius=0.02),),
    "ribbons": (Streamlines(SEEDS, FLOW, length=0.5, ribbon=0.2, arrows=0.2),),
    "lines on a wall": (Streamlines(("boundary:all:2",), FLOW, wall="all", length=0.5, width=2.0),),
    "vortex cores": (Streamlines(velocity="a,b,c", cores="acceleration", radius=0.05),),
    "many streamlines": (Streamlines(("random:300",), FLOW, length=0.3, width=1.0),),
    "arrows": (Glyphs(SEEDS, FLOW, length=0.2),),
    "distances": (CutSurface(PLANE, Style(quantity="distance(all)")),),
    "derivatives": (CutSurface(PLANE, Style(quantity="d(u, x)")),),
}
#: what is drawn of straight elements, on which it takes seconds
STRAIGHT = {
    **{kind: OBJECTS[kind] for kind in ("isosurface", "volume", "faces")},
    "isosurface of lambda2": (Isosurface((-0.5,), "lambda2"),),
}
#: what is drawn without the regions in these clips
CLIPPED = {
    "clipped surfaces": (Faces(), CutSurface(PLANE)),
    "clipped isosurface": OBJECTS["isosurface"],
    "clipped volume": OBJECTS["volume"],
    "clipped streamlines": OBJECTS["streamlines"],
}
CLIPS = (Clip(Sphere((1.0, 0.0, 1.0), 0.6)), Clip(Implicit("u - 0.7*v - 0.3")))
#: surfaces, an isosurface, a volume and lines
EVERYTHING = (Faces(style=Style(opacity=0.5)), CutSurface(PLANE), *OBJECTS["isosurface"], *OBJECTS["volume"])
EVERYTHING += (*OBJECTS["streamlines"], *OBJECTS["arrows"])
#: scenes of other geometry
ELSEWHERE = {
    "copies": {
        "copies": Copies(mirror=(Plane((1.1, 0.0, 0.0), (1.0, 0.0, 0.0)),), repeat=(Repeat((0.0, 1.5, 0.0), 2),))
    },
    "deformed geometry": {"deform": Deform("u,v,w", scale=0.05, undeformed="mesh")},
}
FLOW_IN_PLANE = "u,v"
SEEDS_IN_PLANE = ("point:0.4,0.3,0",)
IN_PLANE = {
    "faces": (Faces(style=Style(mesh_lines=MeshLines(), contours=Contours(count=3))),),
    "line integral convolution": (Faces(style=Style(lic=Lic(FLOW_IN_PLANE, length=6.0))),),
    "streamlines": (Streamlines(SEEDS_IN_PLANE, FLOW_IN_PLANE, length=0.5, width=2.0),),
    "arrows": (Glyphs(SEEDS_IN_PLANE, FLOW_IN_PLANE, length=0.2),),
    "distances": (Faces(style=Style(quantity="distance(all)")),),
}
#: kinds whose kernels are close to those of others
AKIN = (
    "line integral convolution",
    "isosurface of an expression",
    "isosurface of Q",
    "cuts by other surfaces",
    "transparent faces",
    "volume of an expression",
    "volumes together",
    "ribbons",
    "lines on a wall",
    "vortex cores",
    "many streamlines",
    "arrows",
    "distances",
    "derivatives",
    "clipped surfaces",
    "clipped isosurface",
    "clipped volume",
    "clipped streamlines",
)
#: differences of rounding between two compilers
CLOSE = 1e-12
#: the same of shades of isosurfaces, whose normals are those before the last step of Newton's method: rounding of
#: earlier steps, which polynomials fitted on small parts of elements amplify, is still in them
CLOSE_SHADES = 1e-9


def kinds(objects):
    """The names of objects as parameters; thorough tests draw those whose kernels are close to others'."""
    return [pytest.param(kind, marks=pytest.mark.thorough if kind in AKIN else ()) for kind in objects]


def shades_of(kind):
    """How close the shades of a kind of object are."""
    return CLOSE_SHADES if "isosurface" in kind else CLOSE


def shapes(dimension):
    return [shape.name.lower() for shape in Shape.of_dimension(dimension)]


def wave(points):
    x, y, z = np.moveaxis(points, -1, 0)
    return np.sin(2 * x + y) * np.cos(1.5 * z) + x


def rotation(points):
    """(n, 3) a rigid rotation with a speed along its axis."""
    axis = np.array([0.3, 0.2, 1.0]) / np.linalg.norm([0.3, 0.2, 1.0])
    return np.cross(axis, points - CENTRE) + axis


#: slang recognizes the name and the version of g++ alone
OTHER_AS_GCC = """#!/bin/sh
[ "$1" = -v ] || {{ echo >> {log}; exec {compiler} "$@"; }}
echo "gcc version 12.2.0" >&2
"""


def stand_in(folder, compiler):
    """Let a compiler stand for g++ in a folder; the file with a line for each kernel that it makes."""
    log = folder / "log"
    path = folder / "g++"
    path.write_text(OTHER_AS_GCC.format(log=log, compiler=compiler))
    path.chmod(0o755)
    return log


@pytest.fixture(scope="module", autouse=True)
def chosen_compiler(tmp_path_factory):
    """The compiler that CPU_COMPILER names, and no kernels that another one made."""
    name = os.environ.get("CPU_COMPILER")
    if name is None:
        yield
        return
    folder = tmp_path_factory.mktemp("compiler")
    log = stand_in(folder, shutil.which(name))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PATH", str(folder), prepend=os.pathsep)
        patch.setenv("XDG_CACHE_HOME", str(folder / "cache"))
        yield
    assert log.exists(), f"{name} compiled nothing"


@pytest.fixture(scope="module", autouse=True)
def optimised():
    """Let compilers optimise as they do for users: kernels of the CPU take minutes on some shapes otherwise."""
    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("ELVIS_SLANG_OPTIMIZATION", raising=False)
        yield


@pytest.fixture(scope="module")
def solution():
    """Smooth fields u, v, w and a rotation a, b, c on a few elements of a shape."""

    def make(shape, bend=0.04):
        mesh = grid(Shape[shape.upper()], 1)
        mesh = curved(mesh, ripple(bend, seed=2), 2) if bend else mesh
        bare = Dataset(mesh)
        functions = {name: lambda x, f=f: wave(f * x) for name, f in (("u", 1.0), ("v", 0.7), ("w", 1.3))}
        functions |= {name: lambda x, i=i: rotation(x)[:, i] for i, name in enumerate("abc")}
        return Dataset(mesh, tuple(approximated(bare, name, own, modes=4) for name, own in functions.items()))

    return make


@pytest.fixture(scope="module", autouse=True)
def blade(tmp_path_factory):
    """A triangle that cuts the domain, in the working folder."""
    folder = tmp_path_factory.mktemp("blade")
    (folder / "blade.obj").write_text("v -0.5 -0.5 0.4\nv 2.0 -0.5 0.5\nv -0.5 2.0 0.6\nf 1 2 3\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        yield


def check_same_frames(draw, data, shades=CLOSE, **scene):
    """Check that the CPU and Vulkan draw the same elements, statuses, values, depths, and colours up to ``shades``."""
    check_same(*(draw(data, device, **scene) for device in ("cpu", "vulkan")), shades)


def check_same(cpu, vulkan, shades=CLOSE):
    """Check that two frames have the same elements, statuses, values, depths, and colours up to ``shades``."""
    assert np.ptp(vulkan.color, axis=(0, 1)).max() > 0.1
    assert np.array_equal(cpu.element, vulkan.element)
    assert np.array_equal(cpu.status, vulkan.status)
    for name, close in (("field", CLOSE), ("depth", CLOSE), ("color", shades)):
        assert np.allclose(getattr(cpu, name), getattr(vulkan, name), rtol=close, atol=close, equal_nan=True), name


@pytest.mark.sampled(free=("shape",))
@pytest.mark.parametrize("shape", shapes(3))
@pytest.mark.parametrize("kind", kinds(OBJECTS))
def test_the_cpu_matches_vulkan(draw, solution, kind, shape):
    check_same_frames(draw, solution(shape), shades_of(kind), objects=OBJECTS[kind], **VIEW)


@pytest.mark.sampled(free=("shape",))
@pytest.mark.parametrize("shape", shapes(3))
@pytest.mark.parametrize("kind", kinds(CLIPPED))
def test_the_cpu_clips_as_vulkan_does(draw, solution, kind, shape):
    check_same_frames(draw, solution(shape), shades_of(kind), objects=CLIPPED[kind], clip=CLIPS, **VIEW)


@pytest.mark.sampled(free=("shape",))
@pytest.mark.parametrize("shape", shapes(2))
@pytest.mark.parametrize("kind", kinds(IN_PLANE))
def test_the_cpu_matches_vulkan_in_a_plane(draw, solution, kind, shape):
    check_same_frames(draw, solution(shape), objects=IN_PLANE[kind], size=VIEW["size"])


@pytest.mark.thorough
@pytest.mark.parametrize("shape", shapes(3))
def test_the_cpu_draws_copies_as_vulkan_does(solution, shape):
    scene = Scene("u", objects=OBJECTS["faces"], **ELSEWHERE["copies"], **VIEW)
    check_same(*(render(solution(shape), scene, device=device) for device in ("cpu", "vulkan")))


@pytest.mark.thorough
@pytest.mark.parametrize("shape", shapes(3))
@pytest.mark.parametrize("kind", ELSEWHERE)
def test_the_cpu_draws_other_geometry_as_vulkan_does(solution, kind, shape):
    scene = Scene("u", objects=EVERYTHING, **ELSEWHERE[kind], **VIEW)
    check_same(*(render(solution(shape), scene, device=device) for device in ("cpu", "vulkan")))


@pytest.mark.thorough
@pytest.mark.parametrize("shape", shapes(2))
def test_the_cpu_draws_height_surfaces_as_vulkan_does(solution, shape):
    scene = Scene("u", deform=Deform(height="u", walls=True, undeformed="faces"), **VIEW)
    check_same(*(render(solution(shape), scene, device=device) for device in ("cpu", "vulkan")))


@pytest.mark.thorough
@pytest.mark.parametrize("shape", shapes(3))
@pytest.mark.parametrize("kind", STRAIGHT)
def test_the_cpu_matches_vulkan_on_straight_elements(draw, solution, kind, shape):
    check_same_frames(draw, solution(shape, bend=0.0), shades_of(kind), objects=STRAIGHT[kind], **VIEW)


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


@pytest.mark.thorough
def test_kernels_compile_with_clang(tmp_path):
    clang = shutil.which("clang++")
    if clang is None:
        pytest.skip("there is no clang++")
    stand_in(tmp_path, clang)
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


@pytest.mark.parametrize(("kind", "requested", "level"), [
    ("cpu", None, "maximal"), ("vulkan", None, "default"), ("cpu", "none", "none"),
])  # fmt: skip
def test_kernels_of_the_cpu_are_optimised_for_speed(monkeypatch, kind, requested, level):
    if requested is not None:
        monkeypatch.setenv("ELVIS_SLANG_OPTIMIZATION", requested)
    levels = []
    device = SimpleNamespace(create_slang_session=lambda options, **_: levels.append(options.optimization.name))
    compiler(device, Adapter(kind, "a device", software=True), SHADERS)
    assert levels == [level]


def test_every_folder_of_kernels_has_a_name():
    folders = {path.name for path in SHADERS} - {"shaders"}
    assert folders == set(DRAWN)
    assert {drawn_by(stage, SHADERS) for stage in ("cut_draw", "volume_trace", "compose")} >= {
        "cut planes",
        "any object",
    }
