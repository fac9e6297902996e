"""What kernels ask of a device: the capabilities that their SPIR-V declares, and whether it is valid."""

import shutil
import struct
import subprocess

import pytest

from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.renderer import (
    Contours,
    CutSurface,
    Faces,
    Isosurface,
    MeshLines,
    Plane,
    Renderer,
    Scene,
    Style,
    Transfer,
    VolumeRendering,
    kernel_cache,
)
from elvis.renderer.kernel_database import content

#: capabilities by number in the specification of SPIR-V, and the features of Vulkan devices that they need
ALLOWED = {
    1: "Shader, which all have",
    10: "Float64: shaderFloat64, looked at when a device is chosen",
    61: "GroupNonUniform: subgroups, likewise",
    62: "GroupNonUniformVote, likewise",
    64: "GroupNonUniformBallot, likewise",
    5347: "PhysicalStorageBufferAddresses: bufferDeviceAddress, likewise",
}
MAGIC = struct.pack("<I", 0x07230203)
ENVIRONMENTS = ("vulkan1.2", "vulkan1.3")
OBJECTS = (
    CutSurface(Plane((0.5, 0.5, 0.5), (0.2, 0.3, 1.0)), Style(contours=Contours(count=3), mesh_lines=MeshLines())),
    Faces(("all",)),
    Isosurface((0.5,)),
    VolumeRendering(Transfer((-1.0, 0.0, 1.0), (0.0, 1.0, 3.0))),
)


def words_of(kernel):
    """The SPIR-V in a kept kernel, as numbers."""
    start = kernel.index(MAGIC)
    count = (len(kernel) - start) // 4
    return list(struct.unpack(f"<{count}I", kernel[start : start + 4 * count]))


def instructions(words):
    """Number and place of each instruction."""
    place = 5
    while place < len(words):
        yield words[place] & 0xFFFF, place
        place += words[place] >> 16


@pytest.fixture(scope="module")
def kernels(tmp_path_factory, linear):
    """The SPIR-V of all kernels of a picture, drawn with nothing compiled before."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        patch.setattr(kernel_cache, "_caches", {})
        with Renderer("vulkan") as renderer:
            renderer.load(linear(grid(Shape.TETRAHEDRON, cells=1)), "u")
            renderer.render(Scene("u", size=(16, 16), objects=OBJECTS))
            assert renderer.device.cache.private is not None
            found, _ = content(renderer.device.cache.private, set())
        for cache in kernel_cache._caches.values():
            cache.close()
    return [words_of(kernel) for kernel in found.values()]


def test_kernels_ask_for_what_devices_are_asked_for(kernels):
    declared = {words[place + 1] for words in kernels for number, place in instructions(words) if number == 17}
    assert len(kernels) > 10
    assert declared - ALLOWED.keys() == set()
    assert {1, 10, 5347} <= declared


@pytest.mark.skipif(shutil.which("spirv-val") is None, reason="spirv-val is not installed")
@pytest.mark.parametrize("environment", ENVIRONMENTS)
def test_kernels_are_valid(kernels, environment, tmp_path):
    for words in kernels:
        for number, place in instructions(words):
            if number == 3:
                # OpSource: older validators don't know Slang's number
                words[place + 1] = 0
        path = tmp_path / "kernel.spv"
        path.write_bytes(struct.pack(f"<{len(words)}I", *words))
        command = ["spirv-val", "--scalar-block-layout", "--target-env", environment, path]
        process = subprocess.run(command, capture_output=True, text=True, check=False)
        assert process.returncode == 0, process.stderr[:500]
