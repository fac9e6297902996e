"""Point location on meshes: shared faces, gaps, holes, overlaps, Fourier directions; fields at points."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from elvis import read
from elvis.core.base.arrays import frozen_floats, frozen_ints
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Block, Dataset, Expansion, Field, Homogeneous
from elvis.core.mapping.connectivity import connected
from elvis.core.mapping.enclosure import hulls
from elvis.core.mapping.inverse import Status, invert
from elvis.core.mapping.locate import Locator, locate
from elvis.core.mapping.margins import TOLERANCE, margins
from elvis.core.mapping.patch import patches
from elvis.core.mapping.pointwise import determinants, gradients, positions, values
from elvis.core.numbers.sampling import Sampler, sample
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape
from elvis.core.testing import (
    approximated,
    curved,
    grid,
    mixed_plane,
    mixed_volume,
    ripple,
    scattered,
    shuffled,
)


@cache
def bent_mesh(dimension, seed=1):
    mesh = mixed_volume(seed) if dimension == 3 else mixed_plane(seed)
    dataset = Dataset(curved(shuffled(mesh, seed), ripple(0.15, seed), 4))
    field = approximated(dataset, "u", lambda x: np.sin(x[:, 0]) + x[:, 1], 4)
    return replace(dataset, fields=(field,))


@pytest.mark.parametrize("dimension", [2, 3])
def test_every_element_finds_its_own_points(dimension):
    dataset = bent_mesh(dimension)
    parts = patches(dataset)
    locator = Locator(parts)
    for number, patch in enumerate(parts):
        points = scattered(patch.shape, 50, number)
        points = points[margins(patch.shape, points) > 1e-6]
        rows = np.repeat(np.arange(len(patch)), len(points))
        own = np.tile(points, (len(patch), 1))
        found = locator.locate(positions(patch, rows, own))
        np.testing.assert_array_equal(found.point, np.arange(len(rows)))
        np.testing.assert_array_equal(found.element_id, patch.element_ids[rows])
        np.testing.assert_array_equal(found.patch, number)
        np.testing.assert_array_equal(found.row, rows)
        np.testing.assert_allclose(found.reference, own, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.margin, margins(patch.shape, own), rtol=0, atol=1e-9)


@pytest.mark.parametrize("dimension", [2, 3])
def test_parts_of_elements_cover_them(dimension):
    """Every point of an element is in the box of a part of it, and parts are smaller than the element."""
    for patch in patches(bent_mesh(dimension)):
        points = scattered(patch.shape, 200, seed=1)
        corners = np.concatenate([points[margins(patch.shape, points) >= 0], patch.shape.vertices])
        low, high = hulls(patch, 0, 4)
        world = positions(patch, np.zeros(len(corners), int), corners)[:, None]
        assert ((world >= low - 1e-12) & (world <= high + 1e-12)).all(axis=2).any(axis=1).all()
        whole = high.max(axis=0) - low.min(axis=0)
        assert ((high - low)[:, :dimension] < 0.75 * whole[:dimension]).all()


@pytest.mark.parametrize("dimension", [2, 3])
def test_subdivided_elements_contain_the_same_points(dimension, monkeypatch):
    parts = patches(bent_mesh(dimension))
    box = np.concatenate([positions(p, np.arange(len(p)), np.zeros((len(p), dimension))) for p in parts])
    points = np.random.default_rng(0).uniform(box.min(axis=0) - 0.7, box.max(axis=0) + 0.7, (3000, 3))
    points[:, dimension:] = 0.0
    answers = []
    monkeypatch.setattr("elvis.core.mapping.locate._WORTH_OF_PRODUCTS", 0.0)
    for worth in (1, 10**9):
        monkeypatch.setattr("elvis.core.mapping.locate._WORTH", worth)
        answers.append(Locator(parts).locate(points, all=True))
    for name in ("point", "element_id", "status", "reference"):
        np.testing.assert_array_equal(getattr(answers[0], name), getattr(answers[1], name))
    assert (answers[0].status == Status.INSIDE).sum() > 100


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_points_on_shared_faces_belong_to_both_elements(dimension, seed):
    parts = patches(bent_mesh(dimension, seed))
    points = []
    for patch in parts:
        corners = patch.shape.faces if dimension == 3 else patch.shape.edges
        for face in corners:
            weights = np.random.default_rng(len(points)).dirichlet(np.ones(len(face)), 3)
            local = weights @ patch.shape.vertices[list(face)]
            for row in range(len(patch)):
                points.append(positions(patch, np.full(3, row), local))
    world = np.concatenate(points)
    one, every = locate(parts, world), locate(parts, world, all=True)
    assert (one.status == Status.INSIDE).all()
    np.testing.assert_array_equal(one.point, np.arange(len(world)))
    counts = np.bincount(every.point)
    mesh = bent_mesh(dimension, seed).mesh
    boundary = len(mesh.composites[-1].parts[0][1])
    assert set(counts) == {1, 2}
    assert (counts == 1).sum() == 3 * boundary

    # both answers are right, and the single one is among them
    for number, patch in enumerate(parts):
        here = every.patch == number
        back = positions(patch, every.row[here], every.reference[here])
        np.testing.assert_allclose(back, world[every.point[here]], rtol=0, atol=1e-12)
    pairs = set(zip(every.point.tolist(), every.element_id.tolist(), strict=True))
    assert pairs >= set(zip(one.point.tolist(), one.element_id.tolist(), strict=True))


def test_the_largest_margin_wins():
    parts = patches(bent_mesh(3))
    world = np.random.default_rng(0).uniform([0, 0, 0], [3, 1, 1], (2000, 3))
    one, every = locate(parts, world), locate(parts, world, all=True)
    best = np.full(len(world), -np.inf)
    hits = every.status == Status.INSIDE
    np.maximum.at(best, every.point[hits], every.margin[hits])
    inside = one.status == Status.INSIDE
    np.testing.assert_array_equal(one.margin[inside], best[inside])
    np.testing.assert_array_equal(np.isfinite(best), inside)


@pytest.mark.parametrize("shape", Shape.of_dimension(2) + Shape.of_dimension(3))
def test_no_point_of_a_mesh_is_lost(shape):
    """Curved neighbours leave no gap: each point in the middle of a curved grid has an element."""
    bump = ripple(0.03, 4)
    parts = patches(Dataset(curved(grid(shape, 3), bump, 3)))
    rng = np.random.default_rng(1)
    world = np.zeros((3000, 3))
    world[:, : shape.dimension] = rng.uniform(0.05, 0.95, (3000, shape.dimension))
    if shape.dimension == 2:
        parts = patches(Dataset(replace(curved(grid(shape, 3), bump, 3), space=2)))
    assert (locate(parts, world).status == Status.INSIDE).all()
    beyond = world + np.array([1.2, 0, 0])
    assert (locate(parts, beyond).status == Status.OUTSIDE).all()


def shifted(mesh, shift):
    """The mesh of straight elements elsewhere."""
    return replace(mesh, vertices=frozen_floats(mesh.vertices + shift))


@pytest.mark.parametrize("power", [20, 30])
@pytest.mark.parametrize("cells", [2, 4])
def test_no_point_far_from_the_origin_is_lost(cells, power):
    """Rounding of world coordinates is more than the tolerance of borders: points were between two triangles."""
    shift = 2.0**power * np.array([1.0, -1.0, 0.0])
    dataset = Dataset(shifted(grid(Shape.TRIANGLE, cells), shift))
    lines = np.arange(33) / 32
    near = np.stack([*np.meshgrid(lines, lines), np.zeros((33, 33))], axis=-1).reshape(-1, 3)
    assert (locate(dataset, near + shift).status == Status.INSIDE).all()

    # what is outside by more than rounding is so still
    rounding = 2.0 ** (power - 46)
    beyond = np.concatenate([near[near[:, axis] == 1] + np.eye(3)[axis] * rounding for axis in (0, 1)])
    assert (locate(dataset, beyond + shift).status == Status.OUTSIDE).all()


def test_no_border_of_a_curved_element_far_from_the_origin_is_in_doubt():
    """The search ends where rounding does not let it shrink its cells further."""
    shift, bump = 2.0**30 * np.array([1.0, -1.0, 1.0]), ripple(0.03, 1)
    mesh = curved(shifted(grid(Shape.TETRAHEDRON, 1), shift), lambda points: bump(points - shift) + shift, 4)
    within = np.random.default_rng(2).random((600, 3))
    within[:, 0] = np.random.default_rng(3).integers(0, 2, 600)
    found = locate(Dataset(mesh), bump(within) + shift)
    assert (found.status != Status.FAILED).all()
    assert (found.status == Status.INSIDE).sum() > 200


def test_only_rounding_across_a_facet_counts():
    """Slivers a millionth thick: rounding of thicknesses does not make them longer."""
    shift = np.array([0.0, 0.0, 2.0**10])
    thin = grid(Shape.TETRAHEDRON, 1)
    thin = replace(thin, vertices=frozen_floats(thin.vertices * [1, 1, 2.0**-20] + shift))
    lines = np.arange(17) / 16
    points = np.stack(np.meshgrid(lines, lines, lines), axis=-1).reshape(-1, 3) * [1, 1, 2.0**-20] + shift
    assert (locate(Dataset(thin), points).status == Status.INSIDE).all()
    assert (locate(Dataset(thin), points[points[:, 0] == 1] + [1e-8, 0, 0]).status == Status.OUTSIDE).all()


def test_holes_in_the_domain_are_outside():
    mesh = grid(Shape.QUADRILATERAL, 3)
    ring = replace(mesh.composites[0], parts=(("Q", frozen_ints([0, 1, 2, 3, 5, 6, 7, 8])),))
    dataset = Dataset(replace(mesh, composites=(ring,)))
    x = np.linspace(0.01, 0.99, 40)
    points = np.stack([x, 0 * x + 0.5, 0 * x], axis=1)
    found = locate(dataset, points)
    hole = (x > 1 / 3) & (x < 2 / 3)
    np.testing.assert_array_equal(found.status == Status.OUTSIDE, hole)
    np.testing.assert_array_equal(found.element_id[hole], -1)
    assert np.isnan(found.reference[hole]).all()
    assert np.isnan(found.margin[hole]).all()


def test_points_off_the_plane_and_odd_points_are_outside():
    dataset = bent_mesh(2)
    points = np.array([[0.5, 0.5, 0.1], [np.nan, 0.5, 0], [np.inf, 0.5, 0], [0.5, 0.5, 1e9], [0.5, 0.5, 0]])
    status = locate(dataset, points).status
    np.testing.assert_array_equal(status, [Status.OUTSIDE] * 4 + [Status.INSIDE])
    assert len(locate(dataset, np.empty((0, 3)))) == 0
    with pytest.raises(ElvisError, match=r"points \(n, 3\), found an array of shape \(2, 2\)"):
        locate(dataset, np.zeros((2, 2)))


def test_a_mesh_without_elements_contains_no_points():
    found = Locator(()).locate(np.zeros((3, 3)), all=True)
    np.testing.assert_array_equal(found.status, [Status.OUTSIDE] * 3)


def test_shapes_without_elements_in_a_part_are_skipped():
    """Sides that don't match may touch elements of some shapes only."""
    every = patches(Dataset(mixed_volume()))
    parts = [patch if patch.shape is Shape.HEXAHEDRON else patch.part(np.empty(0, np.int64)) for patch in every]
    found = Locator(parts).locate(np.array([[0.5, 0.5, 0.5], [2.9, 0.5, 0.5]]))
    assert found.status.tolist() == [Status.INSIDE, Status.OUTSIDE]


def test_overlapping_elements_are_all_found():
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]], float)
    mesh = connected(vertices, {Shape.TETRAHEDRON: np.array([[0, 1, 2, 3], [0, 1, 2, 4]])})
    found = locate(Dataset(mesh), np.array([[0.3, 0.3, 0.1]]), all=True)
    np.testing.assert_array_equal(found.element_id, [0, 1])


def spoilt(vertices, how, rng):
    """Vertices of a mesh that no solver would accept."""
    some = rng.integers(len(vertices), size=2)
    if how == "coincident":
        vertices[some[0]] = vertices[some[1]]
    elif how == "tangled":
        vertices += rng.normal(size=vertices.shape) / 2
    elif how == "thin":
        vertices *= [1, 1e-9, 1]
    elif how == "a point":
        vertices[:] = vertices[0]
    else:
        vertices[some[0]] = float(how)
    return frozen_floats(vertices)


@pytest.mark.sampled
@pytest.mark.parametrize("how", ["coincident", "tangled", "thin", "a point", "nan", "inf", "-1e300", "1e160"])
@pytest.mark.parametrize("seed", range(4))
def test_damaged_meshes_give_correct_answers_or_none(how, seed):
    rng = np.random.default_rng(seed)
    mesh = mixed_volume(seed) if seed % 2 else mixed_plane(seed)
    mesh = replace(mesh, vertices=spoilt(np.array(mesh.vertices), how, rng))
    if seed > 1 and np.isfinite(mesh.vertices).all():
        mesh = curved(mesh, ripple(0.2, seed), 3)
    parts = patches(Dataset(mesh))
    world = rng.uniform([-0.5, -1.5, -0.5], [3.5, 1.5, 1.5], (200, 3)) * [1, 1, mesh.dimension - 2]
    found = locate(parts, world, all=True)
    for number, patch in enumerate(parts):
        here = found.patch == number
        back = positions(patch, found.row[here], found.reference[here])
        np.testing.assert_allclose(back, world[found.point[here]], rtol=0, atol=1e-5 if mesh.dimension == 2 else 1e-12)
        assert (margins(patch.shape, found.reference[here, : patch.shape.dimension]) >= -TOLERANCE).all()


# Fields


def test_samples_are_the_field():
    dataset = bent_mesh(3)
    world = np.random.default_rng(3).uniform([-1, -1, -1], [4, 1.5, 1.5], (3000, 3))
    taken = sample(dataset, ["u", "u"], world)
    hits = taken.location.status == Status.INSIDE
    assert 0 < hits.sum() < len(hits)
    np.testing.assert_array_equal(taken.points, world)
    np.testing.assert_allclose(taken.values[hits, 0], (np.sin(world[:, 0]) + world[:, 1])[hits], rtol=0, atol=1e-2)
    np.testing.assert_array_equal(taken.values[:, 0], taken.values[:, 1])
    assert np.isnan(taken.values[~hits]).all()
    sampler = Sampler(dataset, ["u"])
    derivatives = sampler.gradients(taken.location)[hits, 0]
    exact = np.stack([np.cos(world[hits, 0]), np.ones(hits.sum()), np.zeros(hits.sum())], axis=1)
    np.testing.assert_allclose(derivatives, exact, rtol=0, atol=0.2)


def test_both_values_of_a_jump_are_given():
    mesh = grid(Shape.HEXAHEDRON, 2)
    (block,) = approximated(Dataset(mesh), "u", lambda x: x[:, 0], 2).blocks
    jumping = Block(
        block.expansion, block.element_ids, frozen_floats(block.coefficients + 10.0 * np.arange(8)[:, None])
    )
    dataset = Dataset(mesh, (Field("u", (jumping,), False),))
    taken = sample(dataset, ["u"], np.array([[0.5, 0.2, 0.2], [0.5, 0.5, 0.5], [7, 7, 7]]), all=True)
    np.testing.assert_array_equal(taken.location.point, [0] * 2 + [1] * 8 + [2])
    by_element = taken.location.element_id[:-1].argsort(kind="stable")
    np.testing.assert_allclose(
        taken.values[:-1, 0][by_element], 0.5 + 10.0 * taken.location.element_id[:-1][by_element], rtol=0, atol=1e-12
    )


def test_a_field_is_nan_on_elements_where_it_is_missing():
    dataset = bent_mesh(3)
    partial = Field("v", dataset.fields[0].blocks[1:])
    taken = sample(
        replace(dataset, fields=(*dataset.fields, partial)), ["u", "v"], np.array([[2.8, 0.5, 0.5], [0.5, 0.5, 0.5]])
    )
    assert np.isfinite(taken.values[:, 0]).all()
    assert (taken.location.status == Status.INSIDE).all()
    np.testing.assert_array_equal(np.isnan(taken.values[:, 1]), [True, False])
    with pytest.raises(ElvisError, match="there is no"):
        sample(dataset, ["p"], np.zeros((1, 3)))


def fourier(mesh, shape, lengths, bases, ids):
    """u = 1 + x cos(2 pi z / LZ) on a mesh of one shape, times cos(2 pi y / LY) with two directions."""
    plain = Expansion(shape, (Basis.MODIFIED_A,) * shape.dimension, (2,) * shape.dimension)
    (ones,) = approximated(Dataset(mesh), "u", lambda x: np.ones(len(x)), 2).blocks
    (linear,) = approximated(Dataset(mesh), "u", lambda x: x[:, 0], 2).blocks
    y_ids = tuple(i for i, _ in ids) if len(lengths) == 2 else ()
    z_ids = tuple(ids) if len(lengths) == 1 else tuple(i for _, i in ids)
    planes = {0: ones.coefficients, len(ids) - 1: linear.coefficients}
    rows = [planes.get(i, 0 * ones.coefficients) for i in range(len(ids))]
    expansion = replace(plain, homogeneous=Homogeneous(bases, lengths, z_ids, y_ids))
    return Field("u", (Block(expansion, ones.element_ids, frozen_floats(np.concatenate(rows, axis=1))),))


@pytest.mark.parametrize("z", [0.0, 0.7, 2.5, 4.0, -0.3, 9.1])
def test_one_fourier_direction_is_periodic(z):
    mesh = grid(Shape.QUADRILATERAL, 2)
    field = fourier(mesh, Shape.QUADRILATERAL, (4.0,), (Basis.FOURIER,), (0, 1, 2))
    points = np.column_stack([np.random.default_rng(0).random((50, 2)), np.full(50, z)])
    dataset = Dataset(mesh, (field,))
    taken = sample(dataset, ["u"], points)
    assert (taken.location.status == Status.INSIDE).all()
    angle = 2 * np.pi * z / 4
    np.testing.assert_allclose(taken.values[:, 0], 1 + points[:, 0] * np.cos(angle), rtol=0, atol=1e-12)
    derivatives = Sampler(dataset, ["u"]).gradients(taken.location)[:, 0]
    exact = [0 * points[:, 0] + np.cos(angle), 0 * points[:, 0], -points[:, 0] * np.sin(angle) * 2 * np.pi / 4]
    np.testing.assert_allclose(derivatives, np.stack(exact, axis=1), rtol=0, atol=1e-11)
    (patch,) = patches(dataset, ["u"])
    back = positions(patch, taken.location.row, taken.location.reference)
    np.testing.assert_allclose(back[:, 2], z if 0 <= z <= 4 else z % 4, rtol=0, atol=1e-12)
    np.testing.assert_allclose(determinants(patch, taken.location.row, taken.location.reference), 2 / 16, rtol=1e-12)


def test_two_fourier_directions():
    mesh = grid(Shape.SEGMENT, 3)
    ids = ((0, 0), (0, 1), (0, 2), (2, 2))
    field = fourier(mesh, Shape.SEGMENT, (3.0, 5.0), (Basis.FOURIER, Basis.FOURIER), ids)
    points = np.random.default_rng(1).random((100, 3)) * [1, 3, 5]
    taken = sample(Dataset(mesh, (field,)), ["u"], points)
    x, y, z = points.T
    exact = 1 + x * np.cos(2 * np.pi * y / 3) * np.cos(2 * np.pi * z / 5)
    np.testing.assert_allclose(taken.values[:, 0], exact, rtol=0, atol=1e-12)


def test_patches_without_a_field_are_reported():
    (patch, *_) = patches(bent_mesh(3))
    row, point = np.zeros(1, int), np.full((1, 3), -1.0)
    with pytest.raises(IndexError):
        values(patch, 0, row, point)
    (tetrahedra, *_) = patches(replace(bent_mesh(3), fields=(Field("v", ()),)), ["v"])
    for function in (values, gradients):
        with pytest.raises(ElvisError, match="expected a patch with field 0, found none for element 0"):
            function(tetrahedra, 0, row, point)


# Real data


def truths(folder):
    """Rows of the table in a folder: element id, reference coordinates, world coordinates (three)."""
    element, rows = -1, []
    for line in next(folder.glob("*.truth.txt")).read_text().splitlines():
        parts = line.split("|")
        if line.startswith("E "):
            element = int(line.split()[1])
        elif len(parts) == 3 and not line.startswith("#"):
            world = [float(x) for x in parts[1].split()]
            rows.append((element, [float(x) for x in parts[0].split()], [*world, 0.0, 0.0][:3]))
    return rows


def test_points_of_real_elements_are_recovered(case, nektar, case_files):
    if not list((nektar / case).glob("*.truth.txt")):
        return
    parts = patches(read(case_files(case)[0]))
    rows = truths(nektar / case)
    ids, world = np.array([row[0] for row in rows]), np.array([row[2] for row in rows])
    reference = np.full((len(rows), parts[0].shape.dimension), np.nan)
    for patch in parts:
        here = np.flatnonzero(np.isin(ids, patch.element_ids))
        order = np.argsort(patch.element_ids)
        own = order[np.searchsorted(patch.element_ids, ids[here], sorter=order)]
        reference[here] = invert(patch, own, world[here]).reference
    np.testing.assert_allclose(reference, np.array([row[1] for row in rows]), rtol=0, atol=1e-9)

    # and each is found in its element among all
    found = locate(parts, world, all=True)
    pairs = set(zip(found.point.tolist(), found.element_id.tolist(), strict=True))
    assert pairs >= set(enumerate(ids.tolist()))
