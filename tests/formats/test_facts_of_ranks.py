"""What ranks find of a dataset in parts is what one process finds, to the byte."""

import json
from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, read, write
from elvis.core.bounds import bounding, ranges
from elvis.core.bounds import extrema as extrema_module
from elvis.core.bounds import quantity_extrema as quantity_extrema_module
from elvis.core.bounds.quantity_extrema import quantity_extrema, shared_extrema
from elvis.core.data.dataset import Block, Field, Homogeneous
from elvis.core.data.mesh import Composite
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.expansion import mode_count
from elvis.core.polynomials.interpolation import modified
from elvis.core.portions import Portion
from elvis.core.quantities import Expression
from elvis.core.shapes import Shape
from elvis.core.summary.summary import summary
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple
from elvis.core.testing.played_ranks import played
from elvis.core.validity import validity as validity_module
from elvis.core.validity.validity import shared_validity, validity, validity_facts
from elvis.formats.reading import read_part


def bent(shape=None):
    """Bent elements, a boundary, vertices that no element has; a field of two orders, not finite in places."""
    mesh = curved(mixed_volume() if shape is None else grid(shape, 3), ripple(0.05), 3)
    low, high = (approximated(Dataset(mesh), "u", lambda p: np.sin(5 * p[:, 0]) - p[:, 1], order) for order in (3, 4))
    one = approximated(Dataset(mesh), "one", lambda p: 0 * p[:, 0] + 0.1, 3)
    alone = np.full((2, 3), 7.0)
    ids = np.append(mesh.vertex_ids, mesh.vertex_ids.max() + np.array([1, 5]))
    sides = Shape.TRIANGLE if mesh.dimension == 3 else Shape.SEGMENT
    composites = (
        *(Composite(n, ((own.tag, entities.ids),)) for n, (own, entities) in enumerate(mesh.elements.items())),
        Composite(8, ((("F" if mesh.dimension == 3 else "E"), mesh.of(sides).ids[::3]), ("V", ids[-2:])), "wall"),
    )
    mesh = replace(
        mesh,
        vertex_ids=ids,
        vertices=np.concatenate([mesh.vertices, alone]),
        composites=composites,
        domains={0: tuple(range(len(mesh.elements)))},
    )
    coefficients = high.blocks[0].coefficients.copy()
    coefficients[0, :2], coefficients[-1, 3] = np.nan, np.inf
    blocks = (*low.blocks[1:], replace(high.blocks[0], coefficients=coefficients))
    return Dataset(mesh, (replace(low, blocks=blocks), one), 0.5, {"Note": "bent"})


def mapped():
    """Elements whose map fields give, in two expansions, the later ones first."""
    straight = Dataset(grid(Shape.HEXAHEDRON, 3))
    warp = ripple(0.1, seed=3)
    fields = []
    for axis, name in enumerate(("map_x", "map_y", "map_z")):
        (high,), (low,) = (
            approximated(straight, name, lambda p, axis=axis: warp(p)[:, axis], order).blocks for order in (3, 2)
        )
        rows = np.arange(len(low))
        blocks = (low.of(rows[rows % 3 > 0]), high.of(rows[rows % 3 == 0]))
        fields.append(replace(approximated(straight, name, lambda p: p[:, 0], 2), blocks=blocks))
    u = approximated(straight, "u", lambda p: p[:, 0] * p[:, 1], 3)
    return replace(straight, fields=(u, *fields), metadata={"GeometryMap": "map_x,map_y,map_z"})


def waves():
    """Triangles with a Fourier direction, some of them with fewer modes."""
    mesh = grid(Shape.TRIANGLE, 3)
    (entities,) = mesh.elements.values()
    planes = Homogeneous((Basis.FOURIER,), (2.5,), (0, 1, 2, 3))
    blocks = []
    for order, ids in ((4, entities.ids[::3]), (3, np.delete(entities.ids, np.s_[::3]))):
        expansion = replace(modified(Shape.TRIANGLE, (order, order)), homogeneous=planes)
        coefficients = np.random.default_rng(order).normal(size=(len(ids), mode_count(expansion)))
        blocks.append(Block(expansion, ids, coefficients))
    return Dataset(mesh, (Field("u", tuple(blocks)),))


def text(facts):
    return json.dumps(facts, indent=1)


def expressions(dataset, texts):
    return [Expression.of(dataset, each) for each in texts]


QUANTITIES = ("u*one", "d(u,x)/(2+u)", "d(d(u,x),y)", "log(u-0.9)", "jacobian_sign+order", "x")


@pytest.mark.thorough
@pytest.mark.parametrize("size", [3, 12])
@pytest.mark.parametrize(
    "case", ["mixed", Shape.SEGMENT, Shape.QUADRILATERAL, Shape.TETRAHEDRON, "mapped", "waves"], ids=str
)
@pytest.mark.sampled(least=6)
def test_facts_of_parts_match_those_of_the_whole(case, size, monkeypatch):
    """Also where only few elements are examined closely."""
    monkeypatch.setattr(ranges, "_NUMBERS_AT_ONCE", 1 << 12)
    monkeypatch.setattr(bounding, "_MOST", 3)
    made = {"mapped": mapped, "waves": waves, "mixed": bent}
    dataset = made[case]() if case in made else bent(case)
    texts = QUANTITIES if case == "mixed" else ("u*x", "sin(u)") if case in made else QUANTITIES[:1]

    def facts(ranks):
        portion = Portion.of_whole(dataset, ranks.rank, ranks.size)
        return summary(portion, expressions(portion.dataset, texts), ranks)

    found, *others = played(size, facts)
    assert text(found) == text(summary(dataset, expressions(dataset, texts)))
    assert not any(others)


def symmetric(shape):
    """A field with equal extrema in many elements, one that is everywhere the same, and one of noise that jumps."""
    mesh = grid(shape, 4)
    bare = Dataset(mesh)
    wave = approximated(bare, "wave", lambda p: np.cos(4 * np.pi * p[:, 0]) * np.cos(4 * np.pi * p[:, 1]), 6)
    one = approximated(bare, "one", lambda p: 0 * p[:, 0] + 0.1, 2)
    (block,) = one.blocks
    noise = np.random.default_rng(5).normal(size=block.coefficients.shape)
    return Dataset(mesh, (wave, one, Field("noise", (replace(block, coefficients=noise),))))


def twins():
    """Of two expansions of the map, the later one first, one element each has the largest value of a field.

    The very first element of the whole, which makes its expansion the first one, is no extreme itself.
    """
    dataset = mapped()
    (block,) = dataset["u"].blocks
    (one,) = approximated(Dataset(dataset.mesh), "one", lambda p: 0 * p[:, 0] + 1, 3).blocks
    values = np.where(np.arange(len(block)) % 2, -1.0, -2.0)
    values[[0, 1, 3, 12, 13]] = -1.5, -5, -1.8, 2, 2
    own = Field("u", (replace(block, coefficients=np.outer(values, one.coefficients[0])),))
    return replace(dataset, fields=(own, *dataset.fields[1:]))


def rounded():
    """Lines whose largest value is that of the first one, and its bound that of another, whose values are larger."""
    mesh = grid(Shape.SEGMENT, 8)
    (block,) = approximated(Dataset(mesh), "u", lambda p: p[:, 0], 2).blocks
    ends = np.zeros((8, block.coefficients.shape[1]))
    ends[:, :2] = [(0, 0.5), (0, 0.4), (0, 0.3), (0, 0.2), (0, 1), (-1e3, 1 - 1e-14), (-1001, 0), (0, 0.1)]
    return Dataset(mesh, (Field("u", (replace(block, coefficients=ends),)),))


@pytest.mark.sampled
@pytest.mark.filterwarnings("ignore:invalid value")  # of numbers that are not finite
@pytest.mark.parametrize("many", [3, 1 << 12])
@pytest.mark.parametrize(
    "case", ["mixed", "twins", "rounded", Shape.SEGMENT, Shape.QUADRILATERAL, Shape.TETRAHEDRON], ids=str
)
def test_extrema_of_parts_match_those_of_the_whole(case, many, monkeypatch):
    """To the last bit, in the same element of equal ones, batch by batch, where few boxes are bisected."""
    monkeypatch.setattr(extrema_module, "_MANY", many)
    made = {"twins": twins, "rounded": rounded, "mixed": bent}
    dataset = made[case]() if case in made else symmetric(case)
    names = [field.name for field in dataset.solution]

    def found(ranks):
        portion = Portion.of_whole(dataset, ranks.rank, ranks.size)
        return shared_extrema(portion, expressions(portion.dataset, names), ranks)

    with monkeypatch.context() as patch:
        patch.setattr(extrema_module, "_deciding", lambda nets: np.arange(len(nets.error)))
        whole = repr([extrema_module.extrema(dataset, name) for name in names])
    monkeypatch.setattr(extrema_module, "_AT_ONCE", 11)
    assert repr([extrema_module.extrema(dataset, name) for name in names]) == whole
    for size in (2, 5):
        first, *others = played(size, found)
        assert repr(first) == whole
        assert not any(others)


#: polynomials and such as grow with them, on straight elements and on curved ones; others; with values in few places
EXPRESSIONS = (
    "wave*noise-one",
    "sqrt(2+noise*wave)",
    "sqrt(noise*x)",
    "2",
    "d(wave,x)*y",
    "max(wave,noise)",
    "sin(wave)+element",
    "abs(one-0.1)",
    "1/(noise-0.1)",
    "log(wave-0.999)",
    "d(d(noise,x),y)",
    "jacobian*wave",
)


@pytest.mark.filterwarnings("ignore:invalid value")  # of numbers that are not finite
@pytest.mark.parametrize("many", [3, 1 << 5])
@pytest.mark.parametrize("text", EXPRESSIONS)
@pytest.mark.parametrize(
    "case", ["bent", "not finite", Shape.SEGMENT, Shape.QUADRILATERAL, Shape.TETRAHEDRON, Shape.PYRAMID], ids=str
)
@pytest.mark.sampled(least=6)
def test_extrema_of_expressions_of_parts_match_those_of_the_whole(case, text, many, monkeypatch):
    """As those of fields."""
    monkeypatch.setattr(quantity_extrema_module, "_MANY", many)
    dataset = symmetric(Shape.PRISM if isinstance(case, str) else case)
    if case == "bent":
        dataset = replace(dataset, mesh=curved(dataset.mesh, ripple(0.03), 3))
    if case == "not finite":
        coefficients = dataset["noise"].blocks[0].coefficients.copy()
        coefficients[1, 2], coefficients[-1, 3] = np.nan, np.inf
        noise = replace(dataset["noise"], blocks=(replace(dataset["noise"].blocks[0], coefficients=coefficients),))
        dataset = replace(dataset, fields=(*dataset.fields[:2], noise))

    def found(ranks):
        portion = Portion.of_whole(dataset, ranks.rank, ranks.size)
        return shared_extrema(portion, expressions(portion.dataset, [text, "wave"]), ranks)

    whole = repr([quantity_extrema(dataset, each) for each in expressions(dataset, [text, "wave"])])
    monkeypatch.setattr(quantity_extrema_module, "_ELEMENTS", 7)
    monkeypatch.setattr(extrema_module, "_AT_ONCE", 11)
    assert repr([quantity_extrema(dataset, each) for each in expressions(dataset, [text, "wave"])]) == whole
    for size in (2, 5):
        first, *others = played(size, found)
        assert repr(first) == whole
        assert not any(others)


def tangled(shape):
    """Elements that fold over, and such as are curved less."""
    return Dataset(curved(grid(shape, 2), ripple(0.6, seed=3), 3))


def flat(shape, count):
    """Elements whose determinant is 1e-10 all along a line, whose sign is open for want of boxes."""
    mesh = grid(shape, count)
    move = lambda p: np.column_stack([p[:, 0], (p[:, 1] - 0.5) ** 3 + 1e-9 * p[:, 1], p[:, 2]])  # noqa: E731
    return Dataset(curved(mesh, move, 4))


@pytest.mark.parametrize(
    "dataset",
    [
        tangled(Shape.TETRAHEDRON),
        tangled(Shape.PYRAMID),
        tangled(Shape.SEGMENT),
        Dataset(curved(replace(grid(Shape.TRIANGLE, 3), space=3), ripple(0.3, seed=1), 4)),
        Dataset(grid(Shape.TETRAHEDRON, 2)),
        flat(Shape.TRIANGLE, 3),
    ],
    ids=["tetrahedra", "pyramids", "segments", "surface", "straight", "flat"],
)
def test_signs_of_jacobians_depend_on_neither_batches_nor_parts(dataset, monkeypatch):
    """Also where only a few elements are examined closely."""
    for name, value in {"_RIVALS": 3, "_VALLEYS": 2}.items():
        monkeypatch.setattr(validity_module, name, value)
    whole = text(validity_facts(validity(dataset)))
    monkeypatch.setattr(validity_module, "_NUMBERS", 64)
    assert text(validity_facts(validity(dataset))) == whole
    first, *others = played(5, lambda ranks: shared_validity(Portion.of_whole(dataset, ranks.rank, 5).dataset, ranks))
    assert text(validity_facts(first)) == whole
    assert others == [None] * 4


@pytest.mark.parametrize("formats", [("hdf5", "hdf5"), ("compressed", "xml")], ids="-".join)
def test_facts_of_parts_of_files_match_those_of_the_whole(formats, tmp_path):
    """Counts are taken from files, of lists of ids with gaps; and so are bytes."""
    dataset = bent()
    entities = {
        shape: replace(own, ids=5000 * number + 3 * own.ids % 1000)
        for number, (shape, own) in enumerate(dataset.mesh.entities.items())
    }
    composites = [Composite(n, ((own.tag, entities[own].ids),)) for n, own in enumerate(dataset.mesh.elements)]
    walls = entities[Shape.TRIANGLE].ids, entities[Shape.QUADRILATERAL].ids
    composites.append(Composite(9, (("F", np.concatenate([walls[0][::2], walls[1][1:]])), ("Q", walls[1][:2])), "wall"))
    mesh = replace(dataset.mesh, entities=entities, composites=tuple(composites))
    fields = [
        replace(own, blocks=tuple(replace(b, element_ids=entities[b.expansion.shape].ids) for b in own.blocks))
        for own in dataset.fields
    ]
    mesh_format, field_format = formats
    files = write(
        replace(dataset, mesh=mesh, fields=tuple(fields)),
        tmp_path / "a.xml",
        mesh_format=mesh_format,
        field_format=field_format,
    )
    files = [path for path in files if path.suffix != ".nekg"]
    found, *_ = played(3, lambda ranks: summary(read_part(ranks.rank, ranks.size, *files), ranks=ranks))
    whole = read(*files)
    assert text(found) == text(summary(whole))
    arrays = [whole.mesh.vertex_ids, whole.mesh.vertices]
    arrays += [own for entities in whole.mesh.entities.values() for own in (entities.ids, entities.members)]
    for curves in (whole.mesh.edge_curves, whole.mesh.face_curves):
        arrays += [curves.rows, curves.kinds, curves.offsets, curves.points]
    arrays += [ids for composite in whole.mesh.composites for _, ids in composite.parts]
    arrays += [own for one in whole.fields for b in one.blocks for own in (b.element_ids, b.coefficients)]
    assert found["bytes"] == sum(array.nbytes for array in arrays)
