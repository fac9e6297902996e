"""Files as Firedrake writes them (firedrake/output/vtk_output.py): Lagrange cells of any order, in its own XML.

Scalars have an empty number of components, vectors and tensors are padded, all data are appended as they are.  Nodes
come in the order of VTK's library, which Firedrake asks for it.
"""

from itertools import permutations
from math import comb

import numpy as np
import pytest

from elvis import integrate, open_series, read
from elvis.plugins.testing import values_found

cells = pytest.importorskip("vtkmodules.vtkCommonDataModel")

#: cells by name: type of linear and of Lagrange cells, dimension
KINDS = {
    "interval": (3, 68, 1),
    "triangle": (5, 69, 2),
    "quadrilateral": (9, 70, 2),
    "tetrahedron": (10, 71, 3),
    "hexahedron": (12, 72, 3),
    "wedge": (13, 73, 3),
}


def lattice(name, order):
    """(n, d) places of the nodes in the unit cell, in the order of VTK."""
    if name in ("triangle", "tetrahedron"):
        dimension = KINDS[name][2]
        cell = cells.vtkLagrangeTriangle() if name == "triangle" else cells.vtkLagrangeTetra()
        count = comb(order + dimension, dimension)
        found = []
        for number in range(count):
            index = [0] * (dimension + 1)
            cell.BarycentricIndex(number, index, order)
            found.append(index[:dimension])
        return np.array(found) / order
    dimension = KINDS[name][2]
    kind = {"quadrilateral": "Quadrilateral", "hexahedron": "Hexahedron", "wedge": "Wedge"}[name]
    cell = getattr(cells, f"vtkLagrange{kind}")()
    found = {}
    for index in np.ndindex(*[order + 1] * dimension):
        if name != "wedge" or index[0] + index[1] <= order:
            found[cell.PointIndexFromIJK(*index, [order] * dimension)] = index
    return np.array([found[number] for number in range(len(found))]) / order


def unit_cells(name):
    """(n, k, d) corners of cells of the unit square or cube: origin and the ends of the axes of each."""
    dimension = KINDS[name][2]
    if name in ("quadrilateral", "hexahedron"):
        return np.concatenate([np.zeros((1, dimension)), np.eye(dimension)])[None]
    axes = 2 if name == "wedge" else dimension
    found = []
    for order in permutations(range(axes)):
        path = np.concatenate([np.zeros((1, dimension)), np.cumsum(np.eye(dimension)[list(order)], axis=0)])
        edges = path[1 : axes + 1] - path[0]
        if np.linalg.det(edges[:, :axes]) < 0:
            edges = edges[[1, 0, *range(2, axes)]]
        found.append(np.concatenate([path[:1], edges, np.eye(dimension)[axes:]]))
    return np.array(found)


def grid_nodes(name, order, count=2):
    """(n, k, d) places of the nodes of the cells of a grid of the unit square or cube."""
    dimension = KINDS[name][2]
    steps = np.array(list(np.ndindex(*[count] * dimension)))
    corners = unit_cells(name)
    local = lattice(name, order) @ corners[:, 1:] + corners[:, :1]
    return ((steps[:, None, None] + local) / count).reshape(-1, local.shape[1], dimension)


def bent(order, places):
    """Places of the unit square or cube, moved by polynomials of the degree."""
    result = np.array(places)
    result[..., 0] += 0.15 * places[..., 1] ** order
    result[..., 1] -= 0.1 * places[..., 0] ** order
    return result


def scalar(order, places):
    """A polynomial of the degree."""
    return places[..., 0] ** order - 2 * places[..., 1] * places[..., -1] ** (order - 1) + 0.5


def vtu(path, types, nodes, fields):
    """Write a file as Firedrake does.

    types   type of all cells
    nodes   points (n, 3), and numbers (cells, k) of the nodes
    fields  by name values (n,), (n, 3) or (n, 3, 3)
    """
    points, numbers = nodes
    count = np.int32(numbers.shape[1])
    topology = {
        "connectivity": numbers.astype(np.int32).reshape(-1),
        "offsets": np.arange(count, count * (len(numbers) + 1), count, dtype=np.int32),
        "types": np.full(len(numbers), types, np.uint8),
    }
    names = {"float64": "Float64", "int32": "Int32", "uint8": "UInt8"}
    offset, data, lines = 0, b"", []

    def described(name, array):
        nonlocal offset, data
        components = {1: "", 2: "3", 3: "9"}[array.ndim]
        line = (
            f'<DataArray Name="{name}" type="{names[array.dtype.name]}" NumberOfComponents="{components}" '
            f'format="appended" offset="{offset}" />\n'
        )
        data += np.uint32(array.nbytes).tobytes() + array.tobytes()
        offset += 4 + array.nbytes
        return line

    lines += ["<Points>\n", described("coordinates", points), "</Points>\n<Cells>\n"]
    lines += [described(name, array) for name, array in topology.items()]
    lines += ["</Cells>\n", f'<PointData Scalars="{next(iter(fields))}">\n']
    lines += [described(name, array) for name, array in fields.items()]
    head = (
        '<?xml version="1.0" ?>\n<VTKFile type="UnstructuredGrid" version="2.2" byte_order="LittleEndian" '
        'header_type="UInt32">\n<UnstructuredGrid>\n'
        f'<Piece NumberOfPoints="{len(points)}" NumberOfCells="{len(numbers)}">\n'
    )
    tail = "</PointData>\n</Piece>\n</UnstructuredGrid>\n"
    text = head + "".join(lines) + tail + '<AppendedData encoding="raw">\n_'
    path.write_bytes(text.encode() + data + b"\n</AppendedData>\n</VTKFile>\n")


def pvtu(path, fields, pieces):
    """Write the file of the pieces, in its own folder."""

    def described(name, kind, components):
        return f'<PDataArray Name="{name}" type="{kind}" NumberOfComponents="{components}" />'

    shapes = {1: "", 2: "3", 3: "9"}
    topology = (("connectivity", "Int32"), ("offsets", "Int32"), ("types", "UInt8"))
    text = (
        '<?xml version="1.0" ?>\n<VTKFile type="PUnstructuredGrid" version="2.2" byte_order="LittleEndian">\n'
        "<PUnstructuredGrid>\n<PPoints>\n"
        + described("coordinates", "Float64", "3")
        + "</PPoints>\n<PCells>\n"
        + "".join(described(name, kind, "") for name, kind in topology)
        + "</PCells>\n<PPointData>\n"
        + "".join(described(name, "Float64", shapes[array.ndim]) for name, array in fields.items())
        + "</PPointData>\n"
        + "".join(f'<Piece Source="{name}" />\n' for name in pieces)
        + "</PUnstructuredGrid>\n</VTKFile>\n"
    )
    path.write_text(text)


def written(folder, name, order, times=(0.0,), *, is_continuous=True, ranks=1):
    """Write a `.pvd` of a function u, its vector and a tensor, which grow with time."""
    folder = folder / "run"
    folder.mkdir()
    linear, lagrange, dimension = KINDS[name]
    unit = grid_nodes(name, order)
    lines = []
    for step, time in enumerate(times):
        pieces = []
        for rank, own in enumerate(np.array_split(unit, ranks)):
            flat = own.reshape(-1, dimension)
            if is_continuous:
                # points of cells of others, which a process knows, too
                halo = unit[-1] if rank == 0 else unit[0]
                known = np.concatenate([flat, halo])
                _, first, numbers = np.unique(np.round(known, 9), axis=0, return_index=True, return_inverse=True)
                places = known[first]
                numbers = numbers.reshape(-1)[: len(flat)].reshape(own.shape[:2])
            else:
                places, numbers = flat, np.arange(len(flat)).reshape(own.shape[:2])
            padding = ((0, 0), (0, 3 - dimension))
            points = np.pad(bent(order, places), padding)
            u = (1 + time) * scalar(order, places)
            velocity = np.pad(places * (1 + time), padding)
            stress = np.einsum("ni,j->nij", velocity, [1.0, 2.0, 3.0])
            fields = {"u": u, "velocity": velocity, "stress": stress}
            piece = f"run_{step}.vtu" if ranks == 1 else f"run_{step}_{rank}.vtu"
            vtu(folder / piece, lagrange if order > 1 else linear, (points, numbers), fields)
            pieces.append(piece)
        if ranks > 1:
            pvtu(folder / f"run_{step}.pvtu", fields, pieces)
        lines.append(f'<DataSet timestep="{time}" file="run/run_{step}.{"vtu" if ranks == 1 else "pvtu"}" />\n')
    path = folder.parent / "run.pvd"
    head = '<?xml version="1.0" ?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n<Collection>\n'
    path.write_text(head + "".join(lines) + "</Collection>\n</VTKFile>\n")
    return path


def checked(dataset, name, order, time=0.0):
    """Compare values at random places with the polynomials they are made of."""
    dimension = KINDS[name][2]
    unit = np.random.default_rng(order).uniform(0.02, 0.98, (40, dimension))
    places = np.pad(bent(order, unit), ((0, 0), (0, 3 - dimension)))
    wanted = (1 + time) * scalar(order, unit)
    assert np.abs(values_found(dataset, "u", places) - wanted).max() < 1e-12
    for axis, letter in enumerate("xyz"[:dimension]):
        found = values_found(dataset, f"velocity_{letter}", places)
        assert np.abs(found - (1 + time) * unit[:, axis]).max() < 1e-12


@pytest.mark.parametrize(
    ("name", "order"),
    [("quadrilateral", 1), ("triangle", 6), ("tetrahedron", 3), ("hexahedron", 3), ("wedge", 2)],
)
def test_values_match_those_of_the_functions(tmp_path, name, order):
    """Cells of continuous functions share their points, those of others have their own."""
    dataset = read(written(tmp_path, name, order, is_continuous=name != "tetrahedron"), cache=False)
    checked(dataset, name, order)


@pytest.mark.parametrize(("name", "order"), [("quadrilateral", 4), ("tetrahedron", 2)])
def test_pieces_of_processes_and_times_are_one_series(tmp_path, name, order):
    """Points of cells of other processes belong to no cell here, and are no points of the mesh."""
    times = [0.25, 2.0]
    series = open_series(written(tmp_path, name, order, times, ranks=2), cache=False)
    assert series.times.tolist() == times
    for dataset, time in zip(series, times, strict=True):
        assert dataset.time == time
        checked(dataset, name, order, time)
        mesh = dataset.mesh
        (elements,) = mesh.elements.values()
        neighbours = np.bincount(elements.members.reshape(-1))
        assert len(elements.ids) == len(grid_nodes(name, order))
        # the outline of the square or cube is all that has no neighbour
        assert np.sum(neighbours == 1) == {"quadrilateral": 8, "tetrahedron": 48}[name]


def curves(path, order, places, numbers):
    """Write curves through places (n,) on a line, with the squares of these."""
    points = np.pad(places[:, None], ((0, 0), (0, 2)))
    vtu(path, KINDS["interval"][1], (points, np.array(numbers).reshape(-1, order + 1)), {"u": places**2})
    return path


@pytest.mark.parametrize("order", [2, 5])
@pytest.mark.parametrize("is_row", [True, False], ids=["in a row", "ends first"])
def test_nodes_of_curves_are_in_sequence(tmp_path, order, is_row):
    """Firedrake doesn't put the ends first, as VTK does."""
    numbers = np.arange(3)[:, None] * order + np.arange(order + 1)
    if not is_row:
        numbers = numbers[:, [0, order, *range(1, order)]]
    # one of them runs backwards
    numbers[1] = numbers[1, ::-1] if is_row else numbers[1, [1, 0, *range(order, 1, -1)]]
    dataset = read(curves(tmp_path / "line.vtu", order, np.linspace(0, 2, 3 * order + 1), numbers), cache=False)
    assert integrate(dataset, "u").value == pytest.approx(8 / 3, rel=1e-14)
    assert any("nodes of curves follow one another" in remark for remark in dataset.remarks) == is_row
    assert not any("folded" in remark for remark in dataset.remarks)


def test_curves_that_fold_are_reported(tmp_path):
    """Of three on a line, one runs backwards and one folds."""
    places = np.array([0.0, 1.0, 0.5, 2.0, 1.6, 2.5, 3.2])
    path = curves(tmp_path / "line.vtu", 2, places, [[0, 1, 2], [3, 1, 4], [3, 5, 6]])
    dataset = read(path, cache=False)
    assert any("1 element is inverted or folded" in remark for remark in dataset.remarks)
