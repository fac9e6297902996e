"""Series that solvers compute here: their times, their nodal values, and the mean and rms of these."""

from itertools import pairwise

import numpy as np
import pytest

from elvis import open_series, read, sample
from elvis.converters.ngsolve.export import export
from elvis.plugins.testing.steps import agree

STEPS = (0.0, 0.01, 0.03, 0.06, 0.1)


def heated(mfem):
    """A plate of nine curved squares, and a temperature of degree 3 on it that is hot in one corner."""

    class Corner(mfem.PyCoefficient):
        def EvalValue(self, x):  # noqa: N802, the library's name
            return np.exp(-6 * (x[0] ** 2 + x[1] ** 2))

    mesh = mfem.Mesh.MakeCartesian2D(3, 3, mfem.Element.QUADRILATERAL)
    mesh.SetCurvature(2, False, 2, mfem.Ordering.byNODES)
    nodes = mesh.GetNodes()
    places = nodes.GetDataArray().reshape(2, -1)
    x, y = places.copy()
    places[:] = x + 0.08 * np.sin(np.pi * y), y - 0.05 * np.sin(np.pi * x)
    space = mfem.FiniteElementSpace(mesh, mfem.H1_FECollection(3, 2))
    heat = mfem.GridFunction(space)
    heat.Assign(0.0)
    heat.ProjectCoefficient(Corner())
    return mesh, space, heat


def conducted(mfem, space, heat):
    """Times and temperatures of the heat equation by implicit Euler, du/dt = 0.2 div grad u, with insulated walls."""
    yield STEPS[0]
    for before, time in pairwise(STEPS):
        forms = mfem.BilinearForm(space), mfem.BilinearForm(space)
        for form in forms:
            form.AddDomainIntegrator(mfem.MassIntegrator())
        flux = mfem.ConstantCoefficient(0.2 * (time - before))
        forms[1].AddDomainIntegrator(mfem.DiffusionIntegrator(flux))
        for form in forms:
            form.Assemble()
            form.Finalize()
        mass, whole = (form.SpMat() for form in forms)
        load = mfem.Vector(space.GetVSize())
        mass.Mult(heat, load)
        mfem.PCG(whole, mfem.GSSmoother(whole), load, heat, 0, 200, 1e-24, 0.0)
        yield time


def nodal(mfem, mesh, space, heat):
    """The library's own places (n, 3) of the nodes of each element, and values (n,) there."""
    places, values = [], []
    for element in range(mesh.GetNE()):
        nodes = space.GetFE(element).GetNodes()
        own, where = mfem.Vector(), mfem.DenseMatrix()
        heat.GetValues(element, nodes, own)
        mesh.GetElementTransformation(element).Transform(nodes, where)
        places.append(where.GetDataArray().T.copy())
        values.append(own.GetDataArray().copy())
    return np.pad(np.concatenate(places), ((0, 0), (0, 1))), np.concatenate(values)


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def test_heat_equation_of_mfem(tmp_path, elvis):
    mfem = pytest.importorskip("mfem.ser")
    mesh, space, heat = heated(mfem)
    collection = mfem.VisItDataCollection(str(tmp_path / "heat"), mesh)
    collection.SetPrecision(17)
    collection.RegisterField("heat", heat)
    wanted = []
    for cycle, time in enumerate(conducted(mfem, space, heat)):
        collection.SetCycle(cycle)
        collection.SetTime(time)
        collection.Save()
        points, values = nodal(mfem, mesh, space, heat)
        wanted.append(values)
    assert np.ptp(wanted[-1]) < 0.8 * np.ptp(wanted[0])

    agree(open_series(tmp_path / "heat_*.mfem_root"), points, STEPS, {"heat": np.array(wanted)})
    elvis("average", tmp_path / "heat_*.mfem_root", "--covariances", "-o", tmp_path / "mean.xml")
    mean = read(tmp_path / "mean.xml", tmp_path / "mean.fld")
    rms = sample(mean, "sqrt(heat^2 + heat_heat)", points)["sqrt(heat^2 + heat_heat)"]
    assert np.abs(rms - np.sqrt(np.mean(np.square(wanted), axis=0))).max() < 1e-12


#: what a square conducts; the rate at which cos(pi x) cos(pi y) decays by that
CONDUCTS = 1.0
DECAY = 2 * np.pi**2 * CONDUCTS


def cooled(ngsolve, heat):
    """Times and temperatures of the heat equation on a unit square with insulated walls, by Crank and Nicolson's rule
    in steps of 0.001."""
    space = heat.space
    u, v = space.TnT()
    heat.Set(ngsolve.cos(np.pi * ngsolve.x) * ngsolve.cos(np.pi * ngsolve.y))
    yield STEPS[0]
    flux = CONDUCTS * ngsolve.grad(u) * ngsolve.grad(v)
    stiff = ngsolve.BilinearForm(flux * ngsolve.dx).Assemble().mat
    whole = ngsolve.BilinearForm((u * v + 0.0005 * flux) * ngsolve.dx).Assemble().mat
    inverse = whole.Inverse(space.FreeDofs(), inverse="sparsecholesky")
    for before, time in pairwise(STEPS):
        for _ in range(round((time - before) / 0.001)):
            heat.vec.data -= 0.001 * (inverse * (stiff * heat.vec))
        yield time


@pytest.mark.thorough
def test_heat_equation_of_ngsolve(tmp_path):
    """As samples of the library's functions, and in the index that it writes of VTK's cells of its degree."""
    ngsolve, geom2d = pytest.importorskip("ngsolve"), pytest.importorskip("netgen.geom2d")
    mesh = ngsolve.Mesh(geom2d.unit_square.GenerateMesh(maxh=0.4))
    heat = ngsolve.GridFunction(ngsolve.H1(mesh, order=5))
    vtk = ngsolve.VTKOutput(mesh, [heat], ["heat"], str(tmp_path / "heat"), order=5)
    mapped = mesh.MapToAllElements(ngsolve.IntegrationRule(ngsolve.TRIG, 8), ngsolve.VOL)
    x, y = (np.asarray(axis(mapped)).reshape(-1) for axis in (ngsolve.x, ngsolve.y))
    wanted = []
    for number, time in enumerate(cooled(ngsolve, heat)):
        export(tmp_path / f"heat_{number}.elems.npz", mesh, {"heat": heat}, time=time)
        vtk.Do(time=time)
        wanted.append(np.asarray(heat(mapped)).reshape(-1))
        decayed = np.exp(-DECAY * time) * np.cos(np.pi * x) * np.cos(np.pi * y)
        assert np.abs(wanted[-1] - decayed).max() < 1e-4
    points = np.stack([x, y, np.zeros_like(x)], axis=1)
    agree(open_series(tmp_path / "heat_*.elems.npz"), points, STEPS, {"heat": np.array(wanted)})
    agree(open_series(tmp_path / "heat.pvd"), points, STEPS, {"heat": np.array(wanted)})
