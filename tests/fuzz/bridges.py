"""Calls of the live bridges with damaged arguments: a file of a few bytes is the seed of what is wrong with them.

The sound file makes the sound call, so that the harness damages, repeats and keeps calls as it does files.
"""

import copy
import random
from functools import cache

import numpy as np

#: the content of the file that makes the sound call
SOUND = b"sound call\n"
#: what takes the place of an argument or a part of one
ODD = [
    None, "", "x", -1, 0, 1, 2**31, 2**63, 2**70, 1e308, float("nan"), float("inf"), True, [], {}, [[]], "u", "main",
    "edge", "nodes", "quad", "hex", "tet", "mixed", "quadrilateral", "pyramid", "H1_2D_P1", "H1_2D_P40",
    "H1_2D_P1000000", "H1_3D_P2", "L2_T9_2D_P1", "NURBS9", "ND_2D_P1", "RT_2D_P0", "QF_Default_1", "H1Pos_2D_P3",
    "../../x", "a\nvertices\n1000000000", "\0", "\x1b[2J", "y" * 100_000, np.zeros((2, 3)), np.array(["a"]), object(),
    b"bytes", 1 + 2j, list(range(1000)), np.zeros(10**6), {"x": [1.0]}, {"x": {"y": {}}}, np.array(5.0), np.zeros(0),
    [None], ["a", 1], -(2**63), np.full((1, 4, 2), np.nan), np.zeros((1, 4, 2)), np.zeros((1, 4), complex),
    np.zeros((1, 10**5, 3)), np.array([[None, 1, 2, 3]]), np.array([["1", "2", "x", "4"]]), np.zeros((3, 4, 5, 6)),
    np.inf, len, np.ma.masked_all((1, 4)), np.array([[2**70] * 4], object), range(3), np.datetime64("2020"),
    [[0, 1, 2, 3]], [[0, 1], [2]],
]  # fmt: skip
#: names that take the place of others
NAMES = [
    "",
    "x",
    "u",
    "a/b",
    "main",
    "\n0",
    "z",
    7,
    None,
    "map_x",
    "y" * 5000,
    "time",
    "mesh",
    "triangle",
    ("a",),
    "\x1b[2J",
]

BLUEPRINT = {
    "state": {"time": 0.5},
    "coordsets": {
        "coords": {"type": "explicit", "values": {"x": [0.0, 1, 1, 0, 2, 2], "y": [0.0, 0, 1, 1, 0, 1]}},
    },
    "topologies": {
        "main": {
            "type": "unstructured",
            "coordset": "coords",
            "boundary_topology": "edge",
            "grid_function": "nodes",
            "elements": {"shape": "quad", "connectivity": [0, 1, 2, 3, 1, 4, 5, 2]},
        },
        "edge": {
            "type": "unstructured",
            "coordset": "coords",
            "elements": {"shape": "line", "connectivity": [0, 1, 1, 4]},
        },
    },
    "fields": {
        "nodes": {
            "topology": "main",
            "basis": "L2_T1_2D_P1",
            "values": {"x": [0.0, 1, 0, 1, 1, 2, 1, 2], "y": [0.0, 0, 1, 1, 0, 0, 1, 1]},
        },
        "u": {"topology": "main", "basis": "L2_2D_P1", "values": [0.0, 1, 2, 3, 4, 5, 6, 7]},
        "c": {"topology": "main", "association": "element", "values": [1.0, 2.0]},
        "main_attribute": {"topology": "main", "association": "element", "values": [1, 2]},
        "edge_attribute": {"topology": "edge", "association": "element", "values": [1, 2]},
    },
}


def blueprint(paths):
    """A call of from_blueprint."""
    from elvis import from_blueprint

    _call(paths, from_blueprint, {"mesh": copy.deepcopy(BLUEPRINT), "time": 0.5})


def arrays(paths):
    """A call of from_arrays."""
    from elvis import from_arrays

    corners = np.array([[[0.0, 0], [1, 0], [0, 1], [1, 1]]])
    triangle = np.array([[[1.0, 0], [2, 0], [1, 1]]])
    values = {"quadrilateral": np.arange(4.0)[None], "triangle": np.arange(3.0)[None]}
    call = {
        "positions": {"quadrilateral": corners, "triangle": triangle},
        "fields": {"u": values, "v": {name: np.stack([own, own], axis=-1) for name, own in values.items()}},
        "reference": {"quadrilateral": np.array([[-1.0, -1], [1, -1], [-1, 1], [1, 1]])},
        "time": 0.5,
    }
    _call(paths, from_arrays, call)


def ngsolve(paths):
    """A call of from_ngsolve."""
    from elvis import from_ngsolve

    mesh, functions, odd = _of_ngsolve()
    _call(paths, from_ngsolve, {"mesh": mesh, "fields": dict(functions), "order": 2, "time": 0.5}, odd)


def mfem(paths):
    """A call of from_mfem."""
    from elvis import from_mfem

    mesh, functions, odd = _of_mfem()
    _call(paths, from_mfem, {"mesh": mesh, "fields": dict(functions), "time": 0.5}, odd)


@cache
def _of_ngsolve():
    """A mesh, sound functions, and odd ones."""
    import ngsolve as ng
    from netgen.geom2d import unit_square

    mesh, other = (ng.Mesh(unit_square.GenerateMesh(maxh=size)) for size in (0.9, 0.4))
    scalar = ng.GridFunction(ng.H1(mesh, order=2))
    vector = ng.GridFunction(ng.VectorH1(mesh, order=2))
    odd = [other, ng.GridFunction(ng.H1(other, order=1)), ng.GridFunction(ng.H1(mesh, order=1, complex=True))]
    odd += [ng.GridFunction(ng.FESpace([ng.H1(mesh), ng.H1(mesh)])), ng.GridFunction(ng.HCurl(mesh, order=1))]
    odd += [ng.CF((ng.x, ng.y, ng.x, ng.y)), ng.CF(((1, 2, 3, 4)), dims=(2, 2)), 1 / (ng.x - ng.x), ng.log(ng.x - 5)]
    odd += [ng.CF(1), ng.specialcf.normal(2), scalar.vec, ng.H1(mesh), ng.grad(scalar), mesh.ngmesh, ng.Mesh]
    odd += [ng.GridFunction(ng.NumberSpace(mesh)), ng.GridFunction(ng.FacetFESpace(mesh, order=1)), ng.CF(1j)]
    odd += [ng.GridFunction(ng.SurfaceL2(mesh, order=1)), ng.GridFunction(ng.H1(mesh, order=2, definedon="none"))]
    return mesh, {"u": scalar, "w": vector}, odd


@cache
def _of_mfem():
    """A mesh, sound functions, and odd ones."""
    import mfem.ser as library

    mesh = library.Mesh.MakeCartesian2D(2, 1, library.Element.QUADRILATERAL)
    other = library.Mesh.MakeCartesian2D(2, 2, library.Element.TRIANGLE)
    volume = library.Mesh.MakeCartesian3D(1, 1, 1, library.Element.HEXAHEDRON)
    every = []

    def function(own, collection, components=1, value=1.0):
        space = library.FiniteElementSpace(own, collection, components)
        made = library.GridFunction(space)
        made.Assign(value)
        every.append((own, collection, space))  # the library does not keep them alive
        return made

    scalar = function(mesh, library.H1_FECollection(2, 2))
    vector = function(mesh, library.H1_FECollection(1, 2), 2)
    odd = [
        other,
        volume,
        function(other, library.H1_FECollection(1, 2)),
        function(volume, library.L2_FECollection(0, 3)),
    ]
    odd += [function(mesh, library.ND_FECollection(1, 2)), function(mesh, library.RT_FECollection(1, 2))]
    odd += [function(mesh, library.L2_FECollection(1, 2), 7), function(mesh, library.H1_FECollection(1, 2), 1, np.nan)]
    odd += [function(mesh, library.H1_FECollection(1, 2), 1, np.inf), library.Vector(3), library.H1_FECollection(1, 2)]
    odd += [function(mesh, library.DG_Interface_FECollection(1, 2)), library.Mesh(), library.GridFunction(), every]
    return mesh, {"u": scalar, "w": vector}, odd


def _call(paths, bridge, sound, odd=()):
    """The bridge with arguments that are damaged as the file says, and a value of what it makes."""
    from elvis import sample

    content = paths[0].read_bytes()
    if content != SOUND:
        _damage(sound, random.Random(content), [*ODD, *odd, *odd])
    dataset = bridge(**sound)
    sample(dataset, None, np.full((1, 3), 0.25))


def _damage(arguments, dice, odd):
    """Change some of the arguments or parts of them."""
    for _ in range(dice.choice((1, 1, 1, 2, 3))):
        place, key = dice.choice(list(_places(arguments)))
        value, action = place[key], dice.randrange(6)
        if action == 0 and place is not arguments:
            del place[key]
        elif action == 1 and place is not arguments:
            place[dice.choice(NAMES)] = place.pop(key)
        elif action == 2 and isinstance(value, list) and value:
            value[dice.randrange(len(value))] = _fresh(dice.choice(odd))
        elif action == 3 and (isinstance(value, list) or (isinstance(value, np.ndarray) and value.ndim)):
            place[key] = value[: dice.randrange(len(value) + 1)]
        else:
            place[key] = _fresh(dice.choice(odd))


def _fresh(value):
    """A value whose tables and lists are not those of other cases, in which they could become parts of themselves."""
    if isinstance(value, dict):
        return {key: _fresh(own) for key, own in value.items()}
    return list(value) if isinstance(value, list) else value


def _places(table):
    """Every table with each of its keys, in tables within tables too."""
    for key, value in list(table.items()):
        yield table, key
        if isinstance(value, dict):
            yield from _places(value)
