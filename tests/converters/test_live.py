"""Objects of solvers' sessions and arrays, without files: values are those that their owners say."""

import numpy as np
import pytest

from elvis import ElvisError, from_arrays, from_mfem, from_ngsolve, sample
from elvis.converters.python.live import live_data
from elvis.core.polynomials.quadrature import lobatto
from elvis.core.shapes import Shape
from elvis.plugins.conversion.nodal import tensor_nodes


@pytest.fixture(scope="module")
def mfem():
    return pytest.importorskip("mfem.ser")


class TestNGSolve:
    def test_values_match_those_of_the_library(self, ngsolve, disk):
        u = ngsolve.GridFunction(ngsolve.H1(disk, order=5))
        u.Set(ngsolve.sin(3 * ngsolve.x) * ngsolve.y)
        flow = ngsolve.GridFunction(ngsolve.VectorH1(disk, order=3))
        flow.Set((ngsolve.y, -ngsolve.x * ngsolve.y))
        dataset = from_ngsolve(disk, u=u, flow=flow, p=ngsolve.GridFunction(ngsolve.L2(disk, order=2)), time=0.25)
        assert list(dataset) == ["u", "flow_x", "flow_y", "p"]
        assert dataset.time == 0.25
        assert "an NGSolve mesh: converted in memory, exact to the rounding" in dataset.remarks[0]
        angle, radius = np.meshgrid(np.linspace(0, 6, 13), [0.1, 0.5, 0.9, 0.999])
        points = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=-1).reshape(-1, 2)
        found = sample(dataset, ["u", "flow_y"], points)
        own = np.array([[u(disk(*point)), flow(disk(*point))[1]] for point in points.tolist()])
        assert np.abs(found.values - own).max() < 1e-11

    def test_a_function_provides_its_mesh_and_name(self, ngsolve, disk):
        u = ngsolve.GridFunction(ngsolve.H1(disk, order=8), name="heat")
        u.Set(ngsolve.x * ngsolve.y)
        for dataset in (from_ngsolve(u), from_ngsolve(disk, u), live_data(u)):
            assert list(dataset) == ["heat"]
            assert dataset["heat"](0.3, -0.4) == pytest.approx(-0.12, abs=1e-12)
        assert list(from_ngsolve(u, v=u)) == ["heat", "v"]

    def test_boundaries_keep_their_names(self, ngsolve, disk):
        assert "rim" in {composite.name for composite in from_ngsolve(disk).mesh.composites}

    def test_a_formula_needs_an_order(self, ngsolve, disk):
        formula = ngsolve.x * ngsolve.y
        with pytest.raises(ElvisError, match="expected an order for f, which is not a grid function"):
            from_ngsolve(disk, f=formula)
        # of degree 8 on elements whose map is of degree 4
        dataset = from_ngsolve(disk, f=formula, order=8)
        assert sample(dataset, "f", (0.3, -0.4))["f"] == pytest.approx([-0.12], abs=1e-12)

    def test_other_objects_are_rejected(self, ngsolve, disk):
        u = ngsolve.GridFunction(ngsolve.H1(disk, order=2))
        with pytest.raises(ElvisError, match=r"expected an ngsolve.Mesh or a grid function first, found NumberSpace"):
            from_ngsolve(ngsolve.NumberSpace(disk))
        with pytest.raises(ElvisError, match="expected arrays by the names of fields"):
            from_ngsolve(u, np.zeros(3))
        with pytest.raises(ElvisError, match="expected a grid function or a coefficient function for u, found ndarray"):
            from_ngsolve(disk, u=np.zeros(3))

    def test_complex_functions_are_two_fields(self, ngsolve, disk):
        wave = ngsolve.GridFunction(ngsolve.H1(disk, order=4, complex=True))
        wave.Set(ngsolve.x + 2j * ngsolve.y)
        dataset = from_ngsolve(disk, wave=wave)
        place = (0.3, -0.4)
        found = sample(dataset, "wave_re", place)["wave_re"], sample(dataset, "wave_im", place)["wave_im"]
        assert found == (pytest.approx([0.3], abs=1e-12), pytest.approx([-0.8], abs=1e-12))

    def test_functions_on_several_spaces_are_a_field_for_each(self, ngsolve, disk):
        pair = ngsolve.GridFunction(ngsolve.H1(disk, order=4) * ngsolve.VectorH1(disk, order=4))
        pair.components[0].Set(ngsolve.x)
        pair.components[1].Set((ngsolve.y, 2 + ngsolve.x))
        dataset = from_ngsolve(disk, pair=pair)
        assert list(dataset) == ["pair_1", "pair_2_x", "pair_2_y"]
        assert sample(dataset, None, (0.3, -0.4)).values[0] == pytest.approx([0.3, -0.4, 2.3], abs=1e-12)

    def test_functions_on_facets_are_rejected(self, ngsolve, disk):
        trace = ngsolve.GridFunction(ngsolve.FacetFESpace(disk, order=1))
        with pytest.raises(ElvisError, match="trace: expected values inside of elements, found none"):
            from_ngsolve(disk, trace=trace)


class TestMfem:
    def bent(self, mfem):
        """Squares of a map of degree 3, exactly that of the formula below, so that places are known."""
        mesh = mfem.Mesh(3, 2, "QUADRILATERAL")
        mesh.SetCurvature(3)
        nodes = mesh.GetNodes()
        assert nodes.FESpace().GetOrdering() == 1
        x, y = np.array(nodes.GetDataArray()).reshape(-1, 2).T
        moved = np.stack([x, y + 0.1 * x * (1 - x) * y], axis=1)
        nodes.Assign(mfem.Vector(moved.reshape(-1)))
        return mesh

    def test_a_function_provides_its_mesh(self, mfem):
        mesh = self.bent(mfem)
        space = mfem.FiniteElementSpace(mesh, collection := mfem.H1_FECollection(2, 2))
        own = mfem.GridFunction(space)
        own.Assign(3.0)
        for dataset in (from_mfem(own), from_mfem(mesh, own), live_data(own)):
            assert list(dataset) == ["u"]
            assert dataset["u"](0.3, 0.2) == pytest.approx(3.0, abs=1e-13)
        assert collection.GetOrder() == 2

    def test_values_match_those_of_the_library(self, mfem):
        mesh = self.bent(mfem)
        rng = np.random.default_rng(0)
        functions = {}
        for name, kind in (("u", mfem.H1_FECollection), ("w", mfem.L2_FECollection)):
            collection = kind(4, 2)
            space = mfem.FiniteElementSpace(mesh, collection)
            own = mfem.GridFunction(space)
            own.Assign(mfem.Vector(rng.normal(size=own.Size())))
            functions[name] = (own, space, collection)
        dataset = from_mfem(mesh, {name: own[0] for name, own in functions.items()}, time=2.0)
        assert list(dataset) == ["u", "w"]
        assert dataset["u"].continuous
        assert not dataset["w"].continuous
        assert "an MFEM mesh: converted in memory, exact to the rounding" in dataset.remarks[0]
        inside = rng.uniform(0.05, 0.95, (6, 2)).tolist()
        rule = mfem.IntegrationRule(len(inside))
        for number, (x, y) in enumerate(inside):
            rule.IntPoint(number).Set2(x, y)
        places, wanted = [], []
        for element in range(mesh.GetNE()):
            table = mfem.DenseMatrix()
            mesh.GetElementTransformation(element).Transform(rule, table)
            places += np.array(table.GetDataArray()).T.tolist()
            at = [rule.IntPoint(number) for number in range(len(inside))]
            wanted += [[own[0].GetValue(element, point) for own in functions.values()] for point in at]
        found = sample(dataset, ["u", "w"], places)
        spread = np.ptp(wanted)
        assert np.abs(found.values - wanted).max() < 1e-11 * spread

    def test_other_objects_are_rejected(self, mfem):
        mesh, other = mfem.Mesh(2, 2, "TRIANGLE"), mfem.Mesh(3, 2, "TRIANGLE")
        collection = mfem.H1_FECollection(2, 2)
        space = mfem.FiniteElementSpace(other, collection)
        u = mfem.GridFunction(space)
        for wrong in (space, np.zeros(9)):
            with pytest.raises(ElvisError, match="expected an mfem Mesh or a GridFunction first, found"):
                from_mfem(wrong)
        with pytest.raises(ElvisError, match="expected a GridFunction for u, found ndarray"):
            from_mfem(mesh, u=np.zeros(9))
        with pytest.raises(ElvisError, match="u: expected a function on the mesh's 8 elements, found 12"):
            from_mfem(mesh, u=u)


class TestArrays:
    """Places come from formulas, and fields are polynomials of them that elements hold exactly."""

    def cubes(self, order=3):
        nodes = tensor_nodes(Shape.HEXAHEDRON, tuple(lobatto(order + 1)[0].tolist()))
        unit = (np.asarray(nodes) + 1) / 2
        places = np.stack([unit + np.array([i, j, 0]) for i in range(2) for j in range(2)])
        places[..., 2] += 0.1 * places[..., 0] * (2 - places[..., 0]) * unit[:, 1]
        return places

    def test_hexahedra(self):
        places = self.cubes()
        u = places[..., 0] * places[..., 1]
        dataset = from_arrays({"hexahedron": places}, u=u, v=np.stack([u, 2 * u, -u], axis=-1), time=1.0)
        assert list(dataset) == ["u", "v_x", "v_y", "v_z"]
        assert dataset["u"].continuous
        assert dataset.time == 1.0
        points = np.random.default_rng(1).uniform((0, 0, 0.2), (2, 2, 0.9), (50, 3))
        found = sample(dataset, ["u", "v_y"], points)
        assert (found.location.element_id >= 0).all()
        assert found["u"] == pytest.approx(points[:, 0] * points[:, 1], abs=1e-12)
        assert found["v_y"] == pytest.approx(2 * points[:, 0] * points[:, 1], abs=1e-12)

    def test_two_shapes(self):
        triangles = np.array([[(0, 0), (1, 0), (0, 1)], [(1, 0), (1, 1), (0, 1)]], float)
        squares = np.array([[(1, 0), (2, 0), (1, 1), (2, 1)]], float)
        places = {"triangle": triangles, "quadrilateral": squares}
        fields = {"u": {name: own.sum(axis=2) for name, own in places.items()}}
        dataset = from_arrays(places, fields)
        found = sample(dataset, "u", [(0.2, 0.3), (1.5, 0.25)])
        assert found["u"] == pytest.approx([0.5, 1.75], abs=1e-13)
        with pytest.raises(ElvisError, match="w: expected values on every shape, found none on quadrilateral"):
            from_arrays(places, w={"triangle": np.ones((2, 3))})
        with pytest.raises(ElvisError, match=r"w: expected values by shape, as {'triangle': …}, as there are several"):
            from_arrays(places, w=np.ones((2, 3)))

    def test_nodes_given_by_the_caller(self):
        reference = np.array([(-1, -1), (1, -1), (-1, 1), (0, -1), (0, 0), (-1, 0)], float)
        places = (reference + 1)[None] / 2
        u = places[..., 0] ** 2
        found = sample(from_arrays({"triangle": places}, {"u": u}, reference={"triangle": reference}), "u", (0.3, 0.2))
        assert found["u"] == pytest.approx([0.09], abs=1e-14)

    @pytest.mark.parametrize(
        ("places", "fields", "told"),
        [
            (np.zeros((1, 4, 2)), {}, "expected positions of nodes by shape"),
            ({"hexahedra": np.zeros((1, 8, 3))}, {}, "there is no shape 'hexahedra' (perhaps hexahedron)"),
            ({"Triangle": np.zeros((1, 3, 2))}, {}, "(perhaps triangle)"),
            ({"triangle": np.zeros((3, 2))}, {}, "triangle: expected positions (elements, nodes, 2), found (3, 2)"),
            (
                {"triangle": np.zeros((1, 4, 2))},
                {},
                "the nodes of a complete polynomial, found 4",
            ),
            ({"triangle": np.zeros((1, 6, 2))}, {}, "expected the argument reference, with (6, 2) positions"),
            ({"hexahedron": np.zeros((1, 8, 2))}, {}, "expected positions (elements, nodes, 3), found (1, 8, 2)"),
            ({"triangle": "many"}, {}, "triangle: expected an array of real numbers, found 'many'"),
            ({"triangle": np.eye(3)[None, :, :2]}, {"u": np.zeros(3)}, "u: expected (1, 3) values, or components"),
            (
                {"triangle": np.eye(3)[None, :, :2]},
                {"u": np.zeros((1, 3)) * 1j},
                "u: expected an array of real numbers",
            ),
            (
                {"triangle": np.eye(3)[None, :, :2]},
                {"u": {"quad": np.zeros((1, 3))}},
                "no elements of the shape 'quad'",
            ),
        ],
    )
    def test_mismatched_arrays_are_rejected(self, places, fields, told):
        with pytest.raises(ElvisError) as raised:
            from_arrays(places, fields)
        assert told in str(raised.value)

    @pytest.mark.parametrize(
        ("keywords", "told"),
        [
            ({"reference": np.zeros((3, 2))}, "reference: expected coordinates of nodes by shape"),
            ({"fields": np.zeros((1, 3))}, "expected arrays by the names of fields"),
            ({"fields": {7: np.zeros((1, 3))}}, "expected names of fields that are texts, found 7"),
            ({"fields": {"u" * 5000: np.zeros((1, 3))}}, "expected a name of at most 1000 characters"),
            ({"time": "soon"}, "time: expected an array of real numbers, found 'soon'"),
            ({"time": np.inf}, "time: expected a finite number, found inf"),
            ({"u": np.array([["1", "2", "3"]])}, "u: expected an array of real numbers"),
        ],
        ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
    )
    def test_keywords_of_wrong_types_give_a_one_line_error(self, keywords, told):
        with pytest.raises(ElvisError) as raised:
            from_arrays({"triangle": np.eye(3)[None, :, :2]}, **keywords)
        assert told in str(raised.value)
