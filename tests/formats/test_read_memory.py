"""Reading takes at most three times the memory of what it returns, measured on about 80,000 tetrahedra."""

import itertools
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from elvis import Basis, Block, Dataset, Entities, Expansion, Field, Mesh, Shape, write
from elvis.formats.reading import read

BOUND = 3.0
TETRAHEDRON = (Basis.MODIFIED_A, Basis.MODIFIED_B, Basis.MODIFIED_C)


def tetrahedra(cells):
    """The unit cube in ``cells``^3 cubes of six tetrahedra each; ids are scattered, as after partitioning."""
    nodes = np.arange((cells + 1) ** 3).reshape((cells + 1,) * 3)
    corners = []
    for order in itertools.permutations(range(3)):
        offsets = np.cumsum(np.eye(3, dtype=int)[[*order]], axis=0)
        steps = [(0, 0, 0), *map(tuple, offsets)]
        corners.append(
            np.stack([nodes[i : cells + i, j : cells + j, k : cells + k].ravel() for i, j, k in steps], axis=1)
        )
    cells_of = np.concatenate(corners)

    # faces and edges are their ascending vertices, each once
    faces, cell_faces = distinct(np.concatenate([cells_of[:, f] for f in ([0, 1, 2], [0, 1, 3], [1, 2, 3], [0, 2, 3])]))
    edges, face_edges = distinct(np.concatenate([faces[:, e] for e in ([0, 1], [1, 2], [0, 2])]))
    points = np.stack(np.unravel_index(np.arange(nodes.size), nodes.shape), axis=1) / cells
    random = np.random.default_rng(0)
    scattered = lambda count: random.permutation(count) * 2 + 1  # noqa: E731
    tables = {
        Shape.SEGMENT: edges,
        Shape.TRIANGLE: face_edges.reshape(3, -1).T,
        Shape.TETRAHEDRON: cell_faces.reshape(4, -1).T,
    }
    entities = {s: Entities(scattered(len(m)), np.ascontiguousarray(m)) for s, m in tables.items()}
    return Mesh(3, 3, scattered(nodes.size), points + random.random(points.shape) / 99, entities)


def distinct(rows):
    keys = np.ravel_multi_index(rows.T, (1 << 20,) * rows.shape[1])
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return rows[first], inverse


@pytest.fixture(scope="module")
def dataset():
    mesh = tetrahedra(24)
    ids = mesh.of(Shape.TETRAHEDRON).ids
    values = np.random.default_rng(1).standard_normal((len(ids), 20))
    block = Block(Expansion(Shape.TETRAHEDRON, TETRAHEDRON, (4, 4, 4)), ids, values)
    return Dataset(mesh, (Field("u", (block,)), Field("v", (replace(block, coefficients=values[::-1]),))))


@pytest.fixture(scope="module")
def mixed(dataset):
    """The same with four orders in turn."""
    ids, parts = dataset.mesh.of(Shape.TETRAHEDRON).ids, []
    for order in (2, 3, 4, 5):
        mine, count = ids[order % 4 :: 4], order * (order + 1) * (order + 2) // 6
        values = np.random.default_rng(order).standard_normal((len(mine), count))
        parts.append(Block(Expansion(Shape.TETRAHEDRON, TETRAHEDRON, (order,) * 3), mine, values))
    return replace(dataset, fields=(Field("u", tuple(parts)), Field("v", tuple(parts))))


def size(dataset):
    """Bytes of all distinct arrays of a dataset, if every number had eight."""
    mesh = dataset.mesh
    arrays = [mesh.vertex_ids, mesh.vertices]
    arrays += [array for e in mesh.entities.values() for array in (e.ids, e.members)]
    arrays += [ids for composite in mesh.composites for _, ids in composite.parts]
    blocks = [block for field in dataset.fields for block in field.blocks]
    distinct_ids = {id(block.element_ids): block.element_ids for block in blocks}
    return 8 * sum(a.size for a in [*arrays, *distinct_ids.values(), *(block.coefficients for block in blocks)])


def peak_of_reading(*paths):
    tracemalloc.start()
    result = read(*paths)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    return result, peak


@pytest.mark.parametrize("mesh_format", ["compressed", "text", "hdf5"])
def test_meshes(mesh_format, dataset, tmp_path):
    write(replace(dataset, fields=()), tmp_path / "m.xml", mesh_format=mesh_format)
    result, peak = peak_of_reading(tmp_path / "m.xml")
    assert np.array_equal(result.mesh.of(Shape.TETRAHEDRON).members, dataset.mesh.of(Shape.TETRAHEDRON).members)
    assert peak <= BOUND * size(result)


@pytest.mark.parametrize("kind", ["uniform", "mixed"])
@pytest.mark.parametrize("field_format", ["xml", "hdf5"])
def test_fields(kind, field_format, dataset, mixed, tmp_path):
    source = dataset if kind == "uniform" else mixed
    write(source, tmp_path / "m.xml", mesh_format="hdf5", field_format=field_format)
    result, peak = peak_of_reading(tmp_path / "m.xml", tmp_path / "m.fld")
    assert np.array_equal(result.field("v").blocks[-1].coefficients, source.field("v").blocks[-1].coefficients)
    assert peak <= BOUND * size(result)


def test_many_pieces(dataset, tmp_path):
    """As from a parallel run: the parts of each field are put together once."""
    (block,) = dataset.field("u").blocks
    write(replace(dataset, fields=()), tmp_path / "m.xml", mesh_format="hdf5")
    for number, part in enumerate(np.array_split(np.arange(len(block)), 8)):
        piece = replace(block, element_ids=block.element_ids[part], coefficients=block.coefficients[part])
        write(replace(dataset, fields=(Field("u", (piece,)),)), field_path=tmp_path / f"P{number:07}.fld")
    result, peak = peak_of_reading(tmp_path, tmp_path / "m.xml")
    assert np.array_equal(result.field("u").blocks[0].coefficients, block.coefficients)
    assert peak <= BOUND * size(result)
