"""Integrals and norms against what the solvers' own libraries integrate on their own data."""

import h5py
import numpy as np
import pytest

from elvis import diff, from_mfem, from_ngsolve, read
from elvis.core.integrals import integrate


def test_integrals_and_norms_of_ngsolve(ngsolve, disk):
    """Integrals over the domain, of derivatives, over the rim, and the difference of two functions."""
    u, v = (ngsolve.GridFunction(ngsolve.H1(disk, order=order)) for order in (5, 3))
    for function in (u, v):
        function.Set(ngsolve.sin(3 * ngsolve.x) * (1 + ngsolve.y))
    first, second = from_ngsolve(disk, u=u), from_ngsolve(disk, u=v)

    def own(formula, where=ngsolve.VOL):
        return ngsolve.Integrate(formula, disk, where, order=24)

    slopes = ngsolve.grad(u) - ngsolve.grad(v)
    off = own((u - v) ** 2)
    found = integrate(first, ["u", "u^2", "d(u,x)*y"], error=1e-12)
    truth = [own(u), own(u * u), own(ngsolve.grad(u)[0] * ngsolve.y)]
    assert [row.value for row in found] == pytest.approx(truth, rel=1e-11, abs=1e-11)
    rim = integrate(first, ["length", "u*nx"], "rim", error=1e-12)
    normal = ngsolve.specialcf.normal(2)
    assert [row.value for row in rim] == pytest.approx(
        [own(1, ngsolve.BND), own(u * normal[0], ngsolve.BND)], rel=1e-11, abs=1e-11
    )
    difference = diff(first, second, error=1e-8)
    assert difference.is_same_mesh
    assert difference[0].l2 == pytest.approx(np.sqrt(off), rel=1e-11)
    assert difference[0].h1 == pytest.approx(np.sqrt(off + own(slopes * slopes)), rel=1e-9)


@pytest.mark.parametrize("name", ["fichera_mixed_p2", "escher_p3"])
def test_integrals_of_mfem(name, nektar):
    """Hexahedra, prisms and tetrahedra together; curved tetrahedra: MFEM's rules of order 16 at its own points."""
    mfem = pytest.importorskip("mfem.ser")
    files = [str(nektar.parent / "solvers" / "mfem" / f"{name}.{suffix}") for suffix in ("mesh", "u.gf")]
    mesh = mfem.Mesh(files[0])
    u = mfem.GridFunction(mesh, files[1])
    total = square = 0.0
    for element in range(mesh.GetNE()):
        transformation = mesh.GetElementTransformation(element)
        rule = mfem.IntRules.Get(mesh.GetElementGeometry(element), 16)
        for number in range(rule.GetNPoints()):
            point = rule.IntPoint(number)
            transformation.SetIntPoint(point)
            value, weight = u.GetValue(element, point), point.weight * transformation.Weight()
            total, square = total + weight * value, square + weight * value**2
    found = integrate(from_mfem(mesh, u=u), ["u", "u^2"])
    assert [row.value for row in found] == pytest.approx([total, square], rel=1e-11, abs=1e-11)


def collapsed_rule(shape, count):
    """Gauss points (n, 3) and weights of PyFR's reference shapes: a cube of points, squeezed where edges meet."""
    nodes, weights = np.polynomial.legendre.leggauss(count)
    x, y, z = (axis.reshape(-1) for axis in np.meshgrid(nodes, nodes, nodes, indexing="ij"))
    share = np.stack(np.meshgrid(weights, weights, weights, indexing="ij")).prod(axis=0).reshape(-1)
    if shape in ("tet", "pri"):
        x, share = (1 + x) * (1 - y) / 2 - 1, share * (1 - y) / 2
    if shape == "tet":
        x, y, share = (1 + x) * (1 - z) / 2 - 1, (1 + y) * (1 - z) / 2 - 1, share * ((1 - z) / 2) ** 2
    if shape == "pyr":
        x, y, share = x * (1 - z) / 2, y * (1 - z) / 2, share * ((1 - z) / 2) ** 2
    return np.stack([x, y, z], axis=1), share


@pytest.mark.thorough
def test_integrals_of_pyfr(nektar):
    """Curved elements of all four shapes: PyFR's bases and maps at Gauss points; its own rules agree on the shapes."""
    inifile, shapes = pytest.importorskip("pyfr.inifile"), pytest.importorskip("pyfr.shapes")
    quadrules, util = pytest.importorskip("pyfr.quadrules"), pytest.importorskip("pyfr.util")
    folder = nektar.parent / "solvers" / "pyfr"
    total, square = np.zeros(5), 0.0
    with h5py.File(folder / "mixed3d_p3.pyfrm") as mesh, h5py.File(folder / "mixed3d_p3-01.pyfrs") as file:
        settings = inifile.Inifile(file["config"][()].decode())
        places = mesh["nodes"]["location"]
        for name, elements in mesh["eles"].items():
            nodes = places[elements["nodes"]]
            shape = util.subclass_where(shapes.BaseShape, name=name)(nodes.shape[1], settings)
            points, weights = collapsed_rule(name, 9)
            assert weights.sum() == pytest.approx(quadrules.get_quadrule(name, qdeg=6).wts.sum(), rel=1e-12)
            slopes = shape.sbasis.jac_nodal_basis_at(points, clean=False)
            jacobians = np.einsum("dnq,enc->eqcd", slopes, nodes)
            shares = np.abs(np.linalg.det(jacobians)) * weights
            modes = shape.ubasis.nodal_basis_at(points, clean=False)
            values = np.einsum("qn,evn->evq", modes, file[f"soln/p3-{name}"][()])
            total += np.einsum("eq,evq->v", shares, values)
            square += (shares * values[:, 0] ** 2).sum()
    found = integrate(read(folder / "mixed3d_p3-01.pyfrs"), ["rho", "rhou", "rhov", "rhow", "E", "rho^2"])
    assert [row.value for row in found] == pytest.approx([*total, square], rel=1e-11, abs=1e-11)
