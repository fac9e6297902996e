"""Volumes of the first ElVis: what files made in its layout mean arrives."""

import numpy as np
import pytest

from elvis.converters.elvisdat import ElVisDat
from elvis.core.base.errors import FormatError
from elvis.core.shapes import Shape
from elvis.plugins.testing import check, positions_at, values_at, values_found

TYPES = {Shape.HEXAHEDRON: 1, Shape.PRISM: 3}
TITLE = b"a volume of elements    "


def legendre(i, x):
    return np.polynomial.legendre.Legendre.basis(i)(x)


def jacobi(k, alpha, z):
    """P_k^(alpha,0) by its sum in powers of (z - 1)/2 (DLMF 18.5.7)."""
    from math import comb

    return sum(comb(k, s) * comb(k + alpha + s, k) * ((z - 1) / 2) ** s for s in range(k + 1))


def indices(kind, degrees):
    a, b, c = degrees
    return [
        (i, j, k) for i in range(a + 1) for j in range(b + 1) for k in range(c + 1 - (i if kind is Shape.PRISM else 0))
    ]


def value(kind, degrees, coefficients, cube):
    """What an element says at points (n, 3) of the cube, straight from the description of the format."""
    x, y, z = cube.T
    total = np.zeros(len(cube))
    for coefficient, (i, j, k) in zip(coefficients, indices(kind, degrees), strict=True):
        last = (1 - z) ** i * jacobi(k, 2 * i + 1, z) if kind is Shape.PRISM else legendre(k, z)
        total += coefficient * legendre(i, x) * legendre(j, y) * last
    return total


def folded(kind, cube):
    """Reference points of points of the cube."""
    points = cube.copy()
    if kind is Shape.PRISM:
        points[:, 0] = (1 + cube[:, 0]) * (1 - cube[:, 2]) / 2 - 1
    return points


def element(kind, degrees, coefficients, vertices, order=">"):
    eight = np.zeros((8, 3))
    eight[: len(vertices)] = vertices
    parts = [(f"{order}i4", [TYPES[kind], 1]), (f"{order}f8", [-1, 1]), (f"{order}f8", eight)]
    parts += [(f"{order}i4", degrees), (f"{order}f8", coefficients)]
    return b"".join(np.asarray(values).astype(code).tobytes() for code, values in parts)


def volume(elements, order=">", count=None):
    head = np.array([1, len(elements) if count is None else count]).astype(f"{order}i4").tobytes()
    return TITLE + head + b"".join(element(*each, order) for each in elements)


def row(kinds, seed=0):
    """Elements one next to the other, a little skewed, with random coefficients."""
    rng = np.random.default_rng(seed)
    result = []
    for number, (kind, degrees) in enumerate(kinds):
        vertices = kind.vertices + rng.uniform(-0.1, 0.1, kind.vertices.shape) + [3 * number, 0, 0]
        result.append((kind, degrees, rng.uniform(-1, 1, len(indices(kind, degrees))), vertices))
    return result


KINDS = [
    (Shape.HEXAHEDRON, (2, 2, 2)),
    (Shape.HEXAHEDRON, (2, 2, 2)),
    (Shape.PRISM, (2, 2, 2)),
    (Shape.HEXAHEDRON, (1, 3, 2)),
    (Shape.PRISM, (3, 1, 3)),
    (Shape.HEXAHEDRON, (0, 0, 0)),
    (Shape.HEXAHEDRON, (8, 8, 8)),
    (Shape.PRISM, (4, 4, 4)),
]


@pytest.mark.parametrize("order", [">", "<"])
def test_values_match_those_of_the_description(tmp_path, order):
    path, elements = tmp_path / "volume.dat", row(KINDS)
    path.write_bytes(volume(elements, order))
    conversion = check(ElVisDat, [path])
    assert all(measure.is_exact for measure in (conversion.report.geometry, *conversion.report.fields))
    source = ElVisDat([path])
    where = {int(i): (b, r) for b, block in enumerate(source.blocks) for r, i in enumerate(block.ids)}
    cube = np.random.default_rng(1).uniform(-0.95, 0.95, (30, 3))
    for number, (kind, degrees, coefficients, _) in enumerate(elements):
        block, own = where[number]
        at = (block, np.full(len(cube), own), folded(kind, cube))
        wanted = value(kind, degrees, coefficients, cube)
        tolerance = 1e-10 * max(np.ptp(wanted), 1)
        assert np.abs(values_at(conversion, "u", *at) - wanted).max() < tolerance
        assert np.abs(values_found(conversion.dataset, "u", positions_at(conversion, *at)) - wanted).max() < tolerance


def test_vertices_are_where_the_file_says(tmp_path):
    path, elements = tmp_path / "volume.dat", row(KINDS)
    path.write_bytes(volume(elements))
    conversion, source = check(ElVisDat, [path]), ElVisDat([path])
    for number, block in enumerate(source.blocks):
        for own, i in enumerate(block.ids):
            kind, _, _, vertices = elements[i]
            places = positions_at(conversion, number, np.full(len(vertices), own), np.array(kind.vertices))
            assert np.abs(places - vertices).max() < 1e-13


def test_shared_faces_are_continuous(tmp_path):
    """Two cubes with x^2 + y z: the coefficients of the second follow from shifting the first."""
    cells, places = [], Shape.HEXAHEDRON.vertices
    for shift in (0.0, 2.0):
        c = np.zeros((3, 3, 3))
        c[0, 0, 0], c[1, 0, 0], c[2, 0, 0], c[0, 1, 1] = shift**2 + 1 / 3, 2 * shift, 2 / 3, 1
        cells.append((Shape.HEXAHEDRON, (2, 2, 2), c.reshape(-1), places + np.array([shift, 0, 0])))
    path = tmp_path / "volume.dat"
    path.write_bytes(volume(cells))
    conversion = check(ElVisDat, [path])
    assert conversion.report.fields[0].is_continuous
    x = np.random.default_rng(2).uniform([-1, -1, -1], [3, 1, 1], (20, 3))
    assert np.abs(values_found(conversion.dataset, "u", x) - x[:, 0] ** 2 - x[:, 1] * x[:, 2]).max() < 1e-12


def test_many_elements_in_runs(tmp_path):
    elements = row([KINDS[0]] * 300 + [KINDS[2]] * 5 + [KINDS[0]] * 70)
    path = tmp_path / "volume.dat"
    path.write_bytes(volume(elements))
    source = ElVisDat([path])
    assert [len(block) for block in source.blocks] == [370, 5]
    assert source.blocks[1].ids.tolist() == [*range(300, 305)]
    assert np.array_equal(source.blocks[0].key.fields["u"].values[-1, :, 0], elements[-1][2])


@pytest.mark.parametrize(
    ("place", "byte", "opens"),
    [
        *[(0, byte, byte in (9, 10, 13) or 32 <= byte < 127) for byte in (8, 9, 10, 11, 13, 31, 32, 126, 127)],
        *[(len(TITLE) + 3, 2, False), (len(TITLE) + 8, 255, False), (len(TITLE) - 1, 127, False)],
        *[(len(TITLE) + 11, number, number <= 3) for number in (0, 1, 3, 4)],
    ],
)
def test_files_open_by_their_text_byte_order_and_first_type(tmp_path, place, byte, opens):
    path = tmp_path / "volume.dat"
    data = bytearray(volume(row(KINDS[:1])))
    data[place] = byte
    path.write_bytes(data)
    assert ElVisDat.opens([path]) is opens
    assert not ElVisDat.opens([path, path])
    for length in (35, 36):
        path.write_bytes(data[:length])
        assert ElVisDat.opens([path]) is (opens and length == 36)


BAD = [
    (lambda raw: raw[:-1], "expected 3 elements, found 2 complete elements"),
    (lambda raw: raw[:300], "expected 3 elements, found 0 complete elements"),
    (lambda raw: raw[:100], "expected an element, found the end"),
    (lambda raw: raw + b"0", "expected the end after 3 elements, found 1 bytes more"),
    (lambda raw: raw[:24] + b"\0\0\0\2" + raw[28:], "expected a 1 that marks the byte order"),
    (lambda raw: raw[:28] + b"\0\0\0\0" + raw[32:], "expected elements, found 0"),
    (lambda raw: raw[:32] + b"\0\0\0\2" + raw[36:], "element 0: expected type 1 or 3, found 2"),
    (lambda raw: raw[:248] + b"\0\1\0\0" + raw[252:], "expected degrees from 0 to 30, found"),
    (lambda raw: raw[:20], "expected a 1 that marks the byte order"),
]


@pytest.mark.parametrize(("change", "message"), BAD)
def test_bad_files_give_a_one_line_error(tmp_path, change, message):
    path = tmp_path / "volume.dat"
    path.write_bytes(change(volume(row(KINDS[:3]))))
    with pytest.raises(FormatError, match=message) as caught:
        ElVisDat([path])
    assert str(path) in str(caught.value)


def test_uneven_degrees_of_prisms_are_rejected(tmp_path):
    path = tmp_path / "volume.dat"
    path.write_bytes(volume([(Shape.PRISM, (1, 1, 3), np.zeros(10), Shape.PRISM.vertices)]))
    with pytest.raises(FormatError, match="expected the same first and third degree"):
        ElVisDat([path])
