"""Faces of elements: their maps, their two sides, their names."""

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset, Field
from elvis.core.mapping.geometry import geometry
from elvis.core.mapping.margins import margins
from elvis.core.polynomials.bernstein import bernstein_values
from elvis.core.polynomials.expansion import values
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, ripple, scattered, shuffled
from elvis.plugins.faces import native_faces
from elvis.plugins.faces.nets import face_space


@pytest.fixture(scope="module")
def mixed():
    """Curved elements of all volume shapes, their faces entered any way round: faces and blocks."""
    dataset = Dataset(curved(shuffled(mixed_volume(3), 1), ripple(0.1), 4))
    blocks = geometry(dataset)
    return native_faces(dataset, [block.element_ids for block in blocks]), blocks


def images(block, points):
    """(n, points, 3) images of face points by the nets, and (n, points, 3) their reference coordinates."""
    net = block.nets(np.arange(len(block)))
    basis, frame = bernstein_values(block.space.space, points), block.frames[block.local]
    references = frame[:, None, 0] + np.einsum("pi,nij->npj", points, frame[:, 1:])
    homogeneous = np.einsum("pk,nkd->npd", basis, net)
    return homogeneous[..., :3] / homogeneous[..., 3:], references


def test_nets_are_the_maps_of_the_elements(mixed):
    faces, blocks = mixed
    assert {block.solid for block in faces.blocks} == {"tetrahedron", "pyramid", "prism", "hexahedron"}
    for block in faces.blocks:
        own = blocks[block.part]
        positions, references = images(block, scattered(block.space.shape, 12))
        for n, element in enumerate(block.element):
            basis = values(own.expansion, references[n])
            assert np.allclose(positions[n], basis @ own.coefficients[element].T, rtol=0, atol=1e-13)


def test_maps_given_as_fields_match_those_of_the_faces():
    mesh = curved(mixed_volume(), ripple(0.1), 3)
    plain = Dataset(mesh)
    fields = [
        Field(f"map_{axis}", tuple(approximated(plain, axis, lambda p, i=i: p[:, i] + 0.1 * p[:, 0] ** 2, 4).blocks))
        for i, axis in enumerate("xyz")
    ]
    mapped = Dataset(mesh, tuple(fields), metadata={"GeometryMap": "map_x,map_y,map_z"})
    blocks = geometry(mapped)
    for block in native_faces(mapped, [block.element_ids for block in blocks]).blocks:
        positions, references = images(block, scattered(block.space.shape, 5))
        basis = values(blocks[block.part].expansion, references[0])
        assert np.allclose(positions[0], basis @ blocks[block.part].coefficients[block.element[0]].T, atol=1e-12)


def test_both_sides_of_a_face_are_one_surface(mixed):
    faces, _ = mixed
    first = np.cumsum([0, *map(len, faces.ids)])
    middles = {}
    for block, beyond in zip(faces.blocks, faces.neighbours, strict=True):
        corner = Shape.TRIANGLE if block.space.shape is Shape.TRIANGLE else Shape.QUADRILATERAL
        positions = images(block, np.concatenate([corner.vertices]))[0]
        for n, entity in enumerate(block.entity):
            middles.setdefault(entity, []).append((block.element[n] + first[block.part], beyond[n], positions[n]))
    for sides in middles.values():
        assert len(sides) in (1, 2)
        owners, beyonds = [side[0] for side in sides], [side[1] for side in sides]
        assert beyonds == ([-1] if len(sides) == 1 else owners[::-1])
        corners = [np.array(sorted(side[2].round(9).tolist())) for side in sides]
        assert np.allclose(corners[0], corners[-1], atol=1e-12)


def test_halves_are_parts_of_the_same_map(mixed):
    for block in mixed[0].blocks:
        space, net = block.space, block.nets(np.arange(len(block)))
        points = scattered(space.shape, 9)
        for cuts, halves in zip(space.cuts, space.halves, strict=True):
            for cut, half in zip(cuts, halves, strict=True):
                own = bernstein_values(space.space, points) @ (cut @ net)
                whole = bernstein_values(space.space, half[0] + points @ half[1:]) @ net
                assert np.allclose(own, whole, rtol=0, atol=1e-13)


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL])
def test_halves_cover_a_face_once(shape):
    points = scattered(shape, 200)
    points = points[margins(shape, points) > 0]
    for halves in face_space(shape, 1).halves:
        held = [margins(shape, (points - half[0]) @ np.linalg.inv(half[1:])) > 0 for half in halves]
        assert (np.sum(held, axis=0) == 1).all()


@pytest.mark.parametrize("shape", [Shape.TRIANGLE, Shape.QUADRILATERAL])
@pytest.mark.parametrize("degree", [1, 2, 5, 9])
def test_derivative_nets_are_derivatives(shape, degree):
    space, rng = face_space(shape, degree), np.random.default_rng(degree)
    net, points, step = rng.normal(size=space.count), scattered(shape, 7), 1e-6
    for axis, matrix in enumerate(space.derivatives):
        shift = step * np.eye(2)[axis]
        difference = bernstein_values(space.space, points + shift) - bernstein_values(space.space, points - shift)
        low, high = (matrix @ net).min(), (matrix @ net).max()
        gradient = difference @ net / (2 * step)
        assert (gradient >= low - 1e-6 * abs(low)).all()
        assert (gradient <= high + 1e-6 * abs(high)).all()


def test_faces_are_chosen_by_name(mixed):
    faces, _ = mixed
    count = lambda *words: sum(map(len, faces.select(words)))  # noqa: E731
    every, outer, inner = sum(map(len, faces.blocks)), count("all"), count("inner")
    assert outer + inner == every
    assert count("boundary") == outer == count("4")
    assert count("shape:prism") == count("region:prism") == count("region:2") == 10
    assert count("element:0") == 4
    assert count("all", "inner") == every


@pytest.mark.parametrize("word", ["nowhere", "element:99", "element:x", "shape:cone", "region:9"])
def test_unknown_face_names_are_rejected(mixed, word):
    with pytest.raises(ElvisError, match=word.partition(":")[2] or word):
        mixed[0].select([word])


def test_plane_elements_are_faces():
    dataset = Dataset(mixed_plane())
    faces = native_faces(dataset, [block.element_ids for block in geometry(dataset)])
    assert sum(map(len, faces.select(["all"]))) == sum(map(len, dataset.mesh.elements.values()))
    for block in faces.blocks:
        positions, references = images(block, scattered(block.space.shape, 4))
        assert not positions[..., 2].any()
        assert not references[..., 2].any()


def test_lines_have_no_faces():
    with pytest.raises(ElvisError, match="no faces"):
        native_faces(Dataset(grid(Shape.SEGMENT, 2)), [np.arange(2)])
