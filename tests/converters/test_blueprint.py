"""Meshes of Conduit's Blueprint, laid out as MFEM's collection does, against MFEM's own evaluation."""

import numpy as np
import pytest

from elvis import ElvisError, Session, from_mfem, render, sample
from elvis.converters.python.blueprint import from_blueprint

mfem = pytest.importorskip("mfem.ser")

SHAPES = {
    "tri": (mfem.Element.TRIANGLE, 2),
    "quad": (mfem.Element.QUADRILATERAL, 2),
    "tet": (mfem.Element.TETRAHEDRON, 3),
    "hex": (mfem.Element.HEXAHEDRON, 3),
    "wedge": (mfem.Element.WEDGE, 3),
}
KEPT = []
POINTS = np.array([[0.31, 0.22, 0.4], [0.55, 0.71, 0.13], [0.83, 0.4, 0.77]])


class Node:
    """As Conduit's nodes are: children by name, no dictionary."""

    def __init__(self, values):
        self._values = values

    def child_names(self):
        return list(self._values)

    def __getitem__(self, name):
        own = self._values[name]
        return Node(own) if isinstance(own, dict) else own


class Bend(mfem.VectorPyCoefficient):
    def EvalValue(self, x):  # noqa: N802 - MFEM calls it so
        bent = np.array(x, float)
        bent[0] += 0.08 * x[0] * (1 - x[0]) * x[1]
        bent[1] += 0.06 * x[1] * (1 - x[1]) * x[0] ** 2
        return bent


class Wave(mfem.PyCoefficient):
    def EvalValue(self, x):  # noqa: N802
        return np.sin(2 * x[0]) + x[1] ** 2


def made(shape, order):
    """A curved mesh of MFEM, with a scalar and a vector on it."""
    kind, d = SHAPES[shape]
    mesh = mfem.Mesh.MakeCartesian2D(2, 2, kind) if d == 2 else mfem.Mesh.MakeCartesian3D(2, 2, 2, kind)
    mesh.SetCurvature(order)
    mesh.Transform(Bend(d))
    collections = mfem.L2_FECollection(order, d), mfem.H1_FECollection(order, d)
    scalar = mfem.FiniteElementSpace(mesh, collections[0])
    vector = mfem.FiniteElementSpace(mesh, collections[1], d)
    p, u = mfem.GridFunction(scalar), mfem.GridFunction(vector)
    p.ProjectCoefficient(Wave())
    u.ProjectCoefficient(Bend(d))
    # functions don't keep what they stand on
    KEPT.append((collections, scalar, vector))
    return mesh, p, u


def values_of(function):
    """The components of a function by name, as views with strides where they are interleaved."""
    space = function.FESpace()
    data = np.array(function.GetDataArray())
    count, d = space.GetNDofs(), space.GetVDim()
    if d == 1:
        return data
    table = data.reshape(d, count) if space.GetOrdering() == 0 else data.reshape(count, d).T
    return {f"v{k}": own for k, own in enumerate(table)}


def elements_of(shape, count, element):
    own = [list(element(i).GetVerticesArray()) for i in range(count)]
    return {"shape": shape, "connectivity": np.concatenate(own).astype(np.int32)}


def blueprint_of(shape, mesh, p, u):
    """What MFEM's ConduitDataCollection lays out."""
    d = mesh.Dimension()
    places = np.array([[*mesh.GetVertexArray(i)] for i in range(mesh.GetNV())])
    border = {"tri": "line", "quad": "line", "tet": "tri", "hex": "quad"}.get(shape)
    main = {
        "type": "unstructured",
        "coordset": "coords",
        "elements": elements_of(shape, mesh.GetNE(), mesh.GetElement),
        "grid_function": "mesh_nodes",
    }
    topologies = {"main": main}
    fields = {
        "mesh_nodes": {"topology": "main", "basis": mesh.GetNodes().FESpace().FEColl().Name()},
        "p": {"topology": "main", "basis": p.FESpace().FEColl().Name()},
        "u": {"topology": "main", "basis": u.FESpace().FEColl().Name()},
        "main_attribute": {
            "topology": "main",
            "association": "element",
            "values": np.array([mesh.GetAttribute(i) for i in range(mesh.GetNE())]),
        },
    }
    for name, function in (("mesh_nodes", mesh.GetNodes()), ("p", p), ("u", u)):
        fields[name]["values"] = values_of(function)
    if border:
        main["boundary_topology"] = "boundary"
        outer = elements_of(border, mesh.GetNBE(), mesh.GetBdrElement)
        topologies["boundary"] = {"type": "unstructured", "coordset": "coords", "elements": outer}
        numbers = np.array([mesh.GetBdrAttribute(i) for i in range(mesh.GetNBE())])
        fields["boundary_attribute"] = {"topology": "boundary", "association": "element", "values": numbers}
    coordinates = dict(zip("xyz", places.T[:d], strict=False))
    return {
        "state": {"time": 0.75, "cycle": 3},
        "coordsets": {"coords": {"type": "explicit", "values": coordinates}},
        "topologies": topologies,
        "fields": fields,
    }


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("order", [1, 3])
@pytest.mark.sampled(least=4, free=("shape",))
def test_meshes_match_those_that_mfem_exports(shape, order):
    mesh, p, u = made(shape, order)
    d = mesh.Dimension()
    points = POINTS * (1, 1, d == 3)
    wanted = sample(from_mfem(mesh, p=p, u=u), ["p", "u_x", "u_y"], points)
    found = from_blueprint(blueprint_of(shape, mesh, p, u))
    assert found.time == 0.75
    values = sample(found, ["p", "u_x", "u_y"], points)
    assert all(np.isfinite(values[name]).all() for name in ("p", "u_x", "u_y"))
    assert all(np.abs(values[name] - wanted[name]).max() < 1e-13 for name in ("p", "u_x", "u_y"))


def test_nodes_of_conduit_and_several_domains():
    mesh, p, u = made("quad", 2)
    whole = blueprint_of("quad", mesh, p, u)
    wanted = sample(from_blueprint(whole), ["p"], POINTS * (1, 1, 0))["p"]
    for given in (Node(whole), {"domain_000000": whole}, Node({"domain_000000": whole})):
        assert np.array_equal(sample(from_blueprint(given, time=2.0), ["p"], POINTS * (1, 1, 0))["p"], wanted)
    assert from_blueprint(whole, time=2.0).time == 2.0


def test_linear_meshes_of_mixed_shapes():
    coordinates = {"x": [0.0, 1.0, 1.0, 0.0, 2.0], "y": [0.0, 0.0, 1.0, 1.0, 0.0]}
    elements = {
        "shape": "mixed",
        "shape_map": {"tri": 5, "quad": 9},
        "shapes": [9, 5],
        "sizes": [4, 3],
        "offsets": [0, 4],
        "connectivity": [0, 1, 2, 3, 1, 4, 2],
    }
    mesh = {
        "coordsets": {"c": {"type": "explicit", "values": coordinates}},
        "topologies": {"m": {"type": "unstructured", "coordset": "c", "elements": elements}},
        "fields": {
            "t": {"topology": "m", "association": "vertex", "values": [0.0, 1.0, 3.0, 2.0, 2.0]},
            "k": {"topology": "m", "association": "element", "values": [7.0, 8.0]},
        },
    }
    found = sample(from_blueprint(mesh), ["t", "k"], np.array([[0.5, 0.5, 0], [1.25, 0.25, 0]]))
    assert found["t"] == pytest.approx([1.5, 1.25 + 0.5], abs=1e-14)
    assert found["k"] == pytest.approx([7.0, 8.0], abs=1e-14)


@pytest.mark.parametrize(
    ("path", "value", "sentence"),
    [
        ("topologies", {}, "expected a topology, found none"),
        ("topologies/main/type", "uniform", "topology main: expected the type unstructured, found uniform"),
        ("topologies/main/elements/shape", "polyhedral", "expected shapes point, line, .*, mixed; found polyhedral"),
        ("topologies/main/elements/connectivity", [0, 1, 2], "expected 4 for each quad, found 3 in all"),
        ("topologies/main/elements/connectivity", [0, 1, 2, 99] * 4, "99"),
        ("topologies/main/grid_function", "other", "expected its grid function other among the fields, found none"),
        ("fields/p/basis", "H1\nvalues", "field p: expected a basis such as H1_3D_P2, found"),
        ("fields/p/values", [1.0, 2.0], "values"),
        (
            "fields/u/values",
            {"v0": [1.0], "v1": [1.0, 2.0]},
            r"field u: expected components of one length, found \[1, 2\]",
        ),
        ("fields/main_attribute/values", [1], "main_attribute: expected 4 numbers, one an element, found 1"),
    ],
)
def test_input_without_a_mesh_gives_a_one_line_error(path, value, sentence):
    mesh, p, u = made("quad", 1)
    whole = blueprint_of("quad", mesh, p, u)
    *folders, name = path.split("/")
    node = whole
    for folder in folders:
        node = node[folder]
    node[name] = value
    with pytest.raises(ElvisError, match=sentence) as raised:
        from_blueprint(whole)
    assert "\n" not in str(raised.value)


def test_a_running_solver_shows_blueprint_meshes(tmp_path):
    mesh, p, u = made("tri", 2)
    first = from_blueprint(blueprint_of("tri", mesh, p, u))
    with Session(first, field="p", size=(16, 12), device="reference", output=str(tmp_path / "{step}.npz")) as session:
        for step in range(2):
            p *= 2.0
            state = from_blueprint(blueprint_of("tri", mesh, p, u))
            frame = session.show(step, 0.1 * step, state)
            assert session.faults == []
            own = render(state, "p", size=(16, 12), device="reference")
            assert np.array_equal(frame.field, own.field, equal_nan=True)
            assert frame.seen.any()
    assert (tmp_path / "1.npz").exists()


def test_input_without_topologies():
    for given, found in (({"a": 1}, "a"), (3, "int")):
        with pytest.raises(ElvisError, match=f"expected a mesh of Conduit's Blueprint .* found {found}"):
            from_blueprint(given)


#: values that no place of a mesh expects
ODD = (
    *(None, "", "x", -1, 2**70, 1e308, float("nan"), True, [], {}, "hex", "mixed", "H1_2D_P1000000", "a\nvertices\n9"),
    *("y" * 100_000, np.array(["a"]), object(), b"bytes", 1 + 2j, [1e400], [None], {"x": {"y": {}}}, np.array(5.0)),
)


def paths_in(node, above=()):
    """The places of all that nested dictionaries hold."""
    for key, value in node.items():
        yield (*above, key)
        if isinstance(value, dict):
            yield from paths_in(value, (*above, key))


def bad_node(number):
    """A mesh of two squares with its edges, damaged at one place by its number."""
    x, y = [0.0, 1, 1, 0, 2, 2], [0.0, 0, 1, 1, 0, 1]
    elements = {"shape": "quad", "connectivity": [0, 1, 2, 3, 1, 4, 5, 2]}
    outer = {"shape": "line", "connectivity": [0, 1, 1, 4]}
    main = {"type": "unstructured", "coordset": "coords", "boundary_topology": "edge", "elements": elements}
    node = {
        "state": {"time": 0.5},
        "coordsets": {"coords": {"type": "explicit", "values": {"x": x, "y": y}}},
        "topologies": {"main": main, "edge": {"type": "unstructured", "coordset": "coords", "elements": outer}},
        "fields": {
            "u": {"topology": "main", "basis": "L2_2D_P1", "values": [0.0, 1, 2, 3, 4, 5, 6, 7]},
            "c": {"topology": "main", "association": "element", "values": [1.0, 2.0]},
            "main_attribute": {"topology": "main", "association": "element", "values": [1, 2]},
        },
    }
    places = list(paths_in(node))
    *above, last = places[number % len(places)]
    owner = node
    for key in above:
        owner = owner[key]
    odd = number // len(places)
    if odd < len(ODD):
        owner[last] = ODD[odd]
    elif odd == len(ODD):
        owner[7] = owner.pop(last)
    else:
        owner[f"{last}/b\n"] = owner.pop(last)
    return node


@pytest.mark.sampled(least=2, free=("start",))
@pytest.mark.parametrize("start", range(4))
def test_damaged_meshes_are_read_or_give_a_one_line_error(start):
    sentences = []
    for number in range(start, 29 * (len(ODD) + 2), 23):
        try:
            from_blueprint(bad_node(number))
        except ElvisError as error:
            sentences.append(str(error))
    assert len(sentences) > 5
    assert not [text for text in sentences if "\n" in text or len(text) > 1000]


def test_domains_with_other_fields_are_rejected():
    node = bad_node(0)
    node["state"] = {"time": 0.0}
    other = bad_node(0)
    del other["fields"]["c"]
    with pytest.raises(ElvisError, match="domain 2: expected the fields c, u as in the first, found u"):
        from_blueprint({"domain_000000": node, "domain_000001": other})


def test_numbers_beyond_machine_integers_are_rejected():
    node = bad_node(0)
    node["state"] = {"time": 0.0}
    node["fields"]["u"]["values"][3] = 10**400
    with pytest.raises(ElvisError, match="field u: values: expected an array of real numbers, found"):
        from_blueprint(node)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("number", [1e200, 1e308, np.longdouble("1e400")])
def test_numbers_that_overflow_in_products_give_no_warning(number):
    node = bad_node(0)
    node["state"] = {"time": 0.0}
    node["fields"]["u"]["values"] = np.array(node["fields"]["u"]["values"], np.longdouble)
    node["fields"]["u"]["values"][3] = number
    assert from_blueprint(node).field("u").blocks
