"""What kernels ask of a device: what their SPIR-V declares and uses, and whether it is valid."""

import shutil
import struct
import subprocess

import pytest

from elvis import Renderer
from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.renderer.device.device import SHADERS, Device
from elvis.renderer.device.kernels import cache as kernel_cache
from elvis.renderer.device.kernels.database import content

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
#: instructions by number in the same specification
TYPE_INT, VARIABLE, DECORATE, CAPABILITY, MEMORY_MODEL, SOURCE = 21, 59, 71, 17, 14, 3
BARRIERS = {224: "OpControlBarrier", 225: "OpMemoryBarrier"}
#: built-in variables that tell of subgroups: how large one is, which lane or subgroup a thread is of
OF_SUBGROUPS = {36, 37, 38, 39, 40, 41}
#: variables that the threads of a group share
WORKGROUP = 4
#: all kernels that GPUs run, by the names of their files
STAGES = sorted(
    path.stem
    for folder in SHADERS
    for path in folder.glob("*.slang")
    if '[shader("compute")]' in path.read_text() and path.stem != "wave_lanes"
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
    """The SPIR-V of every kernel as GPUs run it, for elements of one shape, compiled with nothing kept before."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.mktemp("cache")))
        patch.setattr(kernel_cache, "_caches", {})
        patch.setattr(Device, "_has_wide_waves", False)
        with Renderer("vulkan") as renderer:
            renderer.load(linear(grid(Shape.TETRAHEDRON, cells=1)), "u")
            device, (part,) = renderer.device, renderer.stages.loaded.parts
            for stage in STAGES:
                device.kernel(stage, part)
            assert device.cache.private is not None
            found, _ = content(device.cache.private, set())
        for cache in kernel_cache._caches.values():
            cache.close()
    assert len(found) == len(STAGES) > 30
    return [words_of(kernel) for kernel in found.values()]


def of_kind(words, *kinds):
    """Places of all instructions of some kinds."""
    return [place for number, place in instructions(words) if number in kinds]


def test_kernels_require_only_checked_features(kernels):
    """Not for 64-bit integers either, though addresses of buffers have 64 bits."""
    declared = {words[place + 1] for words in kernels for place in of_kind(words, CAPABILITY)}
    assert declared - ALLOWED.keys() == set()
    assert {1, 10, 5347} <= declared
    widths = {words[place + 2] for words in kernels for place in of_kind(words, TYPE_INT)}
    assert widths == {32}


def test_kernels_use_no_shared_memory_or_subgroup_size(kernels):
    """Threads of a group share nothing and don't wait for one another; what lanes vote on doesn't hang on how many."""
    for words in kernels:
        assert all(words[place + 3] != WORKGROUP for place in of_kind(words, VARIABLE))
        assert not of_kind(words, *BARRIERS)
        decorations = [words[place + 2 : place + 4] for place in of_kind(words, DECORATE)]
        assert not OF_SUBGROUPS & {built_in for kind, built_in in decorations if kind == 11}
        # addresses of buffers, and the memory model that all devices have
        (place,) = of_kind(words, MEMORY_MODEL)
        assert words[place + 1 : place + 3] == [5348, 1]


@pytest.mark.skipif(shutil.which("spirv-val") is None, reason="spirv-val is not installed")
@pytest.mark.parametrize("environment", ENVIRONMENTS)
def test_kernels_are_valid(kernels, environment, tmp_path):
    for words in kernels:
        for place in of_kind(words, SOURCE):
            # older validators don't know Slang's number
            words[place + 1] = 0
        path = tmp_path / "kernel.spv"
        path.write_bytes(struct.pack(f"<{len(words)}I", *words))
        command = ["spirv-val", "--scalar-block-layout", "--target-env", environment, path]
        process = subprocess.run(command, capture_output=True, text=True, check=False)
        assert process.returncode == 0, process.stderr[:500]
