"""Sound files to be damaged: tiny ones that are made here, and the solvers' own that lie next to the repository."""

import json
import math
import struct
import sys
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

SHARED = Path(__file__).resolve().parents[3] / "shared" / "data"


@dataclass(frozen=True)
class Subject:
    """Files that are read together, and how: names of functions of `reading`, one of which is taken for each case."""

    reader: str
    files: tuple[Path, ...]
    actions: tuple[str, ...]

    @property
    def size(self):
        return sum(path.stat().st_size for path in self.files)

    @property
    def name(self):
        return f"{self.files[0].parent.name}/{self.files[0].name}"


DATA = ("evaluated", "described", "checked", "converted")
NATIVE = (".xml", ".fld", ".nekg", ".rst", ".chk")
SOLVERS = {
    "cgns": (("gmsh_mixed_o2.cgns",), ("gmsh_ball_tet_o3.cgns",)),
    "exodus": (
        ("simple-cube-tet10.e",),
        ("simple-cube-hex27.e",),
        ("simple-cube-multi-element-order2.e",),
        ("cylinder-hex-q2.gen",),
    ),
    "gmf": (
        ("ball_tetP3_sol4.meshb", "ball_tetP3_sol4.solb"),
        ("ball_tetP3_sol4_ascii.mesh", "ball_tetP3_sol4_ascii.sol"),
    ),
    "gmsh": (("mixed_o2_v22.msh",), ("mixed_o3.msh",), ("ball_tet_o2_p5.msh",)),
    "hopr_flexi": (
        ("cavity4x4x4_mesh.h5",),
        ("cavity4x4x4_mesh.h5", "reggie_cavity_Re100_State_0000001.000000000.h5"),
        ("pyhope_1-11-cartbox_mixed_mesh.h5",),
        ("convcurved_N4_State.h5", "convcurved_N4_mesh.h5"),
        ("NACA0012_652_Ng2_mesh.h5", "NACA0012_Re5000_AoA8_3D_Referenz_0000010.000000000.h5"),
    ),
    "mfem": (
        ("tinyzoo.mesh", "tinyzoo.u.gf", "tinyzoo.v.gf"),
        ("pipe_nurbs.mesh", "pipe_nurbs.u.gf"),
        ("fichera_q3.mesh", "fichera_q3.u.gf"),
        ("escher_p3.mesh", "escher_p3.w.gf"),
        ("stream_laghos.mesh", "stream_laghos.f.gf"),
        ("fichera_mixed_p2.mesh", "fichera_mixed_p2.u.gf"),
    ),
    "nek5000": (
        ("nek_io_test_m12io_test0.f00001",),
        ("ethier.nek5000", "ethier0.f00001", "ethier.re2"),
    ),
    "ngsolve": (
        ("hexprism_p3_hex.elems.npz",),
        ("hexprism_p3_prism.elems.npz",),
        ("ballbox_p4.elems.npz",),
        ("ballbox_p4.vol",),
    ),
    "pyfr": (
        ("mixed3d_p3.pyfrm",),
        ("mixed3d_p3.pyfrm", "mixed3d_p3-00.pyfrs"),
        ("mixed3d_p3.pyfrm", "mixed3d_p3-01.pyfrs"),
    ),
    "vtk": (
        ("dealii_shell_p4.vtu",),
        ("mfem_escher_p3.vtu",),
        ("mfem_fichera_q3.vtu",),
        ("mfem_fichera_mixed_p2.vtu",),
        ("pyfr_mixed3d_p3.vtu",),
        ("dolfinx_tet_o3_u.pvd", "dolfinx_tet_o3_u000000.pvtu", "dolfinx_tet_o3_u_p0_000000.vtu"),
    ),
}
#: live bridges, and the functions of `reading` that call them
BRIDGES = {
    "live blueprint": "bridged_blueprint",
    "live arrays": "bridged_arrays",
    "live ngsolve": "bridged_ngsolve",
    "live mfem": "bridged_mfem",
}
NAMES = {"hopr_flexi": "hopr", "nek5000": "nek"}


def subjects(folder, readers):
    """The subjects of some readers; what is made here is put into a folder."""
    makers = {
        native: ("native XML", "native HDF5"),
        volumes: ("fourier", "nurbs"),
        converted: ("vtk", "vtkhdf", "gmsh", "nek", "elvisdat", "gmf", "mfem"),
        cgns: ("cgns",),
        trixi: ("trixi",),
        horses: ("horses",),
        exodus: ("exodus",),
        bridges: BRIDGES,
        vtx: ("vtx",),
        others: ("scene toml", "scene yaml", "scene json", "palette", "triangles", "points", "record", "messages"),
    }
    made = [each for make, names in makers.items() if set(names) & set(readers) for each in make(folder)]
    return made + (shared() if SHARED.is_dir() else [])


def shared():
    """The files of solvers."""
    found = []
    for case in sorted(path for path in (SHARED / "nektar").iterdir() if path.is_dir()):
        files = tuple(sorted(path for path in case.iterdir() if path.suffix in NATIVE and path.is_file()))
        files = tuple(path for path in files if "zVariation" not in path.name)
        is_hdf5 = any(path.suffix == ".nekg" or path.read_bytes()[:4] == b"\x89HDF" for path in files)
        if files:
            found.append(Subject("native HDF5" if is_hdf5 else "native XML", files, DATA))
    for folder, cases in SOLVERS.items():
        for names in cases:
            files = tuple(SHARED / "solvers" / folder / name for name in names)
            found.append(Subject(NAMES.get(folder, folder), files, ("converted",)))
    pipe = SOLVERS["mfem"][1]
    found.append(Subject("nurbs", tuple(SHARED / "solvers" / "mfem" / name for name in pipe), ("opened",)))
    return found


def dataset(mesh, bend=0.05):
    """A small curved mesh with two fields."""
    from elvis.core.data.dataset import Dataset
    from elvis.core.testing import approximated, curved, ripple

    whole = Dataset(curved(mesh, ripple(bend), 3))
    functions = {"u": lambda x: x[:, 0] ** 2 + x[:, 1], "v": lambda x: x[:, 0] - x[:, -1]}
    fields = tuple(approximated(whole, name, function, 3) for name, function in functions.items())
    return replace(whole, fields=fields, time=0.5, metadata={"Provenance": "made"})


def meshes():
    from elvis.core.shapes import Shape
    from elvis.core.testing import grid, mixed_plane, mixed_volume

    return {"volume": mixed_volume(3), "plane": mixed_plane(1), "cube": grid(Shape.HEXAHEDRON, 1)}


def native(folder):
    """Meshes of all shapes, in each form of the format."""
    from elvis import write

    for name, mesh in meshes().items():
        whole = dataset(mesh)
        for form in ("compressed", "text", "hdf5"):
            files = write(
                whole, folder / f"{name}_{form}.xml", mesh_format=form, field_format="hdf5" if form == "hdf5" else "xml"
            )
            yield Subject("native HDF5" if form == "hdf5" else "native XML", tuple(map(Path, files)), DATA)


def volumes(folder):
    """What runtime plugins open: a Fourier box, NURBS."""
    from elvis.plugins.fourier.box import write_box

    amplitudes = np.arange(12.0).reshape(3, 2, 2)
    write_box(folder / "box.npz", np.zeros(3), np.ones(3), ("fourier", "fourier", "legendre"), {"u": amplitudes}, 0.5)
    yield Subject("fourier", (folder / "box.npz",), ("opened",))
    flat = [0, 0, 1, 1]
    points = [[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 0.5, 1)]
    patch = {"degrees": [2, 1, 1], "knots": [[0, 0, 0, 1, 1, 1], flat, flat], "points": points}
    patch |= {"weights": [1, 0.7, 1] * 4, "fields": {"p": list(range(12))}}
    table = {
        "format": "elvis-nurbs",
        "version": 1,
        "time": 0.5,
        "patches": [patch],
        "boundaries": {"wall": [[0, "z-"]]},
    }
    (folder / "arc.json").write_text(json.dumps(table))
    yield Subject("nurbs", (folder / "arc.json",), ("opened",))


def converted(folder):
    """Small files of other programs."""
    for name in ("volume", "plane"):
        whole = dataset(meshes()[name])
        yield Subject("vtk", (exported_vtu(whole, folder / f"{name}.vtu"),), ("converted",))
        yield Subject("gmsh", (exported_msh(whole, folder / f"{name}.msh"),), ("converted",))
    yield Subject("vtkhdf", (vtkhdf(folder / "tiny.vtkhdf"),), ("converted",))
    yield Subject("vtkhdf", apart(folder / "whole.vtkhdf", folder / "whole_part0.vtkhdf"), ("converted",))
    (folder / "tiny0.f00001").write_bytes(nek())
    yield Subject("nek", (folder / "tiny0.f00001",), ("converted",))
    (folder / "tiny.dat").write_bytes(elvisdat())
    yield Subject("elvisdat", (folder / "tiny.dat",), ("converted",))
    (folder / "tiny.mesh").write_text(GMF)
    yield Subject("gmf", (folder / "tiny.mesh",), ("converted",))
    (folder / "tiny.vtk").write_text(LEGACY)
    yield Subject("vtk", (folder / "tiny.vtk",), ("converted",))
    (folder / "tet.mesh").write_text(MFEM)
    yield Subject("mfem", (folder / "tet.mesh",), ("converted",))
    for name, text in MFEM_FUNCTIONS.items():
        (folder / name).write_text(text)
        yield Subject("mfem", (folder / "tet.mesh", folder / name), ("converted",))


def cgns(folder):
    """Tiny CGNS files in both containers: a structured zone, and elements of two types in a section of many."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
    import cgns_writing as writing

    points = writing.grid(3, 3, 2)
    names = writing.node("FlowSolutionPointers", "DataArray_t", ["A", "B"])
    steps = writing.node("ZoneIterativeData", "ZoneIterativeData_t", None, names)
    flows = [writing.solution(name, None, {"u": points @ [1.0, 2, 3]}) for name in "AB"]
    wall = writing.condition("wall", "PointRange", [(1, 1, 1), (1, 3, 2)], None, "Wall")
    box = writing.structured("Box", points, *flows, steps, writing.conditions(wall))
    times = writing.node("TimeValues", "DataArray_t", np.array([0.5, 1.5]))
    iterative = writing.node("Steps", "BaseIterativeData_t", np.array([2], np.int32), times)
    structured = [writing.base(iterative, writing.node("Wall", "Family_t"), box)]
    corners = writing.grid(2, 2, 2).reshape(-1, 3)
    table = [[0, 4, 6, 2, 1, 5, 7, 3]]
    cells = writing.mixed("Cells", 1, [(17, table), (7, [[0, 2, 6, 4]])], True)
    floor = writing.condition("floor", "PointList", [[2]], "FaceCenter")
    way = writing.node("InterpolationType", "InterpolationType_t", "ParametricMonomialsPascal")
    family = writing.node(
        "F", "Family_t", None, writing.node("Way", "SolutionInterpolation_t", np.array([17, 1, 0], np.int32), way)
    )
    degrees = writing.node("InterpolationDegrees", "IndexArray_t", np.array([1, 0], np.int32))
    high = writing.solution("High", "InterpolationPoints", {"u": np.arange(4.0)}, None, degrees)
    unstructured = [
        writing.base(family, writing.unstructured("Zone", corners, 1, cells, writing.conditions(floor), high))
    ]
    for name, tree in (("structured", structured), ("unstructured", unstructured)):
        yield Subject("cgns", (writing.write_hdf5(folder / f"{name}.cgns", tree, 4.2),), ("converted",))
        for order in "<>":
            path = folder / f"{name}_{'AB'[order == '<']}.adf"
            yield Subject("cgns", (writing.write_adf(path, tree, 3.3, order == ">", order),), ("converted",))


def trixi(folder):
    """Tiny files of Trixi.jl: a tree, a structured mesh, forests of both kinds, two curved quadrilaterals."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
    import h5py
    import trixi_writer as writing

    def subject(kind, mesh, places, *others):
        functions = {"u": lambda x: x[..., 0]}
        path = writing.write_solution(mesh.with_name(f"s_{kind}.h5"), mesh, kind, places, functions, 1)
        return Subject("trixi", (path, mesh, *others), ("converted",))

    def refine(level, corner):
        return level < 1 and not corner.any()

    tree = folder / "tree.h5"
    corners = writing.write_tree_mesh(tree, refine, 2, (0, 0), 2, (True, False))
    inside = (writing.reference_nodes([-1, 1], 2) + 1) / 2
    yield subject("TreeMesh", tree, corners[:, None, 0] + inside * (corners[:, 1] - corners[:, 0])[:, None])
    structured = folder / "structured.h5"
    writing.write_structured_mesh(structured, (2, 1), "mapping(x, y) = (2x + 0.1y^2, sin(y))", (False, False))
    yield subject("StructuredMesh", structured, np.zeros((2, 4, 2)))
    for kind in ("P4estMesh", "T8codeMesh"):
        (folder / kind).mkdir()
        brick = writing.Brick((2, 1), lambda s: s, 1, lambda tree: refine if tree else lambda *_: False)
        mesh = brick.write(folder / kind / "mesh.h5", kind)
        yield subject(kind, mesh, brick.nodes(1), *mesh.parent.glob("p4est_data"))
    plane, mesh = folder / "two.mesh", folder / "plane.h5"
    curve = [[1, 1], [0.5, 1.2], [0, 1]][::-1]
    elements = [((0, 1, 3, 2), {2: curve}, ("floor", "east", "roof", "west"))]
    writing.write_plane_mesh(plane, 2, [(0, 0), (1, 0), (0, 1), (1, 1)], elements)
    with h5py.File(mesh, "w") as file:
        file.attrs["mesh_type"], file.attrs["ndims"], file.attrs["mesh_filename"] = "UnstructuredMesh2D", 2, "two.mesh"
    yield subject("UnstructuredMesh2D", mesh, np.zeros((1, 4, 2)), plane)


def horses(folder):
    """Tiny files of HORSES3D: two hexahedra of different orders with values, a sensor and sources, and boundaries."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
    import horses_writer as writing

    counts = [(2, 2, 2), (2, 3, 2)]
    maps = writing.boxes((2, 1, 1), lambda x: x)
    places = [own(writing.nodes_of(1, count)) for own, count in zip(maps, counts, strict=True)]
    mesh = writing.write_horses(folder / "two.hmesh", 1, 1, [(c, [x]) for c, x in zip(counts, places, strict=True)])
    zones = writing.write_zones(folder / "two.bmesh", [("west", [1], [6]), ("east", [2], [4])])
    values = [(c, ([x[:, [0] * 5]], [x[:, [0] * 5]])) for c, x in zip(counts, places, strict=True)]
    path = writing.write_horses(folder / "two.hsol", 9, 1, values, [0.5, 1.5])
    yield Subject("horses", (mesh, path, zones), ("converted",))


def exodus(folder):
    """Pieces of a run of two processes in both containers, with values at nodes and on elements of one block."""
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
    from exodus_writer import ExodusBlock, unit_cubes, write_classic, write_hdf5

    for name, write in (("classic", write_classic), ("hdf5", write_hdf5)):
        paths = []
        for rank, sides in enumerate(({"inflow": [(1, 4)]}, {"outflow": [(2, 2)]})):
            places, nodes = unit_cubes(2, 2 * rank)
            blocks = [ExodusBlock("fluid", "HEX8", nodes[:1]), ExodusBlock("solid", "HEX8", nodes[1:])]
            numbers = {"node_num_map": 8 * rank + 1 + np.arange(len(places))}
            nodal, on_elements = {"u": places @ [1.0, 2, 3]}, {"c": {2: [0.5]}}
            path = folder / f"{name}.e.2.{rank}"
            paths.append(write(path, blocks, places, sides, nodal, on_elements, numbers, 0.5))
        yield Subject("exodus", tuple(paths), ("converted",))


def bridges(folder):
    """The seeds of calls of live bridges."""
    sys.path.insert(0, str(Path(__file__).parent))
    from bridges import SOUND

    for reader, action in BRIDGES.items():
        path = folder / f"{action}.seed"
        path.write_bytes(SOUND)
        yield Subject(reader, (path,), (action,))


def vtx(folder):
    """A folder of ADIOS2's, where its library is there: two steps of squares in two blocks."""
    if find_spec("adios2") is None:
        return
    sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "support"))
    import vtx_writer as writing

    nodes = writing.vtx_nodes(70, 2, True)
    ids = np.arange(2 * len(nodes)).reshape(2, 1, -1)
    cells = [[nodes], [nodes + np.array([1, 0, 0])]]
    arrays = writing.vtx_blocks(cells, ids, {"u": lambda x: x[:, 0]})
    steps = [(0.5, arrays), (1.5, {"u": arrays["u"]})]
    path = writing.write_vtx(folder / "u.bp", 70, steps, writing.schema_of(["u"], []))
    names = ("md.idx", "md.0", "mmd.0", "data.0")
    yield Subject("vtx", tuple(path / name for name in names), ("converted",))


def vtkhdf(path):
    """A triangle and a square in two parts, at two steps."""
    import h5py

    with h5py.File(path, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs.create("Type", np.bytes_("UnstructuredGrid"))
        root["NumberOfPoints"], root["NumberOfCells"] = [4, 3] * 2, [1, 1] * 2
        root["NumberOfConnectivityIds"] = [4, 3] * 2
        square, triangle = [[0, 0], [1, 0], [1, 1], [0, 1]], [[1, 0], [2, 0], [1, 1]]
        root["Points"] = np.array([[*place, 0.0] for place in (square + triangle) * 2])
        root["Connectivity"], root["Offsets"] = [0, 1, 2, 3, 0, 1, 2], [0, 4, 0, 3]
        root["Types"] = np.array([9, 5], np.uint8)
        root["PointData/u"], root["CellData/c"] = np.arange(14.0), np.arange(4.0)
        steps = root.create_group("Steps")
        steps["Values"], steps["NumberOfParts"], steps["PartOffsets"] = [0.5, 1.5], [2, 2], [0, 2]
        steps["PointOffsets"], steps["CellOffsets"], steps["ConnectivityIdOffsets"] = [0, 7], [0, 0], [0, 0]
        steps["PointDataOffsets/u"], steps["CellDataOffsets/c"] = [0, 7], [0, 2]
    return path


def apart(path, part):
    """The same with virtual arrays whose rows lie in another file."""
    import h5py

    with h5py.File(vtkhdf(part)) as source, h5py.File(path, "w") as file:
        root = file.create_group("VTKHDF")
        root.attrs.update(source["VTKHDF"].attrs)

        def add(name, member):
            if isinstance(member, h5py.Dataset):
                layout = h5py.VirtualLayout(member.shape, member.dtype)
                layout[...] = h5py.VirtualSource(part.name, f"VTKHDF/{name}", member.shape)
                root.create_virtual_dataset(name, layout)

        source["VTKHDF"].visititems(add)
    return path, part


def exported_vtu(whole, path):
    from elvis.converters.shared.exporting import exported
    from elvis.converters.vtk.export import VtkTarget, write_vtu

    write_vtu(path, exported(whole, None, None, VtkTarget()), whole.time)
    return path


def exported_msh(whole, path):
    from elvis.converters.gmsh.export import GmshTarget, write_msh
    from elvis.converters.shared.exporting import exported

    with GmshTarget() as target:
        write_msh(path, exported(whole, None, None, target), whole.mesh, target, whole.time)
    return path


CUBE = [[x, y, z] for z in (-1.0, 1.0) for y in (-1.0, 1.0) for x in (-1.0, 1.0)]
GMF = """MeshVersionFormatted 2
Dimension 3
Vertices
5
0 0 0 1
1 0 0 1
0 1 0 1
0 0 1 1
1 1 1 1
Tetrahedra
2
1 2 3 4 1
2 3 4 5 2
Triangles
1
1 2 3 7
End
"""
LEGACY = """# vtk DataFile Version 3.0
a tetrahedron
ASCII
DATASET UNSTRUCTURED_GRID
POINTS 4 double
0 0 0 1 0 0 0 1 0 0 0 1
CELLS 1 5
4 0 1 2 3
CELL_TYPES 1
10
POINT_DATA 4
SCALARS u double 1
LOOKUP_TABLE default
0 1 2 3
CELL_DATA 1
SCALARS rank int 1
LOOKUP_TABLE default
1
"""
MFEM = """MFEM mesh v1.0
dimension
3
elements
1
1 4 0 1 2 3
boundary
1
3 2 0 1 2
vertices
4
3
0 0 0
1 0 0
0 1 0
0 0 1
"""


MFEM_FUNCTIONS = {
    "tet.q.qf": "QuadratureSpace\nType: default_quadrature\nOrder: 2\nVDim: 1\n\n1\n2\n3\n4\n",
    "tet.c.gf": "ComplexGridFunction\nFiniteElementSpace\nFiniteElementCollection: H1_3D_P1\nVDim: 1\nOrdering: 0\n\n"
    + "1\n" * 4
    + "2\n" * 4,
}


def nek():
    """A field of two elements of order 2 with velocity and pressure."""
    line = np.linspace(-1, 1, 3)
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    places = np.stack([x, y, z]).reshape(3, -1)
    head = "#std 8  3  3  3          2          2  0.5000000000000E+00         1      0      1 XUP"
    records = [
        np.stack([places, places + np.array([[2.0], [0.0], [0.0]])]),
        np.stack([places**2] * 2),
        np.stack([places[:1]] * 2),
    ]
    numbers = np.concatenate([record.reshape(-1) for record in records])
    tag = struct.pack("<f", 6.54321)
    return head.ljust(132).encode() + tag + np.array([1, 2], "<i4").tobytes() + numbers.astype("<f8").tobytes()


def elvisdat():
    """A hexahedron of the first ElVis."""
    count = 8
    parts = [np.array([1, 1], ">i4"), np.array([-1.0, 1.0], ">f8"), np.array(CUBE, ">f8")]
    parts += [np.array([1, 1, 1], ">i4"), np.arange(count).astype(">f8")]
    return b"a volume of elements    " + np.array([1, 1], ">i4").tobytes() + b"".join(p.tobytes() for p in parts)


def others(folder):
    """Scenes in three languages, colour maps, triangles in four formats, points, records."""
    import trimesh

    from elvis.reference.record import CHANNELS
    from elvis.scene.model.files import read_scene, write_scene

    (folder / "scene.toml").write_text(SCENE)
    scene = read_scene(folder / "scene.toml")
    for suffix in ("yaml", "json"):
        write_scene(scene, folder / f"scene.{suffix}")
    for suffix in ("toml", "yaml", "json"):
        yield Subject(f"scene {suffix}", (folder / f"scene.{suffix}",), ("staged",))
    (folder / "rainbow.xml").write_text(PALETTE)
    yield Subject("palette", (folder / "rainbow.xml",), ("coloured",))
    ball = trimesh.creation.icosphere(subdivisions=1)
    for suffix in ("stl", "ply", "obj", "glb"):
        ball.export(folder / f"ball.{suffix}")
        yield Subject("triangles", (folder / f"ball.{suffix}",), ("triangulated",))
    ball.export(folder / "text.stl", file_type="stl_ascii")
    ball.export(folder / "text.ply", encoding="ascii")
    yield Subject("triangles", (folder / "text.stl",), ("triangulated",))
    yield Subject("triangles", (folder / "text.ply",), ("triangulated",))
    (folder / "points.csv").write_text("x,y,z\n" + "".join(f"{i / 7},{i},{math.sin(i)}\n" for i in range(20)))
    (folder / "points.txt").write_text("".join(f"{i / 7} {i} {math.sin(i)}\n" for i in range(20)))
    yield Subject("points", (folder / "points.csv",), ("placed",))
    yield Subject("points", (folder / "points.txt",), ("placed",))
    for number, message in enumerate(MESSAGES):
        (folder / f"message{number}.json").write_text(json.dumps(message))
        yield Subject("messages", (folder / f"message{number}.json",), ("received",))
    pixels = {name: np.ones((4, 5, depth) if depth else (4, 5)) for name, depth in CHANNELS.items()}
    for name, save in (("record.npz", np.savez_compressed), ("stored.npz", np.savez)):
        save(folder / name, **pixels)
        yield Subject("record", (folder / name,), ("recalled",))


#: messages of pages, one of each kind
MESSAGES = (
    {"type": "shown"},
    {"type": "change", "changes": {"camera": "+x", "objects[0].style.opacity": 0.5, "title": None}, "moving": True},
    {"type": "size", "size": [900.5, 700]},
    {"type": "paper", "color": [0.1, 0.1, 0.2]},
    {"type": "hide", "key": "objects[0]"},
    {"type": "forget", "number": 0},
    {"type": "undo"},
    {"type": "proof", "on": True},
    {"type": "read again"},
    {"type": "linear", "id": 1, "content": {"level": 2}},
    {"type": "pick", "id": 2, "content": {"row": 10, "column": 20, "number": 3}},
    {"type": "line", "id": 3, "content": {"start": [0, 0, 0.5], "end": [1, 0, 0], "quantities": ["u", "d(u,x)"]}},
    {"type": "history", "id": "4", "content": {"quantity": "u", "place": [0.1, 0.2]}},
    {"type": "section", "id": 9, "content": {"place": [0, 0, 1], "quantities": ["u"], "axis": "z"}},
    {"type": "other", "id": 10, "content": {"name": "other", "draft": True}},
    {"type": "histogram", "id": 5, "content": "u"},
    {"type": "seen", "id": 6, "content": None},
    {"type": "depths", "id": 11, "content": None},
    {"type": "copy", "id": 7, "content": "Python"},
    {"type": "write", "id": 8, "content": {"name": "a.png", "confirmed": False}},
)
SCENE = """field = "u"
size = [200, 100]
range = [-1.0, 2.5]
palette = "plasma"
samples = 2
ambient = 0.45
title = "a scene"
camera = { eye = [-1.9, 2.6, 1.7], at = [0.95, 0.14, 0.13], up = [0, 0, 1], fov = 19 }

[[objects]]
kind = "faces"
select = ["wing"]
style = { color = [0.75, 0.77, 0.8] }

[[objects]]
kind = "isosurface"
values = [-0.8]
style = { quantity = "u^2 + v", palette = "plasma", range = [0.9, 1.25] }

[[objects]]
kind = "cut"
surface = { kind = "plane", point = [0, 0, 0], normal = [1, 0, 0] }
"""
PALETTE = """<ColorMap name="Rainbow" space="RGB">
  <Point x="0" o="0.5" r="0" g="0" b="1"/>
  <Point x=".25" o="0.5" r="0" g="1" b="1"/>
  <Point x=".5" o="0.5" r="0" g="1" b="0"/>
  <Point x="1" o="0.5" r="1" g="0" b="0"/>
  <NaN r="0.498039" g="0.498039" b="0.498039"/>
</ColorMap>
"""
