"""Solutions of MFEM's and NGSolve's own solvers, deformed and at a phase, are what the libraries say of them."""

import numpy as np
import pytest

from elvis import at_phase, deform, from_mfem, from_ngsolve, integrate, sample

SCALE = 1.5


def clamped_disk(ngsolve, mesh):
    """Linear elasticity under a body force, with a fixed rim."""
    space = ngsolve.VectorH1(mesh, order=3, dirichlet="rim")
    u, v = space.TnT()
    strains = [ngsolve.Sym(ngsolve.Grad(each)) for each in (u, v)]
    stiffness = ngsolve.InnerProduct(*strains) + ngsolve.div(u) * ngsolve.div(v)
    matrix = ngsolve.BilinearForm(stiffness * ngsolve.dx).Assemble().mat
    load = ngsolve.LinearForm(ngsolve.CF((1, ngsolve.x)) * v * ngsolve.dx).Assemble()
    found = ngsolve.GridFunction(space)
    found.vec.data = matrix.Inverse(space.FreeDofs()) * load.vec
    return found


def test_an_elastic_disk_is_that_of_ngsolve(ngsolve, disk):
    displacement = clamped_disk(ngsolve, disk)
    p = ngsolve.GridFunction(ngsolve.H1(disk, order=4))
    p.Set(ngsolve.sin(2 * ngsolve.x) * ngsolve.y)
    bent = deform(from_ngsolve(disk, d=displacement, p=p), "d", SCALE, gradients="deformed")
    scaled = ngsolve.GridFunction(displacement.space)
    scaled.vec.data = SCALE * displacement.vec
    rule = ngsolve.IntegrationRule([(0.2, 0.3), (0.5, 0.1)], [1, 1])
    disk.SetDeformation(scaled)
    try:
        places = disk.MapToAllElements(rule, ngsolve.VOL)
        points = np.array(ngsolve.CF((ngsolve.x, ngsolve.y))(places))
        expected = np.column_stack([np.ravel(p(places)), ngsolve.Grad(p)(places)])
        area, integral = (ngsolve.Integrate(each, disk, order=20) for each in (ngsolve.CF(1), p))
    finally:
        disk.UnsetDeformation()
    # points move by up to a third of the radius
    assert np.abs(points - np.array(ngsolve.CF((ngsolve.x, ngsolve.y))(places))).max() > 0.3
    found = sample(bent, ["p", "d(p,x)", "d(p,y)"], points).values
    assert np.abs(found - expected).max() < 1e-12
    assert [own.value for own in integrate(bent, ["1", "p"])] == pytest.approx([area, integral], rel=1e-12)


def test_complex_vectors_at_a_phase_match_those_of_ngsolve(ngsolve, disk):
    field = ngsolve.GridFunction(ngsolve.VectorH1(disk, order=3, complex=True))
    field.Set((ngsolve.x + 2j * ngsolve.y, 1j * ngsolve.x * ngsolve.y - 0.3))
    shown = at_phase(from_ngsolve(disk, E=field), 40.0)
    assert list(shown) == ["E_re_x", "E_re_y", "E_im_x", "E_im_y", "E_x", "E_y"]
    points = np.array([[0.3, -0.4], [0.7, 0.2], [-0.1, 0.05]])
    own = np.array([field(disk(*point)) for point in points.tolist()])
    turned = (own * np.exp(1j * np.radians(40.0))).real
    assert np.abs(sample(shown, ["E_x", "E_y"], points).values - turned).max() < 1e-12
    moduli = sample(shown, ["abs(E_x)", "abs(E_y)"], points).values
    assert np.abs(moduli - np.abs(own)).max() < 1e-12


def test_an_elastic_beam_is_that_of_mfem():
    mfem = pytest.importorskip("mfem.ser")
    mesh = mfem.Mesh.MakeCartesian3D(2, 1, 1, mfem.Element.HEXAHEDRON, 2.0, 1.0, 1.0)
    mesh.SetCurvature(2)
    elements = mfem.H1_FECollection(2, 3)
    space = mfem.FiniteElementSpace(mesh, elements, 3)
    displacement = clamped_beam(mfem, space)
    bent = deform(from_mfem(mesh, u=displacement), "u", SCALE)
    # both are of order 2 on the same nodes
    nodes = mesh.GetNodes()
    moved = mfem.GridFunction(nodes.FESpace())
    coefficient = mfem.VectorGridFunctionCoefficient(displacement)
    moved.ProjectCoefficient(coefficient)
    nodes.Add(SCALE, moved)
    points, values = [], []
    for element in range(mesh.GetNE()):
        for place in ((0.2, 0.3, 0.4), (0.7, 0.9, 0.1)):
            point = mfem.IntegrationPoint()
            point.Set3(*place)
            points.append(mesh.GetElementTransformation(element).Transform(point))
            values.append([displacement.GetValue(element, point, component) for component in (1, 2, 3)])
    found = sample(bent, ["u_x", "u_y", "u_z"], np.array(points)).values
    assert np.abs(found - values).max() < 1e-12
    # the functions of the space add up to 1; the rule is exact for the determinant
    one = mfem.ConstantCoefficient(1.0)
    integrator = mfem.DomainLFIntegrator(one)
    integrator.SetIntRule(mfem.IntRules.Get(mfem.Geometry.CUBE, 12))
    scalars = mfem.FiniteElementSpace(mesh, elements)
    ones = mfem.LinearForm(scalars)
    ones.AddDomainIntegrator(integrator)
    ones.Assemble()
    assert integrate(bent, "1")[0].value == pytest.approx(ones.GetDataArray().sum(), rel=1e-12)


def clamped_beam(mfem, space):
    """Linear elasticity under a body force, with one fixed end."""
    fixed = mfem.intArray()
    space.GetEssentialTrueDofs(mfem.intArray([0, 0, 0, 0, 1, 0]), fixed)
    one = mfem.ConstantCoefficient(1.0)
    form = mfem.BilinearForm(space)
    form.AddDomainIntegrator(mfem.ElasticityIntegrator(one, one))
    form.Assemble()
    load = mfem.VectorConstantCoefficient(mfem.Vector([0.0, 0.02, -0.05]))
    force = mfem.LinearForm(space)
    force.AddDomainIntegrator(mfem.VectorDomainLFIntegrator(load))
    force.Assemble()
    found = mfem.GridFunction(space)
    found.Assign(0.0)
    matrix, right, unknowns = mfem.OperatorPtr(), mfem.Vector(), mfem.Vector()
    form.FormLinearSystem(fixed, found, force, matrix, unknowns, right)
    mfem.PCG(matrix, mfem.GSSmoother(matrix.AsSparseMatrix()), right, unknowns, 0, 500, 1e-24, 0.0)
    form.RecoverFEMSolution(unknowns, force, found)
    return found
