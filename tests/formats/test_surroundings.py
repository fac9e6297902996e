"""Parts of data know the surfaces of boundaries and the jumps to neighbours of the whole, to the last bit."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, Shape
from elvis.core.base.errors import ElvisError
from elvis.core.distances import surface_of
from elvis.core.distances.crossings import windings
from elvis.core.integrals import comes_apart, evaluated, integrate
from elvis.core.numbers.norms import quantity_norms
from elvis.core.portions import along_curve, portions, unite
from elvis.core.portions.borrowing import borrowing, surrounded
from elvis.core.quantities import Expression
from elvis.core.quantities.attributes import Attributes
from elvis.core.summary.summary import summary
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple
from elvis.core.testing.played_ranks import played

QUANTITIES = ("distance(all)", "jump(u)", "u+jump(v)*distance(boundary)")


def bent(mesh):
    """A mesh with curved elements and two fields: u that jumps, v of another order on some of the elements."""
    dataset = Dataset(curved(mesh, ripple(0.05), 3))
    random = np.random.default_rng(0)
    u = approximated(dataset, "u", lambda p: p[:, 0] * np.sin(p[:, 1] + p[:, 2]) + 0.1 * random.random(len(p)), 3)
    v = approximated(dataset, "v", lambda p: np.cos(3.0 * p[:, 0]) + 0.1 * random.random(len(p)), 5)
    some = tuple(block.of(np.flatnonzero(block.element_ids % 5 > 0)) for block in v.blocks)
    return Dataset(dataset.mesh, (u, replace(v, blocks=some)))


MESHES = {
    "tetrahedra": lambda: grid(Shape.TETRAHEDRON, 2),
    "all shapes": mixed_volume,
    "quadrilaterals": lambda: grid(Shape.QUADRILATERAL, 4),
}


def cuts(dataset):
    """Compact parts, parts at random, combs; of all shapes some have no elements."""
    ids = np.concatenate([entities.ids for entities in dataset.mesh.elements.values()])
    mixed_up = np.random.default_rng(0).permutation(ids)
    at_random = [np.sort(some) for some in np.array_split(mixed_up, 2)]
    return [along_curve(dataset, 3), at_random, [np.sort(ids)[start::9] for start in range(9)]]


def borrowed(dataset, parts, texts=QUANTITIES):
    """What each rank has of the data after it has borrowed."""
    return played(len(parts), lambda ranks: borrowing(portions(dataset, parts)[ranks.rank], texts, ranks))


@pytest.mark.sampled
@pytest.mark.parametrize("cut", range(3))
@pytest.mark.parametrize("name", MESHES)
def test_surfaces_and_jumps_match_those_of_the_whole(name, cut):
    dataset = bent(MESHES[name]())
    every = borrowed(dataset, cuts(dataset)[cut])
    for target in ("all", "boundary"):
        whole = surface_of(dataset, target)
        for part in every:
            own = part.dataset.surfaces[target]
            assert own.sides.tobytes() == whole.sides.tobytes()
            assert (own.is_closed, own.encloses, own.is_planar) == (True, whole.encloses, whole.is_planar)
            for some, wanted in zip(own.groups, whole.groups, strict=True):
                assert some.coefficients.tobytes() == wanted.coefficients.tobytes()
                assert some.face.tobytes() == wanted.face.tobytes()
    united = unite([part.alone for part in every]).dataset
    assert not united.surfaces
    for shape, entities in dataset.mesh.elements.items():
        for jump in ("jump(u)", "jump(v)"):
            own, wanted = (Attributes(data).constant(jump, shape, entities.ids) for data in (united, dataset))
            assert own.tobytes() == wanted.tobytes()
    assert np.nanmax(Attributes(dataset).constant("jump(u)", shape, entities.ids)) > 0.01


def test_sides_of_faces_are_found_once_over_all_ranks(monkeypatch):
    counts = []

    def counted(corners, gaps, places):
        counts.append(len(places))
        return windings(corners, gaps, places)

    monkeypatch.setattr("elvis.core.distances.sides.windings", counted)
    dataset = bent(grid(Shape.TETRAHEDRON, 2))
    borrowed(dataset, cuts(dataset)[0], ["distance(all)"])
    assert sorted(counts) == [16, 16, 16]


def test_tables_of_parts_match_those_of_the_whole():
    dataset = bent(grid(Shape.QUADRILATERAL, 3))
    expressions = [Expression.of(dataset, text) for text in QUANTITIES]
    parts = cuts(dataset)[1]

    def found(ranks):
        part = borrowing(portions(dataset, parts)[ranks.rank], QUANTITIES, ranks)
        return quantity_norms(part.dataset, expressions, ranks), summary(part, expressions[:2], ranks)

    first, *others = played(len(parts), found)
    assert repr(first) == repr((quantity_norms(dataset, expressions), summary(dataset, expressions[:2])))
    assert not any(facts for _, facts in others)
    # where a field has no values
    assert np.isnan(first[0]["u+jump(v)*distance(boundary)"].linf)


@pytest.mark.thorough
def test_integrals_of_parts_match_those_of_the_whole():
    dataset = bent(grid(Shape.TETRAHEDRON, 1))
    wanted, over = ["jump(u)", "1+distance(all)"], ["domain"]
    parts = cuts(dataset)[1]

    def found(ranks):
        part = surrounded(portions(dataset, parts)[ranks.rank], evaluated(dataset, wanted), ranks).dataset
        assert comes_apart(part, wanted, over, ranks=ranks)
        return integrate(part, wanted, over, 0.1, ranks=ranks)

    first, second = played(2, found)
    for own, other in zip(first, integrate(dataset, wanted, over, 0.1), strict=True):
        assert abs(own.value - other.value) <= own.error + other.error
        assert own.measure == pytest.approx(other.measure, rel=1e-5)
    assert not list(second)


def test_only_neighbours_are_sent():
    """Of a part's border, not of all elements: a rank sends some layers of a cube."""
    dataset = bent(grid(Shape.HEXAHEDRON, 8))
    parts = along_curve(dataset, 2)

    def sent(ranks):
        part = portions(dataset, parts)[ranks.rank]
        borrowing(part, ["jump(u)"], ranks)
        return ranks.sent[1 - ranks.rank], part.with_fields(["u"]).bytes

    for own, whole in played(2, sent):
        assert 0.1 * whole < own < 0.6 * whole


def test_unknown_surfaces_are_reported_for_distances():
    dataset = bent(grid(Shape.TETRAHEDRON, 2))
    composites = tuple(
        replace(own, parts=(("F", np.array([999])),)) if own.name == "boundary" else own
        for own in dataset.mesh.composites
    )
    dataset = replace(dataset, mesh=replace(dataset.mesh, composites=composites))
    for part in borrowed(dataset, along_curve(dataset, 2), ["distance(boundary)"]):
        assert not part.dataset.surfaces
        with pytest.raises(ElvisError, match="found none in 'boundary'"):
            surface_of(part.dataset, "boundary")
