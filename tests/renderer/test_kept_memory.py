"""Memory of a device that is reused from frame to frame: found again, bounded, and no trace of what was in it."""

import gc
import weakref
from copy import copy
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from elvis import Camera, CutSurface, Faces, Isosurface, Plane, Scene, Style, Transfer, VolumeRendering
from elvis.core.mapping.geometry import share
from elvis.core.shapes import Shape
from elvis.core.testing import grid
from elvis.renderer.device.memory import Pool, rounded

CUT = CutSurface(Plane((0.5, 0.5, 0.4), (0.1, 0.2, 1.0)))
VOLUME = VolumeRendering(Transfer((0.0, 3.0), (0.0, 2.0)))


def pool(most=1000):
    """Memory that is made up."""

    def create(itemsize, count):
        return SimpleNamespace(struct_size=itemsize, size=itemsize * count)

    return Pool(create, most)


def test_memory_without_an_owner_serves_the_next_of_its_kind():
    some = pool()
    first, second = some.take(8, 5), some.take(8, 5)
    kept = first.memory
    assert kept is not second.memory
    del first
    # of eight elements each, as five and seven are rounded up; of another size of an element none is free
    assert some.take(4, 7).memory is not kept
    again = some.take(8, 7)
    assert again.memory is kept
    assert (again.size, some.made) == (56, 3)


def test_free_memory_is_bounded_and_released_under_pressure():
    some = pool(most=100)
    for count in (8, 4, 2):
        some.take(8, count)
    # 64 bytes are free, then 96; what has no room next to them is not kept
    assert some._bytes == 96
    some._create, create = (lambda *kind: _no_room(some, create, *kind)), some._create
    assert some.take(1, 1).memory.size == 1
    assert some._bytes == 1
    some.close()
    assert some._bytes == 0


def _no_room(some, create, *kind):
    if some._bytes:
        raise RuntimeError("no room")
    return create(*kind)


@pytest.mark.parametrize("count", [1, 2, 3, 1000, 65536, 65537, 10**6 + 1, 2**31 + 5])
def test_lengths_are_rounded_up_slightly(count):
    assert count <= rounded(count) <= (2 * count if count <= 1 << 16 else count + count // 8 + 1)
    assert rounded(rounded(count)) == rounded(count)


def test_frames_show_no_previous_memory(linear, renderer, monkeypatch):
    """All that is free is filled with bits that are no number; the pictures are those of a new device."""
    drawing = renderer("vulkan")
    drawing.load(linear(grid(Shape.TETRAHEDRON, 1)), "u")
    near = Camera((2.0, -1.6, 1.7), (0.5, 0.5, 0.5), fov=35.0)
    objects = CUT, Faces(style=Style(opacity=0.5)), Isosurface((0.9,)), VOLUME
    scene = Scene("u", objects=objects, camera=near, size=(16, 12))
    drawing.device.memory.clear()
    expected = drawing.render(scene)

    give = Pool.give
    device = drawing.device._device

    def spoiled(own, piece):
        if own is drawing.device.memory:
            noise = drawing.device.buffer(np.full(piece.size, 0xA5, np.uint8)).memory
            encoder = device.create_command_encoder()
            encoder.copy_buffer(piece.memory, 0, noise, 0, piece.size)
            device.submit_command_buffer(encoder.finish())
            device.wait_for_idle()
        give(own, piece)

    monkeypatch.setattr(Pool, "give", spoiled)
    drawing.render(scene)
    made = drawing.device.memory.made
    found = drawing.render(scene)
    assert drawing.device.memory.made == made
    for name in ("field", "element", "status", "reference", "rgb", "depth"):
        assert np.array_equal(getattr(found, name), getattr(expected, name), equal_nan=name != "rgb"), name


def test_steps_on_one_mesh_reuse_its_device_data(linear, renderer):
    """Maps, boxes and faces are there once, coefficients again; frames are those of data that share nothing."""
    mesh = grid(Shape.TETRAHEDRON, 1)
    steps = [linear(mesh), doubled(linear(mesh))]
    near = Camera((2.0, -1.6, 1.7), (0.5, 0.5, 0.5), fov=35.0)
    scene = Scene("u", objects=(CUT, Faces(style=Style(opacity=0.5))), camera=near, size=(16, 12))
    drawing = renderer("vulkan")

    def frame(dataset):
        drawing.load(dataset, "u")
        return drawing.render(scene), drawing.stages

    expected = [frame(replace(step, mesh=copy(mesh)))[0] for step in steps]
    share(mesh)
    (first, before), (second, after) = map(frame, steps)
    for found, own in zip((first, second), expected, strict=True):
        assert np.array_equal(found.field, own.field, equal_nan=True)
        assert np.array_equal(found.rgb, own.rgb)
    held, now = before.loaded.buffers[0], after.loaded.buffers[0]
    assert [name for name in held if held[name] is not now[name]] == ["coefficients"]
    assert after.faces.faces is before.faces.faces
    assert after.loaded.bytes == before.loaded.bytes

    # another mesh of as many elements has nothing of this one
    _, other = frame(linear(grid(Shape.TETRAHEDRON, 1)))
    assert not any(held[name] is own for name, own in other.loaded.buffers[0].items())
    assert not other.loaded.shares_elements(after.loaded)


def test_a_replaced_step_leaves_nothing(linear, renderer):
    """Not even until garbage is collected: steps may be large."""
    drawing, mesh = renderer("vulkan"), grid(Shape.TETRAHEDRON, 1)
    camera = Camera((2.0, -1.6, 1.7), (0.5, 0.5, 0.5), fov=35.0)
    gc.disable()
    try:
        drawing.load(linear(mesh), "u")
        drawing.render(Scene("u", objects=(CUT, Faces()), camera=camera, size=(16, 12)))
        last = weakref.ref(drawing.stages.loaded)
        drawing.load(linear(mesh), "u")
        assert last() is None
    finally:
        gc.enable()


def doubled(dataset):
    """The dataset with twice its field, on the same mesh."""
    (own,) = dataset.fields
    blocks = tuple(replace(block, coefficients=2 * block.coefficients) for block in own.blocks)
    return replace(dataset, fields=(replace(own, blocks=blocks),))
