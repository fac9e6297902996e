"""Closed devices give back their threads, descriptors and memory at once, without the garbage collector."""

import gc
import os
import sys
from pathlib import Path

import numpy as np
import pytest

from elvis import Camera, CutSurface, DeviceError, Faces, Isosurface, Plane, Renderer, Scene, render
from elvis.renderer.device import persistence
from elvis.renderer.device.device import Device
from elvis.renderer.device.errors import DeviceLostError

NEAR = Camera((2.0, -1.6, 1.7), (0.5, 0.5, 0.5), fov=35.0)
PLANE = Plane((0.5, 0.5, 0.4), (0.1, 0.2, 1.0))
FACES = Scene("u", objects=(Faces(),), camera=NEAR, size=(40, 30))

pytestmark = [
    pytest.mark.skipif(not sys.platform.startswith("linux"), reason="threads are counted in /proc"),
    pytest.mark.own_devices,
]


@pytest.fixture
def uncollected(renderer):
    """No garbage is collected while a test runs; a device can be opened."""
    renderer("vulkan")
    gc.collect()
    gc.disable()
    yield
    gc.enable()


def held():
    """Threads and descriptors of this process."""
    return len(os.listdir("/proc/self/task")), len(os.listdir("/proc/self/fd"))


def resident():
    """Bytes of this process that are in memory."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")


@pytest.mark.thorough
@pytest.mark.parametrize(
    "scene",
    [
        Scene("u", objects=(Faces(), CutSurface(PLANE)), camera=NEAR, size=(40, 30)),
        Scene("u", objects=(Isosurface((0.5,)),), camera=NEAR, size=(40, 30)),
    ],
    ids=["surfaces", "isosurface"],
)
def test_successive_pictures_hold_no_memory(cube, uncollected, scene):
    render(cube, scene, device="vulkan")
    before, memory = held(), resident()
    render(cube, scene, device="vulkan")
    assert held() == before
    # a picture whose device stays takes some 190 MB
    assert resident() < memory + 150e6


def test_a_reused_renderer_does_not_grow(cube, uncollected):
    before = held()
    with Renderer("vulkan") as drawing:
        drawing.load(cube, "u")
        drawing.render(FACES)
        during = held()
        for _ in range(5):
            drawing.render(FACES)
        assert held() == during
    assert held() == before


def test_an_error_while_drawing_holds_no_device(cube, uncollected, monkeypatch):
    """The exception is retained, and with it the frames of all that ran when it was raised."""
    before, kept = held(), []

    def fails(self, *_):
        raise DeviceLostError("the device failed: ERROR_DEVICE_LOST")

    monkeypatch.setattr(Device, "read", fails)
    monkeypatch.setattr(persistence, "FEWEST", persistence.BAND // 8)
    with pytest.raises(DeviceError) as raised:
        render(cube, FACES, device="vulkan")
    kept.append(raised.value)
    assert held() == before


def test_a_closed_device_is_reported(cube, uncollected):
    before = held()
    with Device("vulkan") as opened:
        buffer, kernel = opened.buffer(np.zeros(3)), opened.kernel("compose")
    assert held() == before
    opened.close()
    with pytest.raises(DeviceError, match="the device is closed"):
        opened.read(buffer, np.float64)
    with pytest.raises(DeviceError, match="the device is closed"):
        opened.buffer(np.zeros(3))
    with pytest.raises(DeviceError, match="the device is closed"):
        kernel(1, {})
