"""Real data of Nektar++ against what the real library says of them.

Each case is a folder with a mesh, mostly a field, and mostly a table of local vertices, coordinates and field values,
printed by the library with 17 digits.  Norms are listed in PROVENANCE.md next to the folders.
"""

import re
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from elvis import read
from elvis.core.mapping.orientation import local_vertices
from elvis.core.mapping.patch import patches
from elvis.core.numbers.norms import norms
from elvis.core.polynomials.evaluation import evaluate_at, evaluate_with_gradients
from elvis.core.shapes import Shape

DATA = Path(__file__).parents[2] / ".." / "shared" / "data" / "nektar"
PROVENANCE = DATA / "PROVENANCE.md"
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="the shared data are not next to the checkout")

TRUTHS = sorted(path.parent.name for path in DATA.glob("*/*.truth.txt"))
SECTIONS = {}
if PROVENANCE.is_file():
    for text in re.split(r"^### ", PROVENANCE.read_text(encoding="utf-8").split("## Expected norms")[1], flags=re.M)[
        1:
    ]:
        SECTIONS[text.split()[0]] = text
RELATIVE = 1e-11


@cache
def dataset(case):
    """The mesh and its first field; further fields of a folder are named as such in PROVENANCE.md."""
    further = re.findall(r"further files: (.*)", SECTIONS[case])
    names = {Path(name).name for line in further for name in re.findall(r"`([^`]*)`", line)}
    known = [path for path in (DATA / case).iterdir() if path.suffix in (".xml", ".fld", ".rst", ".chk")]
    folders = [path for path in (DATA / case).iterdir() if path.is_dir() and path.suffix != ".fld"]
    return read(*sorted(path for path in {*known, *folders} if path.name not in names))


class Truth(NamedTuple):
    """Rows of a table: element (n,), xi (n, d), coordinates (n, 3), fields (n, k); vertices and shape by element."""

    fields: list
    shapes: dict
    vertices: dict
    elements: np.ndarray
    points: np.ndarray
    places: np.ndarray
    values: np.ndarray


@cache
def truth(case):
    lines = next((DATA / case).glob("*.truth.txt")).read_text(encoding="utf-8").splitlines()
    fields, shapes, vertices, rows = [], {}, {}, []
    for line in lines:
        if line.startswith("FIELDS"):
            fields = line.split()[1:]
        elif line.startswith("E "):
            head, ids = line.split("|")
            element = int(head.split()[1])
            shapes[element], vertices[element] = Shape.from_label(head.split()[2]), [int(i) for i in ids.split()]
        elif line and not line.startswith("#"):
            rows.append((element, *([float(x) for x in part.split()] for part in line.split("|"))))
    columns = list(zip(*rows, strict=True))
    places = np.zeros((len(rows), 3))
    for row, place in zip(places, columns[2], strict=True):
        row[: len(place)] = place
    points = np.full((len(rows), 3), np.nan)
    for row, point in zip(points, columns[1], strict=True):
        row[: len(point)] = point
    return Truth(fields, shapes, vertices, np.array(columns[0]), points, places, np.array(columns[3]))


@cache
def evaluated(case):
    """Coordinates (n, 3) and fields (n, k) at the points of the table, by this project."""
    known, data = truth(case), dataset(case)
    places, values = np.full_like(known.places, np.nan), np.full_like(known.values, np.nan)
    for patch in patches(data, known.fields):
        order = np.argsort(patch.element_ids)
        where = np.minimum(np.searchsorted(patch.element_ids, known.elements, sorter=order), len(patch) - 1)
        rows = order[where]
        here = (patch.element_ids[rows] == known.elements) & [known.shapes[e] is patch.shape for e in known.elements]
        xi = known.points[here, : patch.shape.dimension]
        places[here] = evaluate_at(patch.geometry, patch.geometry_coefficients, rows[here], xi)
        for i, (expansion, coefficients) in enumerate(zip(patch.fields, patch.coefficients, strict=True)):
            values[here, i] = evaluate_at(expansion, coefficients, rows[here], xi)
    return places, values


def test_cases_are_found():
    assert len(TRUTHS) >= 29
    assert len(SECTIONS) >= 33
    assert {shape for case in TRUTHS for shape in truth(case).shapes.values()} == set(Shape)


@pytest.mark.parametrize("case", TRUTHS)
def test_local_vertices(case):
    known, mesh = truth(case), dataset(case).mesh
    for shape, entities in mesh.elements.items():
        vertices = mesh.vertex_ids[local_vertices(mesh, shape)]
        for id, row in zip(entities.ids.tolist(), vertices.tolist(), strict=True):
            if known.shapes.get(id) is shape:
                assert row == known.vertices[id]


@pytest.mark.parametrize("case", TRUTHS)
def test_coordinates(case):
    known, space = truth(case), dataset(case).mesh.space
    size = np.ptp(known.places, axis=0).max()
    assert np.abs(evaluated(case)[0] - known.places)[:, :space].max() <= RELATIVE * size


@pytest.mark.parametrize("case", [case for case in TRUTHS if case in SECTIONS and truth(case).fields])
def test_fields(case):
    known, (_, values) = truth(case), evaluated(case)
    for i, name in enumerate(known.fields):
        expected = known.values[:, i]
        rounding = 8 * np.finfo(float).eps * np.abs(expected).max()  # of fields constant to rounding
        assert np.abs(values[:, i] - expected).max() <= RELATIVE * np.ptp(expected) + rounding, name


# --- norms ---


def listed(case, label):
    """Name -> (L2, second number) of the line of PROVENANCE.md that starts with ``label``, where there is one."""
    found = re.search(rf"^\* {label}: (.*)$", SECTIONS[case], flags=re.M)
    parts = (part.replace(" / ", " ").split() for part in found.group(1).split(";")) if found else ()
    return {name: (float(l2), float(other)) for name, l2, other in parts}


LIBRARY = [case for case in SECTIONS if listed(case, "library norms")]
CONVERTED = [case for case in SECTIONS if listed(case, "FieldConvert")]


@cache
def computed(case):
    return norms(dataset(case))


def test_norms_are_listed():
    assert len(LIBRARY) >= 27
    assert {"chan3dh1d", "naca_h1d_line", "triquad_h1d"} <= set(CONVERTED) - set(LIBRARY)


@pytest.mark.parametrize("case", LIBRARY)
def test_norms_of_the_library(case):
    expected = listed(case, "library norms")
    assert set(computed(case)) == set(expected)
    for name, (l2, linf) in expected.items():
        assert computed(case)[name].l2 == pytest.approx(l2, rel=1e-9, abs=1e-12), name
        assert computed(case)[name].linf == pytest.approx(linf, rel=1e-9, abs=1e-12), name


@pytest.mark.parametrize("case", CONVERTED)
def test_norms_of_field_convert(case):
    expected = listed(case, "FieldConvert")
    assert list(computed(case)) == list(expected)
    for name, (l2, maximum) in expected.items():
        assert computed(case)[name].l2 == pytest.approx(l2, rel=5.1e-6, abs=1e-12), name
        assert computed(case)[name].maximum == pytest.approx(maximum, rel=5.1e-6, abs=1e-12), name


def test_norms_of_a_mesh_without_fields():
    text = re.search(r"x L2 (\S+) max (\S+); y L2 (\S+) max (\S+) ", SECTIONS["scale_compressed"])
    found = computed("scale_compressed")
    numbers = [found["x"].l2, found["x"].maximum, found["y"].l2, found["y"].maximum]
    assert numbers == pytest.approx([float(number) for number in text.groups()], rel=5.1e-6)


def test_norms_over_partitions():
    text = SECTIONS["chan_parallel"]
    lists = {name: re.search(rf"{name} ((?:[\d.]+, )+[\d.]+)", text.split("partition 0..3")[1]) for name in "xyu"}
    found = computed("chan_parallel")
    for name, parts in lists.items():
        total = np.sqrt(sum(float(part) ** 2 for part in parts.group(1).split(", ")))
        assert found[name].l2 == pytest.approx(total, rel=5.1e-6)
    greatest = float(re.search(r"max u ([\d.]+)", text).group(1))
    assert found["u"].maximum == pytest.approx(greatest, rel=5.1e-6)


def test_a_field_that_varies_between_planes():
    """The root mean square of u over 10 x 9 points (s, s, z) is a published number."""
    data = read(DATA / "chan3dh1d" / "chan3DH1D.xml", DATA / "chan3dh1d" / "chan3DH1D_zVariation.fld")
    s, z = (part.reshape(-1) for part in np.meshgrid(np.linspace(0, 1, 10), np.linspace(0, 1, 9)))
    values = np.full(len(s), np.nan)
    for patch in patches(data, ["u"]):
        # straight elements are parallelograms here: invert their affine maps
        centre, derivatives = evaluate_with_gradients(patch.geometry, patch.geometry_coefficients, np.zeros((1, 2)))
        for element in range(len(patch)):
            offset = np.stack([s, s]) - centre[element, :2]
            xi = np.linalg.solve(derivatives[element, :2, 0], offset)
            inside = (np.abs(xi) <= 1 + 1e-9).all(axis=0)
            points = np.column_stack([xi.T, 2 * z - 1])[inside]
            rows = np.full(len(points), element)
            values[inside] = evaluate_at(patch.fields[0], patch.coefficients[0], rows, points)
    assert np.sqrt(np.mean(values**2)) == pytest.approx(1.73509, rel=5e-6)
