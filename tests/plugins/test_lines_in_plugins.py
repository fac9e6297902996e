"""Lines in what runtime plugins open, by their host evaluation, against datasets and closed forms."""

import numpy as np
import pytest

from elvis import Camera, Glyphs, Scene, Status, Streamlines, render
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.mapping import pointwise
from elvis.core.mapping.patch import patches
from elvis.core.shapes import Shape
from elvis.core.streamlines import trace
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple
from elvis.plugins.fourier import FourierBox, write_box
from elvis.plugins.runtime.host.flow import HostFlow
from elvis.plugins.runtime.opening import PluginData
from elvis.plugins.runtime.source import VolumeSource
from elvis.plugins.runtime.volume import Part, PartsVolume, boxes_between, interface_folder
from elvis.reference.picture import render as render_reference
from elvis.scene.flow.flow import curves_in

ROTATION = {"u": lambda p: 0.5 - p[:, 1], "v": lambda p: p[:, 0] - 0.5, "w": lambda p: np.full(len(p), 0.001)}


class Copied(VolumeSource):
    """The elements of a dataset as a plugin gives them; in every second one places in the element are others.

    faces  as PartsVolume
    """

    def __init__(self, dataset, unit=False, turn=0.0, dimension=3, faces=None):
        self.dataset, self.unit, self.turn, self.dimension, self.faces = dataset, unit, turn, dimension, faces
        self.fields = tuple(field.name for field in dataset.fields)

    @classmethod
    def opens(cls, paths):
        return False

    def volume(self, field):
        parts = [self.part(patch) for patch in patches(self.dataset, [field])]
        return PartsVolume(parts, interface_folder(), self.dimension, self.faces)

    def part(self, patch):
        d = patch.shape.dimension

        def evaluate(elements, points):
            own = (2 * points - 1 if self.unit else points)[:, :d]
            moved = own + self.turn * (elements % 2)[:, None] * (1 - own**2)
            return pointwise.positions(patch, elements, moved), pointwise.values(patch, 0, elements, moved)

        count = len(patch)
        middle = pointwise.positions(patch, np.arange(count), np.tile(patch.shape.vertices.mean(axis=0), (count, 1)))
        boxes = boxes_between(middle - 2, middle + 2)
        return Part(
            "differentiated",
            patch.shape.name,
            patch.element_ids,
            boxes,
            {},
            None,
            "",
            evaluate,
            shape=patch.shape,
            unit=self.unit,
        )


def opened(dataset, **settings):
    return PluginData("copied", Copied(dataset, **settings))


def data(mesh, functions=ROTATION, modes=5):
    bare = Dataset(mesh)
    names = "uvw"[: mesh.dimension]
    return Dataset(mesh, tuple(approximated(bare, name, functions[name], modes) for name in names))


@pytest.mark.parametrize("unit", [False, True])
@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1])
@pytest.mark.thorough
def test_a_turn_in_curved_elements_of_every_shape(shape, unit):
    d = shape.dimension
    dataset = data(curved(grid(shape, 2 if d == 2 else 1), ripple(0.05), 3))
    plugin = HostFlow(opened(dataset, unit=unit, dimension=d))
    seed = np.array([[0.75, 0.5, 0.45]])[:, :d]
    found = trace(plugin, seed, duration=2 * np.pi, fields=["u"])
    assert found.counts() == {"duration": 1}
    climb = np.array([0, 0, 0.002 * np.pi])[:d]
    assert np.linalg.norm(found[0][-1, :d] - (seed[0] + climb)) < 1e-9
    assert np.abs(found.values["u"] - found.velocity[:, 0]).max() < 1e-11
    native = trace(dataset, seed, duration=2 * np.pi)
    assert set(found.element) == set(native.element)


def test_neighbours_with_different_coordinates_on_their_common_side():
    dataset = data(curved(grid(Shape.HEXAHEDRON, 2), ripple(0.03), 3))
    found = trace(HostFlow(opened(dataset, turn=0.2)), [[0.75, 0.5, 0.45]], duration=np.pi)
    assert found[0][-1] == pytest.approx([0.25, 0.5, 0.45 + 0.001 * np.pi], abs=1e-10)


@pytest.mark.thorough
def test_all_shapes_in_one_volume_and_seeds_on_sides():
    dataset = data(curved(mixed_volume(0), ripple(0.02), 3), {name: lambda p: np.ones(len(p)) for name in "uvw"})
    plugin = HostFlow(opened(dataset))
    found, native = (trace(own, ["elements", "boundary:all:1"], length=0.15) for own in (plugin, dataset))
    assert len(found) == len(native)
    assert found.counts()["left"] == native.counts()["boundary"]
    order, other = (np.lexsort(np.round(own.points[own.offsets[:-1]], 8).T) for own in (found, native))
    for line, same in zip(order, other, strict=True):
        # next to the apex of a pyramid maps are not smooth, and derivatives from values there so much less exact
        assert found[line][[0, -1]] == pytest.approx(native[same][[0, -1]], abs=1e-8)


class Blocks(VolumeSource):
    """A cube next to four smaller ones, which share no side with it, along a flow that shears."""

    fields = ("u",)
    low = np.array([[0, 0, 0], [1, 0, 0], [1, 0.5, 0], [1, 0, 0.5], [1, 0.5, 0.5]], float)
    size = np.array([1, 0.5, 0.5, 0.5, 0.5])

    def __init__(self, beyond=True, evaluated=True):
        self.beyond, self.evaluated = beyond, evaluated

    @classmethod
    def opens(cls, paths):
        return False

    def volume(self, field):
        def evaluate(elements, points):
            places = self.low[elements] + self.size[elements, None] * points
            is_out = (np.abs(points - 0.5) > 0.5 + 1e-3).any(axis=1) & (not self.beyond)
            return places, np.where(is_out, np.nan, 1 + places[:, 1])

        boxes = boxes_between(self.low, self.low + self.size[:, None])
        own = evaluate if self.evaluated else None
        part = Part("differentiated", "Cube", np.arange(5), boxes, {}, None, "", own, shape=Shape.HEXAHEDRON, unit=True)
        return PartsVolume([part], interface_folder())


@pytest.mark.parametrize("beyond", [True, False])
def test_smaller_neighbours_are_found(beyond):
    """Even where the author's function has no values beyond the elements."""
    found = trace(HostFlow(PluginData("blocks", Blocks(beyond))), [[0.1, 0.3, 0.7]], "u,0,0", ftle=True)
    assert found.counts() == {"left": 1}
    assert found[0][-1] == pytest.approx([1.5, 0.3, 0.7], abs=1e-10)
    assert found.element.tolist() == sorted(found.element, key=[0, 3].index)
    # a shear stretches by the largest singular value of ((1, t), (0, 1))
    time = 1.4 / 1.3
    assert found.time[-1] == pytest.approx(time, abs=1e-10)
    stretched = np.linalg.norm([[1, time], [0, 1]], ord=2)
    assert found.ftle[0] == pytest.approx(np.log(stretched) / time, abs=1e-9)


@pytest.mark.thorough
def test_lines_ribbons_arrows_and_glyphs_in_pictures_match_those_of_the_reference(tmp_path):
    amplitudes = np.zeros((2, 2, 2))
    amplitudes[0, 0, 0], amplitudes[0, 1, 0] = 1.0, 0.5
    fields = {"u": amplitudes, "v": amplitudes.swapaxes(0, 1)}
    write_box(tmp_path / "box.npz", np.zeros(3), np.ones(3), ("fourier", "legendre", "legendre"), fields)
    box = PluginData("fourier", FourierBox([tmp_path / "box.npz"]))
    velocity = "u,v,0.2"
    tube = Streamlines(("line:0.1,0.1,0.1:0.1,0.6,0.1:2",), velocity=velocity, radius=0.04, arrows=0.4)
    ribbon = Streamlines(("point:0.1,0.2,0.4",), velocity=velocity, ribbon=0.1)
    glyphs = Glyphs(("point:0.8,0.3,0.2",), vector=velocity, length=0.3)
    # one that is fitted to what is seen would draw the lines more often
    camera = Camera((2.2, -1.7, 1.9), (0.5, 0.5, 0.5), fov=28.0)
    scene = Scene("v", objects=(tube, ribbon, glyphs), camera=camera, size=(26, 26))
    found, true = render(box, scene=scene), render_reference(box, scene)
    seen = (found.status == Status.CERTAIN) & (true.status == Status.CERTAIN)
    assert seen.sum() > 80
    assert (found.status != true.status).sum() < 8
    assert np.abs(found.field - true.field)[seen].max() < 1e-11
    assert np.abs(found.position - true.position)[seen].max() < 1e-10


def test_invalid_input_is_rejected():
    with pytest.raises(ElvisError, match="the plugin blocks lets no lines be followed: expected parts with a shape"):
        HostFlow(PluginData("blocks", Blocks(evaluated=False)))
    flow = HostFlow(PluginData("blocks", Blocks()))
    with pytest.raises(ElvisError, match="lines on the wall all: expected a dataset, found data opened by"):
        trace(flow, [[0.1, 0.3, 0.7]], wall="all")
    with pytest.raises(ElvisError, match="expected a velocity of 3 components"):
        trace(flow, [[0.1, 0.3, 0.7]], "u,0")
    with pytest.raises(ElvisError, match="the data lack a velocity"):
        trace(flow, [[0.1, 0.3, 0.7]])
    with pytest.raises(ElvisError, match="there is no boundary 'inlet'; there are all"):
        trace(flow, "boundary:inlet", "u,0,0")
    with pytest.raises(ElvisError, match="since: expected a moment of a series"):
        curves_in(flow, Streamlines(("elements",), velocity="u,0,0", since=0.0))
