"""What a part reads of files is what is cut out of the whole, to the bit, with little more than its share of memory."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, FormatError, read, write
from elvis.core.data.dataset import Block, Field, Homogeneous
from elvis.core.data.mesh import Composite, Mesh
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.expansion import mode_count
from elvis.core.polynomials.interpolation import modified
from elvis.core.portions import Portion
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_volume, ripple, with_field
from elvis.formats.nektar import assembly, hdf5, payload, xml
from elvis.formats.nektar.geometry import parts as geometry_parts
from elvis.formats.nektar.mapped_files import mapped
from elvis.formats.nektar.packed import Packed
from elvis.formats.reading import read_part


def function(points):
    return np.sin(points[:, 0]) + points[:, 1] * points[:, 2]


def in_files(dataset, folder, mesh_format, field_format):
    files = write(dataset, folder / "a.xml", mesh_format=mesh_format, field_format=field_format)
    return [path for path in files if path.suffix != ".nekg"]


def mixed():
    """All shapes, curved, with unordered ids with gaps; fields of two orders, one of them not on all elements."""
    mesh = curved(mixed_volume(), ripple(0.05), 3)
    thrown = np.random.default_rng(0)
    some = lambda count, start: start + thrown.permutation(9 * count)[:count]  # noqa: E731
    entities = {
        shape: replace(own, ids=some(len(own), 5000 * n)) for n, (shape, own) in enumerate(mesh.entities.items())
    }
    parts = [(shape.tag, entities[shape].ids) for shape in mesh.elements]
    walls = Composite(9, (("F", entities[Shape.TRIANGLE].ids[::2]),), "wall")
    mesh = Mesh(
        *(3, 3, some(len(mesh.vertices), 0), mesh.vertices, entities, mesh.edge_curves, mesh.face_curves),
        composites=(*(Composite(number, (part,)) for number, part in enumerate(parts)), walls),
        domains={0: tuple(range(len(parts)))},
    )
    high, low = (approximated(Dataset(mesh), "u", function, order) for order in (4, 3))
    blocks = [*low.blocks[:2], *high.blocks[2:]]
    return Dataset(mesh, (replace(low, blocks=tuple(blocks[1:])), replace(low, name="v", blocks=tuple(blocks))))


def waves(*numbers):
    """Triangles with some of the waves of a Fourier direction."""
    mesh = grid(Shape.TRIANGLE, 3)
    (entities,) = mesh.elements.values()
    expansion = replace(modified(Shape.TRIANGLE, (4, 4)), homogeneous=Homogeneous((Basis.FOURIER,), (2.5,), numbers))
    coefficients = np.random.default_rng(0).normal(size=(len(entities), mode_count(expansion)))
    return Dataset(mesh, (Field("u", (Block(expansion, entities.ids, coefficients),)),))


CASES = {
    "all shapes": mixed,
    "bent triangles": lambda: with_field(curved(grid(Shape.TRIANGLE, 3), ripple(0.05), 3), function, 4),
    "waves": lambda: waves(0, 1, 2, 3),
    "lines": lambda: with_field(grid(Shape.SEGMENT, 3), function, 4),
    "a mesh alone": lambda: Dataset(grid(Shape.TETRAHEDRON, 2)),
}


@pytest.mark.parametrize("formats", [("hdf5", "hdf5"), ("compressed", "xml"), ("text", "xml")], ids="-".join)
@pytest.mark.parametrize("name", CASES)
def test_a_part_of_files_is_that_of_the_whole(name, formats, tmp_path, monkeypatch):
    monkeypatch.setattr(hdf5, "_LONG", 0)
    monkeypatch.setattr(payload, "_STEP", 1000)
    files = in_files(CASES[name](), tmp_path, *formats)
    whole = read(*files)
    for number, count in [(0, 1), (0, 3), (1, 3), (2, 3), (5, 50)]:
        with mapped():
            found = read_part(number, count, *files)
        assert contents(found) == contents(Portion.of_whole(whole, number, count))
        assert {own.dtype for own in (found.sides, *found.rows.values())} == {np.dtype(np.int32)}


def test_waves_of_several_files_match_those_of_the_whole(tmp_path):
    """As of runs that were split along a Fourier direction."""
    files = in_files(waves(0, 1), tmp_path, "hdf5", "hdf5")
    files += [path for path in write(waves(2, 3), tmp_path / "b.xml", field_format="hdf5") if path.suffix == ".fld"]
    whole = read(*files)
    (block,) = whole["u"].blocks
    assert block.expansion.homogeneous.z_ids == (0, 1, 2, 3)
    for number in (0, 3):
        assert contents(read_part(number, 5, *files)) == contents(Portion.of_whole(whole, number, 5))


def contents(value):
    """All that an object holds, as plain values; arrays with their types."""
    if isinstance(value, np.ndarray):
        return str(value.dtype), value.shape, value.tobytes()
    if isinstance(value, dict):
        return {key: contents(own) for key, own in value.items()}
    if isinstance(value, tuple):
        return [contents(own) for own in value]
    fields = getattr(value, "__dataclass_fields__", None)
    return {name: contents(getattr(value, name)) for name in fields} if fields else value


@pytest.mark.parametrize("form", ["compressed", "text"])
@pytest.mark.parametrize("more", [2**31 - 70, 2**31 + 5])
def test_ids_in_xml_may_be_large(more, form, tmp_path):
    mesh = grid(Shape.TETRAHEDRON, 2)
    great = {shape: replace(own, ids=own.ids + more) for shape, own in mesh.entities.items()}
    whole = with_field(replace(mesh, entities=great, composites=(), domains={}), function, 3)
    files = in_files(whole, tmp_path, form, "xml")
    with mapped():
        found = read_part(1, 3, *files)
    assert contents(found) == contents(Portion.of_whole(read(*files), 1, 3))


def test_packed_coefficients_of_some_elements(monkeypatch):
    """Of elements with as many modes as the next, or others, and of some of several fields."""
    monkeypatch.setattr(payload, "_STEP", 100)
    thrown = np.random.default_rng(0)
    for counts in (np.broadcast_to(7, 50), thrown.integers(1, 12, 50)):
        values = thrown.normal(size=(3, counts.sum()))
        text = b"<ELEMENTS>" + b"".join(payload.encode([values])) + b"</ELEMENTS>"
        (element,) = xml.parse(text, "a.fld")
        packed = Packed(element, counts, 3, (0, 1, 2))
        for rows in ((0, 1, 2), (0, 2), (1,)):
            for share in (0.0, 0.3, 1.0):
                wanted = thrown.random(50) < share
                found = packed.of_fields(rows).of(wanted)
                assert np.array_equal(found, values[np.ix_(rows, np.repeat(wanted, counts))])
    with pytest.raises(FormatError, match=r"a\.fld: .*<ELEMENTS>.*: expected \d+ numbers, found \d+"):
        Packed(element, counts + 1, 3, (2,)).of(np.zeros(50, bool))


#: by formats: the part and how many there are, and the most that is taken of the whole, each number in eight bytes
SHARES = {
    ("hdf5", "hdf5"): [(3, 8, 0.24), (3, 50, 0.09)],
    ("compressed", "xml"): [(3, 8, 0.42), (3, 50, 0.37)],
}


@pytest.mark.parametrize("formats", SHARES, ids="-".join)
def test_a_part_uses_little_more_than_its_share_of_memory(formats, tmp_path, monkeypatch):
    monkeypatch.setattr(hdf5, "_LONG", 0)
    monkeypatch.setattr(payload, "_STEP", 1 << 12)
    for module in (assembly, geometry_parts):
        monkeypatch.setattr(module, "AT_ONCE", 1 << 12)
    dataset = with_field(grid(Shape.TETRAHEDRON, 16), function, 4)
    files = in_files(dataset, tmp_path, *formats)
    whole = Portion.whole(dataset).bytes
    of_numbers = whole + 4 * sum(own.members.size for own in dataset.mesh.entities.values())
    with mapped():
        read_part(0, 50, *files)
        for number, count, most in SHARES[formats]:
            tracemalloc.start()
            own = read_part(number, count, *files)
            _, peak = tracemalloc.get_traced_memory()
            tracemalloc.stop()
            assert own.bytes < 1.3 * whole / count
            assert peak < most * of_numbers
