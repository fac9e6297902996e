"""Meshes whose elements don't match: refined ones with hanging nodes, mortars, parts that are glued by place."""

import itertools
import tracemalloc

import h5py
import numpy as np
import pytest
from click.testing import CliRunner
from exodus_writer import ExodusBlock, unit_cubes, write_classic

from elvis import from_arrays, integrate, read, trace, vortex_cores
from elvis.core.data.mesh import NON_CONFORMING
from elvis.core.interfaces import hanging
from elvis.core.interfaces.feet import feet
from elvis.core.interfaces.interface_composites import with_interfaces
from elvis.core.interfaces.side_groups import side_set
from elvis.core.shapes import Shape
from elvis.plugins.command.command import elvis as group
from elvis.plugins.faces.dataset_faces import native_faces

UNIT = np.array(list(itertools.product((0.0, 1.0), repeat=3)))[:, ::-1]
#: corners of a hexahedron in the order of VTK, Gmsh and Exodus, among those with x fastest
AROUND = [0, 1, 3, 2, 4, 5, 7, 6]


@pytest.fixture
def run_elvis():
    """Run a command in this process and return its warnings and notes as one line."""

    def run(*arguments):
        outcome = CliRunner().invoke(group, [str(argument) for argument in arguments])
        assert outcome.exit_code == 0, outcome.stderr
        return " ".join(outcome.stderr.split())

    return run


def box(low, high):
    """(8, 3) corners of a box, x fastest."""
    return np.asarray(low) + UNIT * (np.asarray(high) - np.asarray(low))


def cells(low, high, counts):
    """Boxes (n, 8, 3) that a box is cut into."""
    lines = [np.linspace(a, b, n + 1) for a, b, n in zip(low, high, counts, strict=True)]
    found = []
    for k, j, i in itertools.product(*map(range, counts[::-1])):
        corner = [line[m] for line, m in zip(lines, (i, j, k), strict=True)]
        end = [line[m + 1] for line, m in zip(lines, (i, j, k), strict=True)]
        found.append(box(corner, end))
    return np.array(found)


def turned(points):
    """Points under a rotation, so that no face lies along an axis."""
    rotation = np.linalg.qr(np.array([[1.0, 0.4, -0.3], [0.2, 1.0, 0.5], [-0.6, 0.1, 1.0]]))[0]
    return points @ (rotation * np.sign(np.linalg.det(rotation))).T


#: edges of a square and those of a hexahedron, by its corners in the order of VTK
SQUARE_EDGES = [(0, 1), (1, 2), (2, 3), (0, 3)]
VTK_EDGES = [*SQUARE_EDGES, (4, 5), (5, 6), (6, 7), (4, 7), (0, 4), (1, 5), (2, 6), (3, 7)]
VTK_FACES = [(0, 3, 4, 7), (1, 2, 5, 6), (0, 1, 4, 5), (2, 3, 6, 7), (0, 1, 2, 3), (4, 5, 6, 7)]
GMSH_EDGES = [(0, 1), (0, 3), (0, 4), (1, 2), (1, 5), (2, 3), (2, 6), (3, 7), (4, 5), (4, 7), (5, 6), (6, 7)]
GMSH_FACES = [(0, 1, 2, 3), (0, 1, 4, 5), (0, 3, 4, 7), (1, 2, 5, 6), (2, 3, 6, 7), (4, 5, 6, 7)]
#: of quadratic cells the groups of corners in whose middles nodes lie: VTK's types 28 and 29, Gmsh's 10, 12 and 11
VTK_QUADRATIC = {4: [*SQUARE_EDGES, range(4)], 8: [*VTK_EDGES, *VTK_FACES, range(8)]}
GMSH_QUADRATIC = {3: VTK_QUADRATIC[4], 5: [*GMSH_EDGES, *GMSH_FACES, range(8)]}
GMSH_QUADRATIC[4] = [(0, 1), (1, 2), (0, 2), (0, 3), (2, 3), (1, 3)]
GMSH_TYPES = {3: 10, 5: 12, 4: 11}


def quadratic(corners, groups):
    """Nodes of quadratic cells (n, k, 3): corners (n, m, 3), then the middles of some of them."""
    return np.concatenate([corners, *(corners[:, list(group)].mean(axis=1)[:, None] for group in groups)], axis=1)


def bent(points):
    """Points under the quadratic map z + x^2 / 8, turned."""
    return turned(points + points[..., :1] ** 2 / 8 * (0, 0, 1))


def bent_flat(points):
    """Points of a plane under the quadratic map y + x^2 / 8."""
    return points + points[..., :1] ** 2 / 8 * (0, 1, 0)


def write_vtk(path, corners, constants=(), bend=None):
    """Boxes, or squares of four corners, as cells of a legacy file, with a constant ``u`` on each.

    bend  of quadratic cells; linear ones have none
    """
    is_box = corners.shape[1] == 8
    order = AROUND if is_box else [0, 1, 3, 2]
    nodes = corners[:, order]
    if bend is not None:
        nodes = bend(quadratic(nodes, VTK_QUADRATIC[nodes.shape[1]]))
    kind = {4: 9, 8: 12, 9: 28, 27: 29}[nodes.shape[1]]
    count = nodes.shape[1]
    lines = ["# vtk DataFile Version 3.0", "cells", "ASCII", "DATASET UNSTRUCTURED_GRID"]
    points = nodes.reshape(-1, 3)
    lines.append(f"POINTS {len(points)} double")
    lines += [" ".join(map(repr, map(float, point))) for point in points]
    lines.append(f"CELLS {len(corners)} {len(corners) * (count + 1)}")
    lines += [f"{count} " + " ".join(str(count * n + k) for k in range(count)) for n in range(len(corners))]
    lines += [f"CELL_TYPES {len(corners)}", *[str(kind)] * len(corners)]
    if len(constants):
        lines += [f"CELL_DATA {len(corners)}", "SCALARS u double", "LOOKUP_TABLE default", *map(repr, constants)]
    path.write_text("\n".join(lines) + "\n")
    return path


def write_gmsh(path, parts, bend=None):
    """Parts that share no nodes: pairs of Gmsh's type of linear elements and their corners (n, k, 3).

    bend  of quadratic elements; linear ones have none
    """
    nodes, elements = [], []
    if bend is not None:
        parts = [(GMSH_TYPES[kind], bend(quadratic(corners, GMSH_QUADRATIC[kind]))) for kind, corners in parts]
    for kind, corners in parts:
        distinct, which = np.unique(corners.reshape(-1, 3).round(14), axis=0, return_inverse=True)
        which = which.reshape(corners.shape[:2]) + len(nodes) + 1
        nodes += distinct.tolist()
        elements += [(kind, own) for own in which.tolist()]
    lines = ["$MeshFormat", "2.2 0 8", "$EndMeshFormat", "$Nodes", str(len(nodes))]
    lines += [f"{n} " + " ".join(map(repr, node)) for n, node in enumerate(nodes, 1)]
    lines += ["$EndNodes", "$Elements", str(len(elements))]
    lines += [f"{n} {kind} 2 1 1 " + " ".join(map(str, own)) for n, (kind, own) in enumerate(elements, 1)]
    path.write_text("\n".join([*lines, "$EndElements"]) + "\n")
    return path


#: six tetrahedra of a box, by its corners in the order of VTK
TETRAHEDRA = [(0, 1, 2, 6), (0, 2, 3, 6), (0, 3, 7, 6), (0, 7, 4, 6), (0, 4, 5, 6), (0, 5, 1, 6)]
#: sides of hexahedra in the order of HOPR: axis and end
HOPR_SIDES = [(2, 0), (1, 0), (0, 1), (1, 1), (0, 0), (2, 1)]
NAMES = ["bottom", "front", "right", "back", "left", "top"]


def write_hopr(path, boxes, bend, order=2):
    """Boxes (low, high) under a map, with the sides that lie on the outer box named, those inside as mortars.

    The side at the largest x of the first box is a mortar of all boxes behind it.
    """
    line = np.linspace(0, 1, order + 1)
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1)[..., ::-1].reshape(-1, 3)
    outer = np.array([np.min([low for low, _ in boxes], axis=0), np.max([high for _, high in boxes], axis=0)])
    nodes, sides, info = [], [], []
    for number, (low, high) in enumerate(boxes):
        low, high = np.asarray(low, float), np.asarray(high, float)
        nodes.append(bend(low + grid * (high - low)))
        first = len(sides)
        for side, (axis, end) in enumerate(HOPR_SIDES):
            is_outer = (low, high)[end][axis] == outer[end][axis]
            if is_outer:
                sides.append([4, len(sides) + 1, 0, 0, side + 1])
            elif number == 0 and (axis, end) == (0, 1):
                small = len(boxes) - 1
                sides.append([4, len(sides) + 1, {4: -1, 2: -2}[small], 0, 0])
                sides += [[104, len(sides) + 1 + k, 2 + k, 50, 0] for k in range(small)]
            else:
                sides.append([-104 if axis == 0 else 4, len(sides) + 1, 1, 31, 0])
        info.append([108, 1, first, len(sides), len(grid) * number, len(grid) * (number + 1)])
    points = np.concatenate(nodes)
    ids = np.unique(points.round(12), axis=0, return_inverse=True)[1].reshape(-1) + 1
    with h5py.File(path, "w") as file:
        file.attrs["Ngeo"] = np.array([order], "i4")
        file["ElemInfo"], file["SideInfo"] = np.array(info, "i4"), np.array(sides, "i4")
        file["NodeCoords"], file["GlobalNodeIDs"] = points, ids.astype("i4")
        file["BCNames"] = np.array([name.ljust(255) for name in NAMES], "S255")
        file["BCType"] = np.ones((6, 4), "i4")
    return path


def areas(elvis_json, *files):
    """Area of the outer boundary by name."""
    found = elvis_json("integrate", *files, "--over", "all", "--field", "1", "--error", "1e-12", "--no-cache")
    return {row["over"]: row["value"] for row in found}


def arc(slope):
    """Length of the parabola y = a x², 0 <= x <= 1, with 2 a = ``slope``."""
    return np.sqrt(1 + slope**2) / 2 + np.arcsinh(slope) / (2 * slope)


def squares(low, high, counts):
    """Squares (n, 4, 3) that a rectangle is cut into."""
    return cells((*low, 0), (*high, 1), (*counts, 1))[:, :4] * (1, 1, 0)


def mfem_mesh(path, mesh, refined, bend=None):
    """A mesh of MFEM's after a bend of its nodes and several local refinements: numbers of elements, and directions."""
    mfem = pytest.importorskip("mfem.ser")
    dimension = mesh.Dimension()
    mesh.SetCurvature(2, False, dimension, 0)
    nodes = mesh.GetNodes().GetDataArray().reshape(dimension, -1)
    if bend is not None:
        nodes[1] += bend * nodes[0] ** 2
    mesh.EnsureNCMesh(True)
    for elements, directions in refined:
        marks = mfem.RefinementArray()
        for element in elements:
            marks.Append(mfem.Refinement(element, directions))
        mesh.GeneralRefinement(marks, 1, 0)
    mesh.Save(str(path), 16)
    return path


def mfem_square(path, kind="quads", refined=(), bend=None):
    """The unit square of 2 x 2 quadrilaterals, or of 8 triangles, refined."""
    mfem = pytest.importorskip("mfem.ser")
    shape = {"quads": mfem.Element.QUADRILATERAL, "triangles": mfem.Element.TRIANGLE}[kind]
    return mfem_mesh(path, mfem.Mesh.MakeCartesian2D(2, 2, shape, True, 1.0, 1.0), refined, bend)


def mfem_cube(path, refined, bend=None, kind="hexahedra"):
    """The unit cube of 2 x 2 x 2 hexahedra, or of their tetrahedra, refined."""
    mfem = pytest.importorskip("mfem.ser")
    shape = {"hexahedra": mfem.Element.HEXAHEDRON, "tetrahedra": mfem.Element.TETRAHEDRON}[kind]
    return mfem_mesh(path, mfem.Mesh.MakeCartesian3D(2, 2, 2, shape, 1.0, 1.0, 1.0), refined, bend)


#: surface of the box 2 x 1 x 1 that is curved by z + x²/8
BENT_ROW = 2 + 4 + 4 * arc(0.5)


def hanging_mfem_2d(folder):
    """Quadrilaterals with a quarter refined three times, 4:1 among them, under y + x²/4."""
    file = mfem_square(folder / "nc.mesh", refined=[([0], 3), ([0], 3), ([1], 3)], bend=0.25)
    return [file], {"boundary1": arc(0.5), "boundary2": 1, "boundary3": arc(0.5), "boundary4": 1}


def hanging_mfem_triangles(folder):
    """Triangles, two of them refined, one of these again, under y + x²/4."""
    file = mfem_square(folder / "nc.mesh", "triangles", [([0, 3], 7), ([0], 7)], 0.25)
    return [file], {"boundary1": arc(0.5), "boundary2": 1, "boundary3": arc(0.5), "boundary4": 1}


def hanging_mfem_3d(folder):
    """Hexahedra, one refined along x and y alone, under y + x²/4."""
    file = mfem_cube(folder / "nc.mesh", [([0], 7), ([0], 3), ([3], 1)], 0.25)
    side = {"boundary2": arc(0.5), "boundary4": arc(0.5)}
    return [file], {**dict.fromkeys(("boundary1", "boundary3", "boundary5", "boundary6"), 1), **side}


def hanging_mfem_tetrahedra(folder):
    """Tetrahedra, some of them refined, under y + x²/4."""
    file = mfem_cube(folder / "nc.mesh", [([0, 5, 9], 7), ([2], 7)], 0.25, "tetrahedra")
    side = {"boundary2": arc(0.5), "boundary4": arc(0.5)}
    return [file], {**dict.fromkeys(("boundary1", "boundary3", "boundary5", "boundary6"), 1), **side}


def mortars_of_hopr(folder, behind):
    """A cube and several boxes behind it, under z + x²/8."""
    boxes = [((0, 0, 0), (1, 1, 1)), *behind]
    file = write_hopr(folder / "mortar_mesh.h5", boxes, lambda own: own + own[:, :1] ** 2 / 8 * (0, 0, 1))
    # the parabola z = x²/8 from 0 to 2
    long = 2 * arc(0.5)
    return [file], {"bottom": long, "top": long, "front": 2, "back": 2, "left": 1, "right": 1}


def two_mortars(folder):
    """Two small sides, one above the other."""
    return mortars_of_hopr(folder, [((1, 0, 0), (2, 1, 0.5)), ((1, 0, 0.5), (2, 1, 1))])


def four_mortars(folder):
    """Four small sides."""
    small = [((1, y, z), (2, y + 0.5, z + 0.5)) for z in (0, 0.5) for y in (0, 0.5)]
    return mortars_of_hopr(folder, small)


def octree_of_vtk(folder):
    """A curved and turned cube of octree cells: 2:1 and 4:1."""
    coarse = cells((0, 0, 0), (1, 1, 1), (2, 2, 2))[1:]
    finer = cells((0, 0, 0), (0.5, 0.5, 0.5), (2, 2, 2))[:-1]
    finest = cells((0.25, 0.25, 0.25), (0.5, 0.5, 0.5), (2, 2, 2))
    file = write_vtk(folder / "octree.vtk", np.concatenate([coarse, finer, finest]), bend=bent)
    return [file], {"all": 4 + 2 * arc(0.25)}


def quadtree_of_vtk(folder):
    """A curved square of quadtree cells: 4:1 at one side."""
    found = np.concatenate([squares((0, 0), (1, 2), (1, 2)), squares((1, 0), (2, 2), (4, 8))])
    return [write_vtk(folder / "quadtree.vtk", found, bend=bent_flat)], {"all": 4 + 4 * arc(0.5)}


def anisotropic_vtk(folder):
    """Bent boxes that are cut along different axes on either side."""
    parts = [cells((0, 0, 0), (1, 1, 1), (1, 3, 1)), cells((1, 0, 0), (2, 1, 1), (2, 1, 4))]
    file = write_vtk(folder / "boxes.vtk", np.concatenate(parts), bend=bent)
    return [file], {"all": BENT_ROW}


def glued_squares_of_gmsh(folder):
    """Two curved parts with three and four edges at their common side, and no common nodes."""
    parts = [squares((0, 0), (1, 1), (2, 3)), squares((1, 0), (2, 1), (3, 4))]
    file = write_gmsh(folder / "glued.msh", [(3, own[:, [0, 1, 3, 2]]) for own in parts], bent_flat)
    return [file], {"all": 2 + 4 * arc(0.5)}


def glued_boxes_of_gmsh(folder):
    """Two curved parts whose faces overlap in part: three by two next to two by three."""
    parts = [cells((0, 0, 0), (1, 1, 1), (1, 3, 2)), cells((1, 0, 0), (2, 1, 1), (1, 2, 3))]
    file = write_gmsh(folder / "glued.msh", [(5, own[:, AROUND]) for own in parts], bent)
    return [file], {"all": BENT_ROW}


def hexahedra_and_tetrahedra_of_gmsh(folder):
    """Bent hexahedra next to curved tetrahedra, whose triangles lie on their quadrilaterals."""
    return [hexahedra_and_tetrahedra(folder, bent)], {"all": BENT_ROW}


def hexahedra_and_tetrahedra(folder, bend=None):
    """A box of hexahedra next to one of tetrahedra."""
    one = cells((0, 0, 0), (1, 1, 1), (1, 2, 2))[:, AROUND]
    other = cells((1, 0, 0), (2, 1, 1), (1, 2, 2))[:, AROUND][:, TETRAHEDRA].reshape(-1, 4, 3)
    return write_gmsh(folder / "mixed.msh", [(5, one), (4, other)], bend)


MESHES = [
    hanging_mfem_2d,
    hanging_mfem_triangles,
    hanging_mfem_3d,
    hanging_mfem_tetrahedra,
    two_mortars,
    four_mortars,
    octree_of_vtk,
    quadtree_of_vtk,
    anisotropic_vtk,
    glued_squares_of_gmsh,
    glued_boxes_of_gmsh,
    hexahedra_and_tetrahedra_of_gmsh,
]


@pytest.mark.sampled(least=6, free=("mesh",))
@pytest.mark.parametrize("mesh", MESHES, ids=lambda mesh: mesh.__name__)
def test_outer_boundary_has_no_inner_faces(elvis_json, tmp_path, mesh):
    files, wanted = mesh(tmp_path)
    found = areas(elvis_json, *files)
    total = sum(wanted.values())
    assert found.pop("total", total) == pytest.approx(total, rel=1e-11)
    assert found == pytest.approx(wanted, rel=1e-11)
    facts = elvis_json("info", *files)
    assert facts["mesh"]["non_conforming_sides"] > 0


@pytest.mark.parametrize("mesh", [hanging_mfem_2d, octree_of_vtk, two_mortars, glued_boxes_of_gmsh])
def test_distances_to_all_outer_faces_are_signed(elvis_json, tmp_path, mesh):
    files, _ = mesh(tmp_path)
    middle = {"hanging_mfem_2d": (0.5, 0.52, 0), "octree_of_vtk": bent(np.array([0.5, 0.6, 0.55]))}
    point = middle.get(mesh.__name__, bent(np.array([1.0, 0.6, 0.55])))
    if mesh is two_mortars:
        point = (1.05, 0.2, 0.6)
    rows = elvis_json("probe", *files, "--point", ",".join(map(str, point)), "--field", "distance(all)")
    wanted = {"octree_of_vtk": -0.4, "two_mortars": -0.2, "glued_boxes_of_gmsh": -0.4}.get(mesh.__name__)
    found = rows[0]["distance(all)"]
    if wanted is None:
        assert -0.5 < found < -0.35
    else:
        assert found == pytest.approx(wanted, abs=1e-11)


#: a rigid rotation about the middle of a rectangle of 2 x 2, and about that of a box
AROUND_MIDDLE = "1-y,x-1"


def turn(elvis, folder, file, seed, velocity):
    """Where a line ends that goes once around, and how it ends."""
    out = folder / "lines.npz"
    duration = repr(2 * np.pi)
    elvis("trace", file, "--velocity", velocity, "--seeds", f"point:{seed}", "--duration", duration, "-o", out)
    with np.load(out) as found:
        return found["points"][-1], found["ends"][found["end"][0]]


@pytest.mark.thorough
@pytest.mark.parametrize("counts", [(4, 8), (3, 5)], ids=["4 to 1", "5 to 2"])
def test_lines_go_around_through_refined_parts(elvis, tmp_path, counts):
    parts = [squares((0, 0), (1, 2), (1, 2)), squares((1, 0), (2, 2), counts)]
    file = write_vtk(tmp_path / "quadtree.vtk", np.concatenate(parts))
    end, how = turn(elvis, tmp_path, file, "1.31,0.62", AROUND_MIDDLE)
    assert str(how) == "duration"
    assert np.abs(end - (1.31, 0.62, 0)).max() <= 1e-9


@pytest.mark.thorough
@pytest.mark.parametrize("fine", [2, 4], ids=["2 to 1", "4 to 1"])
def test_lines_go_around_through_refined_boxes(elvis, tmp_path, fine):
    parts = [cells((0, 0, 0), (1, 2, 1), (1, 2, 1)), cells((1, 0, 0), (2, 2, 1), (fine, 2 * fine, fine))]
    file = write_vtk(tmp_path / "octree.vtk", np.concatenate(parts))
    end, how = turn(elvis, tmp_path, file, "1.31,0.62,0.37", AROUND_MIDDLE + ",0*x")
    assert str(how) == "duration"
    assert np.abs(end - (1.31, 0.62, 0.37)).max() <= 1e-9


#: meshes, seeds in them, and velocities of a rigid rotation
TURNS = [
    (hanging_mfem_2d, (0.3, 0.55), "0.55-y,x-0.5"),
    (hanging_mfem_3d, (0.3, 0.62, 0.37), "0.62-y,x-0.5,0*x"),
    (four_mortars, (0.7, 0.5, 0.45), "0.5-y,x-1,0*x"),
]


@pytest.mark.parametrize(("mesh", "seed", "velocity"), TURNS, ids=lambda own: getattr(own, "__name__", ""))
def test_lines_go_around_through_curved_elements(elvis, tmp_path, mesh, seed, velocity):
    (file,), _ = mesh(tmp_path)
    end, how = turn(elvis, tmp_path, file, ",".join(map(str, seed)), velocity)
    assert str(how) == "duration"
    assert np.abs(end[: len(seed)] - seed).max() <= 1e-9


def test_lines_cross_from_hexahedra_to_tetrahedra(elvis, tmp_path):
    file = hexahedra_and_tetrahedra(tmp_path)
    start = np.array([0.1, 0.3, 0.3])
    way = "1+0*x,0*x,0*x"
    out = tmp_path / "lines.npz"
    elvis("trace", file, "--velocity", way, "--seeds", f"point:{','.join(map(repr, start.tolist()))}", "-o", out)
    with np.load(out) as found:
        assert np.linalg.norm(found["points"][-1] - start) == pytest.approx(1.9, abs=1e-11)
        assert str(found["ends"][found["end"][0]]) == "boundary"


def test_jumps_are_computed_across_nonmatching_sides(elvis_json, tmp_path):
    # two large squares next to two times four small ones; a small one has the large one and its own kind next to it
    corners = np.concatenate([squares((0, 0), (1, 2), (1, 2)), squares((1, 0), (2, 2), (2, 4))])
    constants = [1.0, 4.0, 10.0, 20.0, 40.0, 80.0, 160.0, 320.0, 640.0, 1280.0]
    file = write_vtk(tmp_path / "cells.vtk", turned(corners), constants)
    wanted = {0: max(10 - 1, 40 - 1, 4 - 1), 1: 640 - 4, 2: max(10 - 1, 20 - 10, 40 - 10), 4: max(39, 40, 120)}
    for number, jump in wanted.items():
        point = ",".join(map(str, turned(corners[number].mean(axis=0)).tolist()))
        rows = elvis_json("probe", file, "--point", point, "--field", "jump(u)")
        assert rows[0]["jump(u)"] == pytest.approx(jump, rel=1e-13)


def periodic_channel(path, counts=(4, 3)):
    """A rectangle of 2 x 1 that is periodic along x, with the walls of MFEM as boundaries 1 and 3."""
    mfem = pytest.importorskip("mfem.ser")
    mesh = mfem.Mesh.MakeCartesian2D(*counts, mfem.Element.QUADRILATERAL, True, 2.0, 1.0)
    mapping = mesh.CreatePeriodicVertexMapping([mfem.Vector([2.0, 0.0])])
    mfem.Mesh.MakePeriodic(mesh, mapping).Save(str(path), 16)
    return path


def test_periodic_sides_are_not_outer_boundaries(elvis, elvis_json, tmp_path):
    file = periodic_channel(tmp_path / "channel.mesh")
    found = areas(elvis_json, file)
    assert found.pop("total") == pytest.approx(4, rel=1e-13)
    assert found == pytest.approx({"boundary1": 2, "boundary3": 2}, rel=1e-13)
    assert elvis_json("info", file)["mesh"]["periodic_sides"] == 6
    out = tmp_path / "lines.npz"
    elvis("trace", file, "--velocity", "1+0*x,0*x", "--seeds", "point:0.1,0.4", "-o", out)
    with np.load(out) as lines:
        assert str(lines["ends"][lines["end"][0]]) == "(periodic)"
        assert lines["points"][-1] == pytest.approx([2, 0.4, 0], abs=1e-12)


def refined_periodic_mesh(path, dimension, refined):
    """A box of length 2 that is periodic along x, of height and depth 1, some of whose elements are refined."""
    mfem = pytest.importorskip("mfem.ser")
    if dimension == 2:
        mesh = mfem.Mesh.MakeCartesian2D(4, 2, mfem.Element.QUADRILATERAL, True, 2.0, 1.0)
    else:
        mesh = mfem.Mesh.MakeCartesian3D(3, 2, 2, mfem.Element.HEXAHEDRON, 2.0, 1.0, 1.0)
    shift = mfem.Vector([2.0, *[0.0] * (dimension - 1)])
    mesh = mfem.Mesh.MakePeriodic(mesh, mesh.CreatePeriodicVertexMapping([shift]))
    mesh.EnsureNCMesh(True)
    for element in refined:
        mesh.GeneralRefinement(mfem.intArray([element]), 1, 0)
    mesh.Save(str(path), 16)
    return path


@pytest.mark.parametrize(
    ("dimension", "refined", "wanted"),
    [(2, [0, 0], {"boundary1": 2, "boundary3": 2}), (3, [0], dict.fromkeys([f"boundary{n}" for n in (1, 2, 4, 6)], 2))],
)
def test_nonmatching_periodic_sides_are_not_outer_boundaries(tmp_path, dimension, refined, wanted):
    dataset = read(refined_periodic_mesh(tmp_path / "box.mesh", dimension, refined))
    found = {row.over: row.value for row in integrate(dataset, "1", "all", error=1e-12)}
    assert found.pop("total") == pytest.approx(sum(wanted.values()), rel=1e-13)
    assert found == pytest.approx(wanted, rel=1e-13)
    for start, end in ((0.1, 0), (1.9, 2)):
        velocity = [f"{2 * (end > 1) - 1}+0*x", *["0*x"] * (dimension - 1)]
        lines = trace(dataset, [(start, 0.1, 0.3)[:dimension]], velocity=velocity)
        assert lines.ends[lines.end[0]] == "(periodic)"
        assert lines.points[-1][:dimension] == pytest.approx((end, 0.1, 0.3)[:dimension], abs=1e-12)


def test_overlapping_sets_of_mfem_are_preserved(elvis_json, tmp_path):
    lines = ["MFEM mesh v1.3", "dimension", "2", "elements", "2", "1 3 0 1 4 3", "2 3 1 2 5 4", "attribute_sets", "2"]
    lines += ['"solid"', "2", "1 2", '"steel"', "1", "1", "boundary", "6", "1 1 0 1", "1 1 1 2", "3 1 4 3", "3 1 5 4"]
    lines += ["4 1 3 0", "2 1 2 5", "bdr_attribute_sets", "3", '"all sides"', "4", "1 2 3 4", '"in"', "1", "4"]
    lines += ['"wall"', "2", "1 3", "vertices", "6", "2", "0 0", "1 0", "2 0", "0 1", "1 1", "2 1", "mfem_mesh_end"]
    file = tmp_path / "sets.mesh"
    file.write_text("\n".join(lines) + "\n")
    names = {"region:solid": 2, "region:steel": 1, "all sides": 6, "in": 1, "wall": 4}
    for name, wanted in names.items():
        (found,) = elvis_json("integrate", file, "--over", name, "--field", "1")
        assert found["value"] == pytest.approx(wanted, rel=1e-13)


def quadratic_pyramid(path, names):
    """A unit pyramid of order 2 with a name on each of its sides, as a mesh of MFEM."""
    mfem = pytest.importorskip("mfem.ser")
    mesh = mfem.Mesh(3, 5, 1, 5)
    for point in ((0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1)):
        mesh.AddVertex(*map(float, point))
    mesh.AddPyramid(0, 1, 2, 3, 4, 1)
    mesh.AddBdrQuad(3, 2, 1, 0, names[0])
    for name, corners in zip(names[1:], ((0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)), strict=True):
        mesh.AddBdrTriangle(*corners, name)
    mesh.FinalizeTopology()
    mesh.Finalize()
    mesh.SetCurvature(2)
    mesh.Save(str(path), 16)
    return path


def test_sides_of_quadratic_pyramids_keep_their_names(elvis_json, tmp_path):
    file = quadratic_pyramid(tmp_path / "pyramid.mesh", [5, 4, 3, 2, 1])
    found = areas(elvis_json, file)
    wanted = {"boundary5": 1, "boundary4": 0.5, "boundary3": 0.5**0.5, "boundary2": 0.5**0.5, "boundary1": 0.5}
    assert found.pop("total") == pytest.approx(sum(wanted.values()), rel=1e-13)
    assert found == pytest.approx(wanted, rel=1e-13)


@pytest.mark.parametrize(("shift", "wanted"), [(0.5, 2), (1.0, 0)])
def test_partly_overlapping_faces_are_named_in_every_command(run_elvis, tmp_path, shift, wanted):
    # two cubes side by side, one of them shifted along the common plane; at last they share an edge alone
    one, other = cells((0, 0, 0), (1, 1, 1), (1, 1, 1)), cells((1, shift, 0), (2, 1 + shift, 1), (1, 1, 1))
    file = write_gmsh(tmp_path / "shifted.msh", [(5, turned(own[:, AROUND])) for own in (one, other)])
    for command in (["norms"], ["integrate", "--over", "all", "--field", "1"]):
        warnings = run_elvis(command[0], file, *command[1:])
        assert (f"{wanted} faces may lie on faces of other elements" in warnings) is (wanted > 0)


def test_gaps_next_to_small_sides_are_named(run_elvis, tmp_path):
    one, other = squares((0, 0), (1, 1), (1, 1)), squares((1, 0), (2, 1), (1, 2))
    other[:, :, 0] += 0.02 * ((other[:, :, 0] == 1) & (other[:, :, 1] == 0.5))
    file = write_vtk(tmp_path / "gap.vtk", np.concatenate([one, other]))
    assert "3 edges may lie on edges of other elements, in part or within 0.02" in run_elvis("norms", file)


def test_named_faces_of_a_slit_remain_outer_faces(elvis_json, tmp_path):
    # both faces of the common side have names: a slit, which lines don't cross
    lines = ["MFEM mesh v1.0", "dimension", "2", "elements", "2", "1 3 0 1 2 3", "1 3 4 5 6 7", "boundary", "8"]
    lines += ["1 1 0 1", "9 1 1 2", "1 1 2 3", "1 1 3 0", "1 1 4 5", "1 1 5 6", "1 1 6 7", "8 1 7 4", "vertices", "8"]
    lines += ["2", "0 0", "1 0", "1 1", "0 1", "1 0", "2 0", "2 1", "1 1"]
    file = tmp_path / "slit.mesh"
    file.write_text("\n".join(lines) + "\n")
    assert areas(elvis_json, file) == pytest.approx({"boundary1": 6, "boundary8": 1, "boundary9": 1, "total": 8})
    file.write_text("\n".join(lines).replace("9 1 1 2\n", "").replace("boundary\n8", "boundary\n7") + "\n")
    assert areas(elvis_json, file) == pytest.approx({"all": 6})


def test_vortex_cores_cross_nonmatching_sides(tmp_path):
    parts = [cells((0, 0, 0), (1, 2, 1), (1, 2, 1)), cells((1, 0, 0), (2, 2, 1), (4, 8, 4))]
    dataset = read(write_vtk(tmp_path / "octree.vtk", np.concatenate(parts)))
    cores = vortex_cores(dataset, "0.3+0.1*(y-0.8),0.45-z+0.2*(y-0.8),y-0.8")
    assert cores.counts() == {"boundary": 2}
    ends = cores.points[[0, -1]]
    assert ends[np.argsort(ends[:, 0])] == pytest.approx(np.array([[0, 0.8, 0.45], [2, 0.8, 0.45]]), abs=1e-6)


def test_faces_between_nonmatching_elements_are_drawn_as_inner_faces(tmp_path):
    parts = [cells((0, 0, 0), (1, 1, 1), (1, 1, 1)), cells((1, 0, 0), (2, 1, 1), (2, 2, 2))]
    dataset = read(write_vtk(tmp_path / "boxes.vtk", turned(np.concatenate(parts))))
    faces = native_faces(dataset, [entities.ids for entities in dataset.mesh.elements.values()])
    counts = {word: sum(map(len, faces.select([word]))) for word in ("all", "inner", NON_CONFORMING)}
    # outside are 5 large faces and 4 + 4 * 4 small ones; inside 1 + 4 that don't match, and 12 from both sides
    assert counts == {"all": 25, "inner": 5 + 24, NON_CONFORMING: 5}


def test_sides_of_a_sharp_element_are_not_a_doubtful_interface(tmp_path, run_elvis):
    """The sides around a corner of 15 degrees, of which one lies on two sides of other elements."""
    tip, far, high = np.zeros(3), np.array([2.0, 0, 0]), np.array([2.0, 2 * np.tan(np.radians(15)), 0])
    top = high + np.array([-1.0, 1.0, 0])
    middle = high / 2
    triangles = [(tip, far, high), (tip, middle, top), (middle, high, top)]
    path = write_gmsh(tmp_path / "sharp.msh", [(2, np.array([triangle])) for triangle in triangles])
    assert "may lie on" not in run_elvis("integrate", path, "--over", "all", "--field", "1")
    outline = sum(np.linalg.norm(b - a) for a, b in ((tip, far), (far, high), (high, top), (top, tip)))
    dataset = read(path)
    assert integrate(dataset, "1", "all")[-1].value == pytest.approx(outline, rel=1e-12)


def test_duplicate_elements_are_named(tmp_path):
    places, nodes = unit_cubes(2)
    blocks = [ExodusBlock("one", "HEX8", nodes), ExodusBlock("other", "HEX8", nodes[1:])]
    found = read(write_classic(tmp_path / "twice.e", blocks, places)).remarks[-1]
    assert "1 elements have the corners of another one and 1 faces belong to more than two elements" in found
    blocks = [ExodusBlock("square", "QUAD4", nodes[:, :4]), ExodusBlock("half", "TRI3", nodes[:1, :3])]
    found = read(write_classic(tmp_path / "plane.e", blocks, places[:, :2])).remarks
    assert "1 edges belong to more than two elements" in found[-1]
    # a surface whose parts meet at one edge is none of these
    pages = [ExodusBlock("pages", "SHELL4", np.concatenate([nodes[:, :4], nodes[:1, [0, 1, 5, 4]]]))]
    assert len(read(write_classic(tmp_path / "pages.e", pages, places)).remarks) == 1


def test_faces_of_a_deep_layer_at_a_wall_are_not_doubtful():
    """Elements are a hundred times as deep as wide: the enlarged boxes of wall faces hold many faces of the sides."""
    corners = cells((0, 0, 0), (0.4, 0.03, 2), (40, 3, 1))
    reference = {"hexahedron": 2 * UNIT - 1}
    dataset = from_arrays({"hexahedron": corners}, {"u": {"hexahedron": corners[..., 0]}}, reference=reference)
    assert not with_interfaces(dataset, dataset.mesh.composites[-1].name, precision=1e-16).warnings


def test_small_sides_of_a_periodic_mortar_are_counted_once(tmp_path):
    """They are listed with the big side as well, with its boundary condition."""
    (path,), _ = two_mortars(tmp_path)
    with h5py.File(path, "r+") as file:
        sides = np.asarray(file["SideInfo"])
        sides[np.abs(sides[:, 0]) == 104, 4] = 1
        file["SideInfo"][...] = sides
    assert not any("skipped" in remark for remark in read(path, cache=False).remarks)


@pytest.mark.parametrize(("count", "is_examined"), [(4, True), (8, False)])
def test_sides_of_a_broken_mesh_stay_undecided(monkeypatch, count, is_examined):
    """If all sides may coincide, there is a sentence, and no search at many points, or at any, of each side."""
    counts = []

    def counted(sides, which, world):
        counts.append(len(which))
        return feet(sides, which, world)

    monkeypatch.setattr(hanging, "feet", counted)
    corners = 2 * UNIT - 1
    nested = corners * (1 - 0.01 * np.arange(count))[:, None, None]
    fields = {"u": {"hexahedron": nested[..., 0]}}
    dataset = from_arrays({"hexahedron": nested}, fields, reference={"hexahedron": corners})
    counts.clear()
    found = with_interfaces(dataset, dataset.mesh.composites[-1].name, precision=0.05)
    assert (sum(counts[:1]) > 0) == is_examined
    assert sum(counts[1:]) == 0
    assert found.warnings[0].startswith(f"{6 * count} faces may lie on faces of other elements")


def test_memory_of_tangled_elements_is_in_proportion_to_their_number():
    """Boxes of almost all pairs of sides overlap."""
    random = np.random.default_rng(3)
    reference = {"tetrahedron": Shape.TETRAHEDRON.vertices}
    peaks = []
    for count in (150, 450):
        corners = random.random((count, 4, 3))
        dataset = from_arrays({"tetrahedron": corners}, {"u": {"tetrahedron": corners[..., 0]}}, reference=reference)
        tracemalloc.start()
        found = with_interfaces(dataset, dataset.mesh.composites[-1].name, precision=1e-16)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        doubtful, _, _ = found.warnings[0].partition(" faces may lie on faces of other elements")
        assert int(doubtful) > 0.99 * 4 * count
    assert peaks[1] < 3 * peaks[0]


@pytest.mark.parametrize(("size", "share"), [(1.0, 0.9), (0.8, 0.2)])
def test_hopeless_sides_found_quickly_are_those_of_the_search(size, share):
    """Sides that are compared with some others nearby are a part of those that the search leaves undecided."""
    random = np.random.default_rng(5)
    corners = 3 * random.random((400, 1, 3)) * (1 - size) + size * random.random((400, 4, 3))
    reference = {"tetrahedron": Shape.TETRAHEDRON.vertices}
    dataset = from_arrays({"tetrahedron": corners}, {"u": {"tetrahedron": corners[..., 0]}}, reference=reference)
    sides = side_set(dataset, np.ones(dataset.mesh.of(Shape.TRIANGLE).ids.size, bool))
    search = hanging._Search(sides, np.arange(len(sides)), np.zeros(len(sides), bool), True, 1e-16)
    quick = search.hopeless()
    _, touched, covered = search.contacts(search.possible(np.zeros(len(sides), bool)), 0)
    assert touched[quick].all()
    assert search.is_crowded[quick].all()
    assert not covered[quick].any()
    assert share * len(sides) < quick.sum() < len(sides)
