"""Series that a solver computes here: its times, its nodal values, and their mean and rms."""

from itertools import pairwise

import numpy as np
import pytest

from elvis.formats import open_series, read, sample
from elvis.plugins.series.statistics import average

mfem = pytest.importorskip("mfem.ser")

STEPS = (0.0, 0.01, 0.03, 0.06, 0.1)


def heated():
    """A plate of nine curved squares, and a temperature of degree 3 on it that is hot in one corner."""
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


class Corner(mfem.PyCoefficient):
    def EvalValue(self, x):  # noqa: N802, the library's name
        return np.exp(-6 * (x[0] ** 2 + x[1] ** 2))


def conducted(space, heat):
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


def nodal(mesh, space, heat):
    """The library's own places (n, 2) of the nodes of each element, and values (n,) there."""
    places, values = [], []
    for element in range(mesh.GetNE()):
        nodes = space.GetFE(element).GetNodes()
        own, where = mfem.Vector(), mfem.DenseMatrix()
        heat.GetValues(element, nodes, own)
        mesh.GetElementTransformation(element).Transform(nodes, where)
        places.append(where.GetDataArray().T.copy())
        values.append(own.GetDataArray().copy())
    return np.concatenate(places), np.concatenate(values)


def test_times_values_mean_and_rms_are_those_of_the_solver(tmp_path, monkeypatch, elvis):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    mesh, space, heat = heated()
    collection = mfem.VisItDataCollection(str(tmp_path / "heat"), mesh)
    collection.SetPrecision(17)
    collection.RegisterField("heat", heat)
    wanted = []
    for cycle, time in enumerate(conducted(space, heat)):
        collection.SetCycle(cycle)
        collection.SetTime(time)
        collection.Save()
        points, values = nodal(mesh, space, heat)
        wanted.append(values)
    assert np.ptp(wanted[-1]) < 0.8 * np.ptp(wanted[0])

    series = open_series(tmp_path / "heat_*.mfem_root")
    assert series.times.tolist() == list(STEPS)
    for step, values in zip(series, wanted, strict=True):
        assert np.abs(sample(step, "heat", points)["heat"] - values).max() < 1e-12
    share = (0.05 - STEPS[2]) / (STEPS[3] - STEPS[2])
    between = (1 - share) * wanted[2] + share * wanted[3]
    assert np.abs(sample(series.at(0.05), "heat", points)["heat"] - between).max() < 1e-12

    found = sample(average(series, with_covariances=True).dataset, ["heat", "heat_heat"], points)
    assert np.abs(found["heat"] - np.mean(wanted, axis=0)).max() < 1e-12
    assert np.abs(found["heat_heat"] - np.var(wanted, axis=0)).max() < 1e-12
    elvis("average", tmp_path / "heat_*.mfem_root", "--covariances", "-o", tmp_path / "mean.xml")
    mean = read(tmp_path / "mean.xml", tmp_path / "mean.fld")
    rms = sample(mean, "sqrt(heat^2 + heat_heat)", points)["sqrt(heat^2 + heat_heat)"]
    assert np.abs(rms - np.sqrt(np.mean(np.square(wanted), axis=0))).max() < 1e-12
