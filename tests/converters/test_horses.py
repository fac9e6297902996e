"""Files of HORSES3D, which are written here after its documentation, against closed forms."""

import struct

import numpy as np
import pytest
from horses_writer import FLOW, NONE, boxes, nodes_of, write_horses, write_zones

from elvis import FormatError
from elvis.converters.horses.horses import Horses
from elvis.core.integrals import integrate
from elvis.plugins.conversion.converting import convert
from elvis.plugins.testing import check

NEAR = 1e-12
#: orders of four elements
ORDERS = [(3, 3, 3), (2, 4, 3), (3, 3, 3), (4, 4, 2)]

#: the length of x = 0.1 y^2 up to y = 2: (a/2) sqrt(1 + a^2) + asinh(a)/2 over the factor of y in the slope a
ARC = (0.2 * np.sqrt(1 + 0.4**2) + np.arcsinh(0.4) / 2) / 0.2


def bent(x):
    """A map of degree 2 with the determinant 1."""
    return np.stack([x[..., 0] + 0.1 * x[..., 1] ** 2, x[..., 1], x[..., 2] + 0.2 * x[..., 0]], axis=-1)


def variables(x):
    """(n, 5) polynomials of places."""
    return np.stack([1 + x[:, 0], x[:, 1], x[:, 2], x[:, 0] - x[:, 2], 2 + x[:, 1]], axis=1)


def files(folder, nodes, orders=ORDERS, kind=2, extra=(), sensors=None, references=FLOW, functions=variables):
    """Two by two elements in a plane, one thick."""
    maps = boxes((2, 2, 1), bent)
    counts = [tuple(order + 1 for order in own) for own in orders]
    places = [own(nodes_of(nodes, count)) for own, count in zip(maps, counts, strict=True)]
    mesh = write_horses(
        folder / "box.hmesh", 1, nodes, [(c, [x]) for c, x in zip(counts, places, strict=True)], None, NONE
    )
    write_zones(folder / "box.bmesh", [("inlet", [1, 3], [6, 6]), ("lid", [3, 4], [2, 2]), ("floor", [1], [3])])
    arrays = [[functions(x), *(own(x) for own in extra)] for x in places]
    if sensors is not None:
        arrays = [(own[:1], own[1:]) for own in arrays]
    values = list(zip(counts, arrays, strict=True))
    return [mesh, write_horses(folder / "box.hsol", kind, nodes, values, sensors, references)]


def mean(dataset, name, over="domain"):
    return integrate(dataset, name, over=over, error=1e-12)[-1].value


@pytest.mark.parametrize("nodes", [1, 2])
def test_orders_of_each_element_and_direction(tmp_path, nodes):
    paths = files(tmp_path, nodes)
    assert Horses.times(paths) == [0.75]
    conversion = check(Horses, paths)
    dataset = conversion.dataset
    assert dataset.time == 0.75
    assert all(own.is_exact for own in (conversion.report.geometry, *conversion.report.fields))
    assert dataset.metadata["Reference gamma"] == "1.4"
    # means over the box of 2 x 2 x 1: x = X + 0.1 Y^2, y = Y, z = Z + 0.2 X
    wanted = {"rho": 2 + 0.4 / 3, "rhou": 1, "rhov": 0.7, "rhow": 1 + 0.4 / 3 - 0.7, "rhoe": 3}
    assert mean(dataset, "1") == pytest.approx(4, rel=NEAR)
    for name, value in wanted.items():
        assert mean(dataset, name) == pytest.approx(4 * value, rel=NEAR)
    # the side at X = 0 is the surface (0.1 Y^2, Y, Z), the lid (X + 0.4, 2, Z + 0.2 X)
    assert mean(dataset, "1", "lid") == pytest.approx(2, rel=NEAR)
    assert mean(dataset, "1", "inlet") == pytest.approx(ARC, rel=1e-11)
    assert mean(dataset, "nz", "floor") == pytest.approx(-1, rel=NEAR)


def test_gradients_sensors_viscosities_and_sources(tmp_path):
    def gradient(axis):
        rows = np.array([[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 0, -1], [0, 1, 0]], float)
        return lambda x: np.tile(rows[:, axis], (len(x), 1))

    orders = [(2, 2, 2)] * 4
    maps = boxes((2, 2, 1), bent)
    places = [own(nodes_of(1, (3, 3, 3))) for own in maps]
    mesh = files(tmp_path, 1, orders)[0]
    values = [
        ((3, 3, 3), ([variables(x), *(gradient(a)(x) for a in range(3))], [x[:, :1], 2 * x[:, :1], variables(x) + 1]))
        for x in places
    ]
    path = write_horses(tmp_path / "all.hsol", 10, 1, values, [1.0, 2.0, 3.0, 4.0])
    dataset = convert(Horses([mesh, path])).dataset
    assert mean(dataset, "rhow_x") == pytest.approx(4, rel=NEAR)
    assert mean(dataset, "rhow_z") == pytest.approx(-4, rel=NEAR)
    assert mean(dataset, "sensor") == pytest.approx(10, rel=NEAR)
    assert mean(dataset, "mu_sgs") == pytest.approx(8 * (1 + 0.4 / 3), rel=NEAR)
    assert mean(dataset, "source_rho - rho") == pytest.approx(4, rel=NEAR)


def test_statistics(tmp_path):
    mesh = files(tmp_path, 1, [(1, 2, 1)] * 4)[0]
    places = [own(nodes_of(1, (2, 3, 2))) for own in boxes((2, 2, 1), bent)]
    values = [((2, 3, 2), [np.repeat(x[:, 1:2], 9, axis=1) * np.arange(1, 10), variables(x)]) for x in places]
    path = write_horses(tmp_path / "means.hsol", 4, 1, values)
    dataset = convert(Horses([mesh, path])).dataset
    assert mean(dataset, "mean_uv") == pytest.approx(7 * 4, rel=NEAR)
    assert mean(dataset, "mean_rhoe") == pytest.approx(12, rel=NEAR)


def test_one_node_across_makes_plane_elements(tmp_path):
    flat = [(2, 2, 0)] * 4
    dataset = convert(Horses(files(tmp_path, 1, flat, functions=lambda x: x[:, :1], references=NONE))).dataset
    assert {own.label for own in dataset.mesh.elements} == {"Quadrilateral"}
    assert mean(dataset, "1", "inlet") == pytest.approx(ARC, rel=1e-11)
    assert mean(dataset, "c * x") > 0


def test_names_follow_the_equations(tmp_path):
    paths = files(tmp_path, 1, references=NONE)
    source = Horses(paths)
    assert [field.name for field in source.fields] == ["q1", "q2", "q3", "q4", "q5"]
    assert "the files don't name the equations" in source.notes[0]
    assert [field.name for field in Horses(paths, equations="mu").fields][:2] == ["c", "sqrtrhou"]
    with pytest.raises(FormatError, match="expected 6 variables of the equations nssa, found 5"):
        Horses(paths, equations="nssa")


def torn(path):
    path.write_bytes(path.read_bytes()[:-12])


def other_nodes(path):
    data = bytearray(path.read_bytes())
    data[204 + 8 : 204 + 12] = struct.pack("<i", 1000)
    path.write_bytes(bytes(data))


def other_elements(path):
    data = bytearray(path.read_bytes())
    data[136:140] = struct.pack("<i", 3)
    path.write_bytes(bytes(data))


DAMAGES = [
    (torn, "expected arrays of 4 elements up to the end"),
    (other_nodes, "expected arrays of 4 elements"),
    (other_elements, "expected a solution on the 4 elements"),
]


@pytest.mark.parametrize(("damage", "message"), DAMAGES)
def test_damaged_files_give_a_one_line_error(tmp_path, damage, message):
    paths = files(tmp_path, 1)
    damage(paths[1])
    with pytest.raises(FormatError, match=message):
        Horses(paths)


def test_boundaries_are_checked(tmp_path):
    paths = files(tmp_path, 1)
    write_zones(tmp_path / "box.bmesh", [("inlet", [9], [6])])
    with pytest.raises(FormatError, match=r"box\.bmesh: expected elements 1 to 4, found 9"):
        Horses(paths)
    with pytest.raises(FormatError, match="also give its mesh"):
        Horses(paths[1:])
