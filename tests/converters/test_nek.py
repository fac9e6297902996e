"""Nek5000 fields: Nek's own interpolation is reproduced; precision, byte order, split files and series don't matter."""

from pathlib import Path

import numpy as np
import pytest
from archives import arrays_of

from elvis import integrate, open_series
from elvis.converters.nek.nek import Nek
from elvis.core.base.errors import ElvisError, FormatError
from elvis.core.data.mesh import PERIODIC
from elvis.core.polynomials.quadrature import lobatto
from elvis.plugins.conversion.converting import convert
from elvis.plugins.testing import check, positions_at, values_at, values_found

DATA = Path(__file__).resolve().parents[3] / "shared" / "data" / "solvers" / "nek5000"
shared = pytest.mark.skipif(not DATA.exists(), reason="needs the shared data")


def lattice(cells, count):
    """(cells^d, d, count^d) curved elements of the unit cube or square, and their numbers from 1."""
    line = (lobatto(count)[0] + 1) / 2
    d = len(cells)
    local = np.stack(np.meshgrid(*(line,) * d, indexing="ij")[::-1]).reshape(d, -1)
    corners = np.stack(np.meshgrid(*map(np.arange, cells[::-1]), indexing="ij")[::-1]).reshape(d, -1).T
    x = (corners[:, :, None] + local) / np.array(cells)[:, None]
    return x + 0.05 * np.prod(np.sin(np.pi * x), axis=1, keepdims=True)


def write(
    path, x, values, size=8, order="<", numbers=None, total=None, piece=(0, 1), time=0.5, step=3, contents="XUPT"
):
    """A field file, as Nek writes it; ``values`` by letter, each (elements, components, points)."""
    count, d, points = x.shape
    n = round(points ** (1 / d))
    sizes = f"{n:2d} {n:2d} {n if d == 3 else 1:2d} {count:10d} {total or count:10d} {time:20.13E} {step:9d}"
    code = f"{contents}S{len(values.get('S', [])):02d}" if "S" in values else contents
    head = f"#std {size} {sizes} {piece[0]:6d} {piece[1]:6d} {code:10s} {0:14.7E} F"
    kind = np.dtype(f"{order}f{size}")
    with path.open("wb") as file:
        file.write(head.ljust(132).encode())
        file.write(np.array([6.54321], f"{order}f4").tobytes())
        file.write(np.asarray(np.arange(1, count + 1) if numbers is None else numbers, f"{order}i4").tobytes())
        for letter in contents:
            file.write(np.asarray(x if letter == "X" else values[letter], kind).tobytes())
        for scalar in values.get("S", []):
            file.write(scalar.astype(kind).tobytes())
        file.write(np.zeros(count * 2, f"{order}f4").tobytes())
    return path


def polynomial(x):
    """Fields of degree 1 in space, so of the map's degree on the elements."""
    first = 1 + x[:, :1] - 2 * x[:, 1:2]
    return {"U": x * 3 - 1, "P": first, "T": -first}


@shared
def test_agrees_with_the_solver():
    truth = arrays_of(DATA / "ethier_p7.truth.npz")
    done = check(Nek, [DATA / "ethier0.f00001", DATA / "ethier.re2"])
    names = {f"velocity_{axis}": truth["f_vel"][:, i] for i, axis in enumerate("xyz")}
    for name, wanted in {**names, "pressure": truth["f_p"][:, 0]}.items():
        bound = 1e-10 * np.ptp(wanted)
        assert np.abs(values_at(done, name, 0, truth["elem"], truth["ref"]) - wanted).max() < bound
        assert np.abs(values_found(done.dataset, name, truth["xyz"]) - wanted).max() < bound
    assert np.abs(positions_at(done, 0, truth["elem"], truth["ref"]) - truth["xyz"]).max() < 1e-12
    assert done.report.has_map
    assert all(field.is_exact and field.is_continuous for field in done.report.fields)
    assert done.dataset.time == pytest.approx(0.06)


@shared
def test_boundaries_of_re2_cover_the_surface():
    done = convert(Nek([DATA / "ethier0.f00001", DATA / "ethier.re2"]))
    sides = {each.name: sum(len(ids) for _, ids in each.parts) for each in done.dataset.mesh.composites}
    assert sides == {"hexahedron": 32, "EXO_1": 24}


@shared
def test_single_precision_of_upstream():
    done = check(Nek, [DATA / "nek_io_test_m12io_test0.f00001"])
    names = ["velocity_x", "velocity_y", "velocity_z", "pressure", "temperature", "s01", "s02"]
    assert [field.name for field in done.report.fields] == names
    assert all(field.is_exact for field in done.report.fields)


@pytest.mark.parametrize("order", "<>")
@pytest.mark.parametrize("size", [4, 8])
@pytest.mark.parametrize("cells", [(2, 2), (2, 1, 2)])
def test_polynomials_are_exact_for_every_number_format(tmp_path, cells, size, order):
    x = lattice(cells, 5)
    done = check(Nek, [write(tmp_path / "a0.f00001", x, polynomial(x), size, order)])
    assert all(field.is_exact and field.is_continuous for field in done.report.fields)
    assert len(done.report.fields) == len(cells) + 2
    places = done.dataset.mesh.vertices
    wanted = 1 + places[:, 0] - 2 * places[:, 1]
    assert np.abs(values_found(done.dataset, "pressure", places) - wanted).max() < (1e-12 if size == 8 else 1e-6)


def test_a_step_of_many_files_is_one(tmp_path):
    x = lattice((2, 2, 2), 4)
    fields = polynomial(x)
    whole = convert(Nek([write(tmp_path / "whole0.f00001", x, fields)]))
    shuffled, cut = np.random.default_rng(1).permutation(8), [slice(0, 3), slice(3, 8)]
    for i, part in enumerate(cut):
        rows = shuffled[part]
        own = {letter: values[rows] for letter, values in fields.items()}
        write(tmp_path / f"cut{i}.f00001", x[rows], own, numbers=rows + 1, total=8, piece=(i, 2))
    done = check(Nek, [tmp_path / "cut0.f00001"])
    places = np.random.default_rng(2).uniform(0.05, 0.95, (20, 3))
    for name in ("pressure", "velocity_z"):
        found = [values_found(each.dataset, name, places) for each in (whole, done)]
        assert np.allclose(*found, rtol=0, atol=1e-13)
    (tmp_path / "cut1.f00001").unlink()
    with pytest.raises(FormatError, match=r"expected all 2 files of the step, found no cut1\.f00001"):
        Nek([tmp_path / "cut0.f00001"])


def test_a_series_keeps_its_points_in_the_first_file(tmp_path):
    x = lattice((2, 1, 1), 4)
    fields = polynomial(x)
    write(tmp_path / "run0.f00001", x, {}, contents="X", time=0.0, step=0)
    later = {letter: values[::-1] for letter, values in fields.items()}
    last = write(tmp_path / "run0.f00002", x, later, numbers=[2, 1], contents="UPT", time=1.0, step=9)
    # points of a later step are those of a mesh that has moved
    write(tmp_path / "run0.f00003", 3 * x, {}, contents="X", time=2.0, step=12)
    assert np.abs(convert(Nek([last])).dataset.mesh.vertices).max() == pytest.approx(1, abs=1e-12)
    (tmp_path / "run0.f00003").unlink()
    (tmp_path / "run.nek5000").write_text("filetemplate: run%01d.f%05d\nfirsttimestep: 1\nnumtimesteps: 2\n")
    for files in ([last], [tmp_path / "run0.f00001", last], [tmp_path / "run.nek5000"]):
        done = check(Nek, files)
        assert done.dataset.time == 1.0
        places = done.dataset.mesh.vertices
        wanted = 1 + places[:, 0] - 2 * places[:, 1]
        assert np.abs(values_found(done.dataset, "pressure", places) - wanted).max() < 1e-12
    assert Nek.times([tmp_path / "run.nek5000"]) == [0.0, 1.0]
    assert not Nek([tmp_path / "run.nek5000"], step="0").fields
    (tmp_path / "run.nek5000").write_text("filetemplate: run%01d.f%05d\nfirsttimestep: 1\nnumtimesteps: 4\n")
    series = open_series(tmp_path / "run.nek5000", cache=False)
    assert series.times.tolist() == [0.0, 1.0]
    assert series.remarks == ["steps 2 to 3 of the file: 2 of 4 steps are missing or damaged, and skipped"]
    assert Nek([tmp_path / "run.nek5000"]).time == 1.0
    (tmp_path / "run.nek5000").write_text("filetemplate: run%01d.f%05d\nfirsttimestep: 1\nnumtimesteps: 2\n")
    with pytest.raises(FormatError, match="expected a step from 0 to 1, found 2"):
        Nek([tmp_path / "run.nek5000"], step="2")
    with pytest.raises(ElvisError, match="expected a number for the option step, found 'last'"):
        Nek([tmp_path / "run.nek5000"], step="last")
    (tmp_path / "run.nek5000").write_text("filetemplate: run%01d.f%05d\nfirsttimestep: 0\nnumtimesteps: 2000000000\n")
    with pytest.raises(FormatError, match="expected at most 10300 steps next to 3 files, found 2000000000"):
        Nek.times([tmp_path / "run.nek5000"])
    (tmp_path / "run0.f00001").unlink()
    with pytest.raises(FormatError, match="expected points, or a file of the same series that has them"):
        Nek([last])


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda b: b[:-600], "expected .* bytes, found"),
        (lambda b: b[:132] + b"\0\0\0\0" + b[136:], "in either byte order"),
        (lambda b: b.replace(b"#std 8", b"#std 7"), "4 or 8 bytes, found 7"),
        (lambda b: b.replace(b" 4  4  4 ", b"99 99 99 "), "2 to 64 points in each direction, found 99 x 99 x 99"),
        (lambda b: b.replace(b"         2          2", b"         0          0"), "at least one element"),
        (lambda b: b.replace(b"XUPT", b"XUZT"), "expected sizes, time and contents"),
        (lambda b: b[:136] + b[140:144] * 2 + b[144:], "expected the elements 1 to 2, found 2, of which 1 differ"),
        (lambda b: b[:60], "expected sizes, time and contents"),
    ],
)
def test_bad_files_give_a_one_line_error(tmp_path, spoil, message):
    x = lattice((2, 1, 1), 4)
    path = write(tmp_path / "bad0.f00001", x, polynomial(x))
    raw = path.read_bytes()
    assert spoil(raw) != raw
    path.write_bytes(spoil(raw))
    assert Nek.opens([path])
    with pytest.raises(FormatError, match=message):
        Nek([path])


def test_boundaries_of_another_mesh_are_rejected(tmp_path):
    x = lattice((2, 1, 1), 4)
    field, mesh = write(tmp_path / "a0.f00001", x, polynomial(x)), tmp_path / "a.re2"
    head, tag = b"#v003        3  3        3 this is the hdr".ljust(80), np.array([6.54321], "<f4").tobytes()
    mesh.write_bytes(head + tag + np.zeros(3 * 25 + 2).tobytes())
    with pytest.raises(FormatError, match="expected 2 elements as in the fields, found 3"):
        Nek([field, mesh])
    mesh.write_bytes(head + tag + np.zeros(20).tobytes())
    with pytest.raises(FormatError, match=r"expected .* bytes of numbers"):
        Nek([field, mesh])


def test_other_files_are_rejected(tmp_path):
    path = tmp_path / "other"
    for text in ("", "neither"):
        path.write_text(text)
        assert not Nek.opens([path])
        with pytest.raises(FormatError, match="expected a Nek5000 field"):
            Nek([path])


@pytest.mark.parametrize("kind", ["from 0", "zeros", "permuted", "sparse"])
def test_element_maps_of_any_kind(tmp_path, kind):
    """Points in the first file of a series, in another order than the values in the second."""
    x = lattice((2, 3), 4)
    rng = np.random.default_rng(1)
    orders = [np.arange(6), np.arange(6)] if kind == "zeros" else [rng.permutation(6), rng.permutation(6)]
    numbers = {
        "from 0": np.arange(6),
        "zeros": np.zeros(6),
        "permuted": 1 + np.arange(6),
        "sparse": 10 + 7 * np.arange(6),
    }
    maps = [numbers[kind][order] for order in orders]
    write(tmp_path / "a0.f00001", x[orders[0]], polynomial(x[orders[0]]), numbers=maps[0], time=0.0)
    values = {name: own[orders[1]] for name, own in polynomial(x).items()}
    write(tmp_path / "a0.f00002", x[orders[1]], values, numbers=maps[1], contents="UPT")
    done = check(Nek, [tmp_path / "a0.f00002"])
    places = np.zeros((6, 3))
    places[:, :2] = x[:, :, 5]
    wanted = polynomial(places[:, :2, None])["P"].reshape(-1)
    assert np.abs(values_found(done.dataset, "pressure", places) - wanted).max() < 1e-11


def test_periodic_sides_are_not_outer_boundaries(tmp_path):
    x = lattice((2, 1, 1), 4)
    field, mesh = write(tmp_path / "a0.f00001", x, polynomial(x)), tmp_path / "a.re2"
    head, tag = b"#v003        2  3        2 this is the hdr".ljust(80), np.array([6.54321], "<f4").tobytes()
    sides = [(1, 4, b"P"), (2, 2, b"P"), *((element, side, b"W") for element in (1, 2) for side in (1, 3, 5, 6))]
    rows = b"".join(
        np.array([element, side, *[0] * 5], "<f8").tobytes() + code.ljust(8) for element, side, code in sides
    )
    counts = [np.array([0.0], "<f8").tobytes(), np.array([len(sides)], "<f8").tobytes()]
    mesh.write_bytes(head + tag + np.zeros(2 * 25).tobytes() + b"".join(counts) + rows)
    dataset = convert(Nek([field, mesh])).dataset
    counts = {c.name: len(c.parts[0][1]) for c in dataset.mesh.composites[1:]}
    assert counts == {"W": 8, PERIODIC: 2}
    outer, walls = (integrate(dataset, "1", name).value for name in ("all", "W"))
    assert outer == pytest.approx(walls, rel=1e-12)
