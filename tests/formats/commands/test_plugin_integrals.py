"""Integrals over NURBS volumes: a quarter of a ring in closed form, a pipe by what MFEM integrates."""

import json
from math import pi, sqrt

import numpy as np
import pytest

from elvis.core.base.errors import ElvisError


@pytest.fixture
def ring(tmp_path):
    """Radii 1 to 2, from the x to the y axis, 3 high, with a field that is x and one that is 1."""
    points, weights = [], []
    for z in (0.0, 3.0):
        for radius in (1.0, 2.0):
            points += [[radius, 0, z], [radius, radius, z], [0, radius, z]]
            weights += [1, sqrt(0.5), 1]
    knots = [[0, 0, 0, 1, 1, 1], [0, 0, 1, 1], [0, 0, 1, 1]]
    fields = {"p": [point[0] for point in points], "one": [1.0] * len(points)}
    patch = {"degrees": [2, 1, 1], "knots": knots, "points": points, "weights": weights, "fields": fields}
    sides = {"outer": [[0, "y+"]], "ends": [[0, "z-"], [0, "z+"]]}
    table = {"format": "elvis-nurbs", "version": 1, "patches": [patch], "boundaries": sides}
    (tmp_path / "ring.json").write_text(json.dumps(table))
    return tmp_path / "ring.json"


def test_a_quarter_of_a_ring(ring, elvis_json):
    found = elvis_json(
        "integrate", ring, "--field", "volume", "--field", "p", "--field", "average(p*y)", "--error", "1e-10"
    )
    volume = 9 * pi / 4
    truth = [volume, 7.0, (15 / 4) * (1 / 2) * 3 / volume]
    assert [row["value"] for row in found] == pytest.approx(truth, rel=1e-12)
    assert all(abs(row["value"] - own) <= row["estimate"] < 1e-8 for row, own in zip(found, truth, strict=True))


def test_its_sides_and_the_flux_through_them(ring, elvis_json):
    """The force of p = x on the outer side, r = 2: 12 cos^2 of the angle, over a right angle."""
    fields = ("--field", "area", "--field", "p*nx", "--field", "x*nx + y*ny + z*nz", "--error", "1e-10")
    found = elvis_json("integrate", ring, *fields, "--over", "outer", "--over", "ends", "--over", "all")
    values = {(row["over"], row["integrand"]): row["value"] for row in found}
    assert values["outer", "area"] == pytest.approx(3 * pi, rel=1e-12)
    assert values["outer", "p*nx"] == pytest.approx(3 * pi, rel=1e-12)
    assert values["ends", "area"] == pytest.approx(1.5 * pi, rel=1e-12)
    assert values["ends", "p*nx"] == pytest.approx(0, abs=1e-12)
    assert values["all", "area"] == pytest.approx(6 * pi + 6, rel=1e-12)
    assert values["all", "x*nx + y*ny + z*nz"] == pytest.approx(27 * pi / 4, rel=1e-12)


def test_the_integral_over_a_pipe_matches_mfem(nektar, elvis_json):
    mfem = pytest.importorskip("mfem.ser")
    files = [str(nektar.parent / "solvers" / "mfem" / f"pipe_nurbs.{suffix}") for suffix in ("mesh", "u.gf")]
    mesh = mfem.Mesh(files[0])
    u = mfem.GridFunction(mesh, files[1])
    totals = np.zeros(3)
    for element in range(mesh.GetNE()):
        transformation = mesh.GetElementTransformation(element)
        rule = mfem.IntRules.Get(mesh.GetElementGeometry(element), 24)
        for number in range(rule.GetNPoints()):
            point = rule.IntPoint(number)
            transformation.SetIntPoint(point)
            value, weight = u.GetValue(element, point), point.weight * transformation.Weight()
            totals += weight * np.array([1, value, value**2])
    found = elvis_json("integrate", *files, "--field", "volume", "--field", "u", "--field", "u^2", "--error", "1e-12")
    assert [row["value"] for row in found] == pytest.approx(totals, rel=1e-11)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("--field", "area"), "domain has a volume, no area"),
        (("--field", "p*nx"), "nx is only known on boundaries"),
        (("--field", "p", "--over", "outr"), "there is no 'outr' in a plugin's data (perhaps outer)"),
        (("--field", "p", "--clip", "p=1"), "--clip: expected elements with a known map"),
        (("--field", "d(p,x)*nx", "--over", "all"), "expected normals times values, without derivatives"),
    ],
)
def test_unsupported_integrals_are_rejected(ring, elvis, arguments, sentence):
    with pytest.raises(ElvisError) as error:
        elvis("integrate", ring, *arguments)
    assert sentence in str(error.value)
