"""One small file of each format that is read: two unit cubes or squares side by side, with names, time and metadata.

Each function writes into a folder and returns the files; formats without names or times lack these.
"""

import h5py
import numpy as np
from cgns_writing import base, condition, conditions, grid, structured, write_hdf5
from exodus_writer import cubes_in_blocks, write_classic

from elvis.formats.nektar.xml import load, parse

NATIVE = """<NEKTAR>
 <Metadata><Author>someone</Author><Time>0.5</Time></Metadata>
 <GEOMETRY DIM="2" SPACE="2">
  <VERTEX><V ID="0">0 0 0</V><V ID="1">1 0 0</V><V ID="2">2 0 0</V><V ID="3">0 1 0</V><V ID="4">1 1 0</V>
   <V ID="5">2 1 0</V></VERTEX>
  <EDGE><E ID="0">0 1</E><E ID="1">1 2</E><E ID="2">3 4</E><E ID="3">4 5</E><E ID="4">0 3</E><E ID="5">1 4</E>
   <E ID="6">2 5</E></EDGE>
  <ELEMENT><Q ID="0">0 5 2 4</Q><Q ID="1">1 6 3 5</Q></ELEMENT>
  <COMPOSITE><C ID="0"> Q[0-1] </C><C ID="1"> E[4] </C><C ID="2"> E[0-3] </C><C ID="7" NAME="out"> E[6] </C>
   <C ID="8"> Q[1] </C> <!-- second half -->
  </COMPOSITE>
  <DOMAIN> C[0] </DOMAIN>
 </GEOMETRY>
 <EXPANSIONS><E COMPOSITE="C[0]" NUMMODES="3" TYPE="MODIFIED" FIELDS="u" /></EXPANSIONS>
 <CONDITIONS>
  <VARIABLES><V ID="0"> u </V></VARIABLES>
  <BOUNDARYREGIONS><B ID="0" NAME="inflow"> C[1] </B><B ID="1" NAME="far field, &amp; more"> C[2] </B>
   <B ID="2" NAME="ignored"> C[7] </B></BOUNDARYREGIONS>
  <BOUNDARYCONDITIONS><REGION REF="0"><D VAR="u" VALUE="y&lt;1" /></REGION></BOUNDARYCONDITIONS>
 </CONDITIONS>
 <FORCING><FORCE TYPE="Body" /></FORCING>
</NEKTAR>
"""

GMSH = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
4
1 1 "inflow"
1 2 "far field"
2 3 "solid"
2 4 "both"
$EndPhysicalNames
$Nodes
6
1 0 0 0
2 1 0 0
3 2 0 0
4 0 1 0
5 1 1 0
6 2 1 0
$EndNodes
$Elements
8
1 1 2 1 1 1 4
2 1 2 2 2 1 2
3 1 2 2 2 2 3
4 1 2 2 2 3 6
5 1 2 2 2 6 5
6 1 2 2 2 5 4
7 3 2 3 7 1 2 5 4
8 3 2 3 8 2 3 6 5
$EndElements
$NodeData
1
"u"
1
0.25
3
0
1
6
1 0
2 1
3 2
4 0
5 1
6 2
$EndNodeData
"""

MFEM = """MFEM mesh v1.3

dimension
2

elements
2
1 3 0 1 4 3
2 3 1 2 5 4

attribute_sets
2
"copper wire"
1
2
"steel"
1
1

boundary
6
1 1 0 1
1 1 1 2
3 1 4 3
3 1 5 4
4 1 3 0
2 1 2 5

bdr_attribute_sets
3
"all sides"
4
1 2 3 4
"in"
1
4
"wall"
2
1 3

vertices
6
2
0 0
1 0
2 0
0 1
1 1
2 1

mfem_mesh_end
"""

GMF = """MeshVersionFormatted 2
Dimension 2
Vertices
4
0 0 1
1 0 1
1 1 1
0 1 1
Edges
4
1 2 5
2 3 6
3 4 6
4 1 7
Triangles
2
1 2 3 1
1 3 4 2
End
"""

NETGEN = """mesh3d
dimension
2
geomtype
0
facedescriptors
1
1 0 0 1 1
surfaceelements
4
2 1 0 0 3 1 2 5
2 1 0 0 3 2 3 5
2 1 0 0 3 3 4 5
2 1 0 0 3 4 1 5
edgesegmentsgi2
4
1 0 1 2 -1 -1 1 0 1 0 1 0
2 0 2 3 -1 -1 1 0 2 0 2 0
3 0 3 4 -1 -1 1 0 3 0 3 0
4 0 4 1 -1 -1 1 0 4 0 4 0
points
5
0 0 0
2 0 0
2 2 0
0 2 0
1 1 0
materials
1
1 default
bcnames
4
1 in
2 default
3 default
4 out
endmesh
"""

#: corners of a unit cube as tensor products have them, x fastest
CUBE = np.array([(x, y, z) for z in (0.0, 1.0) for y in (0.0, 1.0) for x in (0.0, 1.0)])
NEXT = CUBE + np.array([1, 0, 0])


def cgns(folder):
    sides = [("left", [(1, 1, 1), (1, 2, 2)], "inflow"), ("right", [(3, 1, 1), (3, 2, 2)], "outflow")]
    own = conditions(*(condition(name, "PointRange", ends, None, family) for name, ends, family in sides))
    points = grid(3, 2, 2) * [2, 1, 1]
    return [write_hdf5(folder / "a.cgns", [base(structured("zone", points, own))], 4.2)]


def elvisdat(folder):
    numbers = [(">i4", [1, 1]), (">f8", [-1, 1]), (">f8", CUBE[[0, 1, 3, 2, 4, 5, 7, 6]]), (">i4", [1, 1, 1])]
    numbers += [(">f8", np.arange(8.0))]
    body = b"".join(np.asarray(values).astype(code).tobytes() for code, values in [(">i4", [1, 1]), *numbers])
    (folder / "a.dat").write_bytes(b"a volume of elements    " + body)
    return [folder / "a.dat"]


def exodus(folder):
    return [cubes_in_blocks(folder / "a.e", write_classic, [1, 1], nodal={"u": np.arange(12.0)}, time=0.75)]


def hopr(folder):
    elements = np.array([CUBE, NEXT])
    places, numbers = np.unique(elements.reshape(-1, 3), axis=0, return_inverse=True)
    # of each element the sides z-, y-, x+, y+, x-, z+: type, number, neighbour, its local side and flip, condition
    first = [[4, 1, 0, 0, 1], [4, 2, 0, 0, 1], [4, 3, 2, 50, 0], [4, 4, 0, 0, 1], [4, 5, 0, 0, 2], [4, 6, 0, 0, 1]]
    second = [[4, 7, 0, 0, 1], [4, 8, 0, 0, 1], [4, 9, 0, 0, 3], [4, 10, 0, 0, 1], [4, -3, 1, 30, 0], [4, 11, 0, 0, 1]]
    facts = {"Ngeo": 1, "nElems": 2, "nSides": 12, "nNodes": 16, "nUniqueNodes": len(places), "nUniqueSides": 11}
    with h5py.File(folder / "a_mesh.h5", "w") as file:
        for key, value in (facts | {"nBCs": 3}).items():
            file.attrs[key] = np.array([value], "i4")
        file.attrs["Version"] = np.array([1.0])
        file["ElemInfo"] = np.array([[108, 1, 0, 6, 0, 8], [108, 1, 6, 12, 8, 16]], "i4")
        file["SideInfo"] = np.array([*first, *second], "i4")
        file["NodeCoords"], file["GlobalNodeIDs"] = elements.reshape(-1, 3), (numbers.reshape(-1) + 1).astype("i4")
        file["BCNames"] = np.array([name.ljust(255) for name in ("wall", "in", "out")], "S255")
        file["BCType"] = np.array([[4, 0, 0, 0], [2, 0, 0, 0], [2, 0, 0, 0]], "i4")
    return [folder / "a_mesh.h5"]


def native(folder):
    (folder / "a.xml").write_text(NATIVE)
    return [folder / "a.xml"]


def nek(folder):
    head = f"#std 8 {2:2d} {2:2d} {2:2d} {2:10d} {2:10d} {0.5:20.13E} {3:9d} {0:6d} {1:6d} {'XP':10s} {0:14.7E} F"
    body = np.array([6.54321], "<f4").tobytes() + np.array([1, 2], "<i4").tobytes()
    body += np.array([CUBE.T, NEXT.T]).tobytes() + np.arange(16.0).tobytes()
    (folder / "a0.f00001").write_bytes(head.ljust(132).encode() + body + bytes(4 * 2 * 8))
    return [folder / "a0.f00001"]


def pyfr(folder):
    sides = [(b"hex", 0, face, 0) for face in (0, 1, 3, 4, 5)] + [(b"hex", 1, face, 0) for face in (0, 1, 3, 5)]
    with h5py.File(folder / "a.pyfrm", "w") as file:
        file["mesh_uuid"] = np.bytes_("1234")
        file["spt_hex_p0"] = np.array([CUBE, NEXT]).transpose(1, 0, 2)
        file["bcon_wall_p0"] = np.array(sides, dtype="S4,i4,i1,i2")
        file["bcon_out_p0"] = np.array([(b"hex", 1, 2, 0)], dtype="S4,i4,i1,i2")
    return [folder / "a.pyfrm"]


def vtk(folder):
    from vtk_writer import grid as cells
    from vtk_writer import write
    from vtkmodules.util.numpy_support import numpy_to_vtk

    points = np.concatenate([CUBE, NEXT])
    found = cells(points, [(11, range(8)), (11, range(8, 16))], {"u": points[:, 0]})
    stamp = numpy_to_vtk(np.array([0.125]), deep=True)
    stamp.SetName("TimeValue")
    found.GetFieldData().AddArray(stamp)
    return [write(folder / "a.vtu", found)]


def text_file(name, content):
    def write(folder):
        (folder / name).write_text(content)
        return [folder / name]

    return write


#: functions by the name of the reader, and the package that it needs
SMALL_FILES = {
    "cgns": (cgns, ""),
    "elvisdat": (elvisdat, ""),
    "exodus": (exodus, "scipy"),
    "gmf": (text_file("a.mesh", GMF), ""),
    "gmsh": (text_file("a.msh", GMSH), "gmsh"),
    "hopr": (hopr, ""),
    "mfem": (text_file("a.mesh", MFEM), "mfem"),
    "native": (native, ""),
    "nek": (nek, ""),
    "ngsolve": (text_file("a.vol", NETGEN), "ngsolve"),
    "pyfr": (pyfr, ""),
    "vtk": (vtk, "vtkmodules"),
}


def sections(path):
    """The sections of a session but mesh and expansions, blanks taken together."""
    (root,) = parse(load(path), str(path))
    own = {child.tag: " ".join(child.source.split()) for child in root.children()}
    return {tag: text for tag, text in own.items() if tag not in ("GEOMETRY", "EXPANSIONS", "Metadata")}
