"""Data that are legal but strange: numbers that are none, mirrored, folded and coinciding elements, any scale."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Plane, Scene, SceneError, Status, render
from elvis.core.base.arrays import frozen_floats
from elvis.core.data.dataset import Block, Dataset, Field
from elvis.core.mapping.connectivity import connected
from elvis.core.mapping.geometry import geometry
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple
from elvis.renderer.asking.completing import default_field
from elvis.scene.record.palette import NOT_A_NUMBER

PLANE = Plane((0.5, 0.5, 0.5), (0.1, 0.2, 1.0))
SHAPES = [*Shape.of_dimension(2), *Shape.of_dimension(3)]
DEVICES = ("vulkan", "reference")


def plane_of(shape):
    return PLANE if shape.dimension == 3 else None


def spoilt(dataset, value, elements):
    """The first field with ``value`` for the last coefficient of the first few elements of each block."""
    blocks = []
    for block in dataset.fields[0].blocks:
        coefficients = block.coefficients.copy()
        coefficients[:elements, -1] = value
        blocks.append(replace(block, coefficients=frozen_floats(coefficients)))
    return replace(dataset, fields=(Field("u", tuple(blocks)),))


@pytest.mark.sampled
@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_nan_values_have_a_separate_colour(draw, linear, device, value):
    sound = linear(grid(Shape.HEXAHEDRON, 2))
    dataset = spoilt(sound, value, 4)
    bad = dataset.fields[0].blocks[0].element_ids[:4]
    frame = draw(dataset, device, plane=PLANE, size=(60, 50))
    there = np.isin(frame.element, bad)
    assert 0 < there.sum() < frame.seen.sum()
    assert not np.isfinite(frame.field[there]).any()
    assert np.isfinite(frame.field[frame.seen & ~there]).all()
    assert (frame.color[there] == NOT_A_NUMBER).all()
    assert not (frame.color[~there] == NOT_A_NUMBER).all(axis=-1).any()
    assert frame.counts()["not_a_number"] == there.sum()
    assert np.isfinite(frame.range).all()


def test_all_nan_data_give_a_picture(draw, linear, tmp_path):
    frame = draw(spoilt(linear(grid(Shape.QUADRILATERAL, 2)), np.nan, 4), size=(60, 50))
    assert frame.counts()["not_a_number"] == frame.seen.sum() > 0
    frame.save(tmp_path / "nan.png")


@pytest.mark.sampled(least=3, free=("shape",))
@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.label)
def test_mirrored_elements_are_drawn(same_on, linear, shape):
    mesh = curved(grid(shape, 2), ripple(0.04, seed=2), 3)
    curves = {
        name: replace(getattr(mesh, name), points=frozen_floats(getattr(mesh, name).points * [-1, 1, 1]))
        for name in ("edge_curves", "face_curves")
    }
    mirrored = replace(mesh, vertices=frozen_floats(mesh.vertices * [-1, 1, 1]), **curves)
    plane = Plane((-0.5, 0.5, 0.5), (0.1, 0.2, 1.0)) if shape.dimension == 3 else None
    frame, _ = same_on(linear(mirrored), plane=plane, size=(60, 50))
    expected = frame.position[frame.seen] @ [1.0, 2.0, -3.0]
    assert np.abs(frame.field[frame.seen] - expected).max() < 1e-12


def test_a_folded_element_shows_only_its_inside(draw, linear):
    corners = np.array([[0, 0, 0], [1, 0, 0], [0.2, 0.3, 0], [0, 1, 0]], float)
    frame = draw(linear(connected(corners, {Shape.QUADRILATERAL: np.array([[0, 1, 2, 3]])}, 2)), size=(90, 90))
    right = frame.position[frame.seen] @ [1.0, 2.0, -3.0]
    assert np.abs(frame.field[frame.seen] - right).max() < 1e-12
    assert frame.counts()["failed"] == 0


@pytest.mark.sampled(least=3, free=("shape",))
@pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.label)
def test_elements_in_one_place_do_not_mix(draw, shape):
    """Where elements coincide every pixel shows one of them, the same one each time, with its own field."""
    single = grid(shape, 2)
    twice = connected(single.vertices, {shape: np.repeat(corners_of(single, shape), 2, axis=0)}, shape.dimension)
    blocks = []
    for block in geometry(Dataset(twice)):
        coefficients = np.zeros(block.coefficients.shape[::2])
        one = np.linalg.lstsq(vertex_values(block), np.ones(len(shape.vertices)), rcond=None)[0]
        coefficients += np.outer(block.element_ids, one)
        blocks.append(Block(block.expansion, block.element_ids, frozen_floats(coefficients)))
    dataset = Dataset(twice, (Field("id", tuple(blocks)),))
    frames = [draw(dataset, plane=plane_of(shape), size=(300, 250)) for _ in range(3)]
    for frame in frames:
        assert np.abs(frame.field - frame.element)[frame.seen].max() < 1e-9
        assert np.array_equal(frame.element, frames[0].element)


def corners_of(mesh, shape):
    from elvis.core.mapping.orientation import local_vertices

    return local_vertices(mesh, shape)


def vertex_values(block):
    from elvis.core.polynomials.expansion import values

    return values(block.expansion, block.expansion.shape.vertices)


@pytest.mark.parametrize("scale", [2.0**-40, 2.0**30])
def test_pictures_are_independent_of_scale(same_on, linear, scale):
    mesh = curved(mixed_volume(seed=1), ripple(0.05, seed=3), 3)
    curves = {
        name: replace(getattr(mesh, name), points=frozen_floats(getattr(mesh, name).points * scale))
        for name in ("edge_curves", "face_curves")
    }
    scaled = linear(replace(mesh, vertices=frozen_floats(mesh.vertices * scale), **curves))
    point = (1.4 * scale, 0.4 * scale, 0.5 * scale)
    frame, _ = same_on(scaled, plane=Plane(point, (0.3, 0.5, 1.0)), size=(90, 70))
    plain, _ = same_on(linear(mesh), plane=Plane((1.4, 0.4, 0.5), (0.3, 0.5, 1.0)), size=(90, 70))
    assert np.array_equal(frame.element, plain.element)
    assert np.allclose(frame.field / scale, plain.field, rtol=0, atol=1e-11, equal_nan=True)


def test_far_from_the_origin(same_on, linear):
    """A thousand sizes away three digits are gone, and the pixels still agree."""
    mesh = grid(Shape.TETRAHEDRON, 2)
    moved = linear(replace(mesh, vertices=frozen_floats(mesh.vertices + np.array([1000, -2000, 500]))))
    same_on(moved, plane=Plane((1000.5, -1999.5, 500.5), (0.1, 0.2, 1.0)), size=(60, 50))


@pytest.mark.parametrize("device", DEVICES)
def test_elements_without_the_field_are_skipped(draw, linear, device):
    whole = linear(grid(Shape.HEXAHEDRON, 2))
    block = whole.fields[0].blocks[0]
    few = Block(block.expansion, block.element_ids[::2], frozen_floats(block.coefficients[::2]))
    frame = draw(replace(whole, fields=(Field("u", (few,)),)), device, plane=PLANE, size=(60, 50))
    assert set(np.unique(frame.element)) <= {-1, *few.element_ids}
    assert frame.seen.any()
    assert (frame.status[~frame.seen] == Status.MISS).all()


@pytest.mark.parametrize("device", DEVICES)
def test_a_field_without_elements_is_rejected(draw, linear, device):
    with pytest.raises(SceneError, match="nothing to draw"):
        draw(replace(linear(grid(Shape.HEXAHEDRON, 1)), fields=(Field("u", ()),)), device, plane=PLANE)


def test_a_map_given_as_fields_is_drawn(draw, linear):
    """The same element maps from curves and from fields show the same picture."""
    bent = linear(curved(grid(Shape.HEXAHEDRON, 2), ripple(0.06, seed=3), 4))
    maps = tuple(
        Field(f"map_{axis}", tuple(Block(b.expansion, b.element_ids, b.coefficients[:, i]) for b in geometry(bent)))
        for i, axis in enumerate("xyz")
    )
    straight = Dataset(grid(Shape.HEXAHEDRON, 2), (*bent.fields, *maps), metadata={"GeometryMap": "map_x,map_y,map_z"})
    frames = [draw(dataset, device, plane=PLANE, size=(60, 50)) for dataset in (bent, straight) for device in DEVICES]
    for frame in frames[1:]:
        assert np.array_equal(frame.element, frames[0].element)
        assert np.allclose(frame.field, frames[0].field, rtol=0, atol=1e-12, equal_nan=True)


def test_a_preview_has_no_record(renderer, linear, tmp_path):
    """Without reference coordinates pictures are the same, but exact records are rejected."""
    device, dataset = renderer("vulkan"), linear(grid(Shape.PRISM, 2))
    device.load(dataset, "u")
    scene = Scene("u", PLANE, size=(60, 50))
    exact, quick = device.render(scene), device.render(scene, references=False)
    assert quick.reference is None
    assert quick.field.tobytes() == exact.field.tobytes()
    assert quick.element.tobytes() == exact.element.tobytes()
    quick.save(tmp_path / "a.png")
    for name in ("a.npz", "a.exr"):
        with pytest.raises(SceneError, match="an exact record needs reference coordinates"):
            quick.save(tmp_path / name)
    assert [path.name for path in tmp_path.iterdir()] == ["a.png"]


def test_fields_of_the_map_are_not_used_as_colours(draw):
    """A mesh alone whose map travels as fields is a mesh alone; of more fields the first of the others is shown."""
    mesh = curved(grid(Shape.HEXAHEDRON, 1), ripple(0.05), 3)
    plain = Dataset(mesh)
    maps = [approximated(plain, f"map_{'xyz'[i]}", lambda p, i=i: p[:, i], 4) for i in range(3)]
    mapped = Dataset(mesh, tuple(maps), metadata={"GeometryMap": "map_x,map_y,map_z"})
    with pytest.raises(SceneError, match="a mesh but no field: also pass the field file, or name a quantity"):
        default_field(mapped)
    bare = render(mapped, device="reference", plane=PLANE, size=(40, 30))
    assert bare.scene.field == "1"
    assert (bare.field[bare.seen] == 1).all()
    other = approximated(plain, "u", lambda p: p[:, 0], 2)
    assert default_field(replace(mapped, fields=(*maps, other))) == "u"
    assert default_field(replace(mapped, metadata={})) == "map_x"
    frame = draw(mapped, "reference", field="x", plane=PLANE, size=(40, 30))
    assert frame.seen.any()
    assert np.abs(frame.field - frame.position[..., 0])[frame.seen].max() < 1e-12
