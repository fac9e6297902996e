"""Means along Fourier directions, against integrals over the whole period; planes across them, against values there."""

import json
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import Dataset, ElvisError, Shape, integrate, read, sample, write
from elvis.converters.vtk.export import export_vtu
from elvis.core.data.dataset import Field, Homogeneous
from elvis.core.polynomials.bases import Basis
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Sampler
from elvis.core.testing import approximated, curved, grid, ripple
from elvis.core.wall_curves import at_walls
from elvis.plugins.command.command import elvis
from elvis.plugins.data.added_quantities import add_quantities
from elvis.plugins.fourier.onto_waves import onto_any_mesh
from elvis.plugins.fourier.planes import fourier_coefficients, fourier_mean
from elvis.plugins.fourier.slabs import in_slabs

PERIOD = 2.5


def spanwise(planes):
    """Plane data whose field u has another function on each plane of Fourier coefficients."""
    mesh = curved(grid(Shape.QUADRILATERAL, 2), ripple(0.04), 3)
    waves = Homogeneous((Basis.FOURIER,), (PERIOD,), tuple(range(planes)))
    blocks = []
    functions = [lambda p, k=k: (k + 1) * p[:, 0] - k * p[:, 1] ** 2 + 1 for k in range(planes)]
    of_planes = [approximated(Dataset(mesh), "u", function, 4) for function in functions]
    for block in of_planes[0].blocks:
        number = of_planes[0].blocks.index(block)
        coefficients = np.hstack([own.blocks[number].coefficients for own in of_planes])
        expansion = replace(block.expansion, homogeneous=waves)
        blocks.append(replace(block, expansion=expansion, coefficients=coefficients))
    return Dataset(mesh, (Field("u", tuple(blocks)),)), of_planes[0]


@pytest.mark.parametrize("planes", [2, 4])
def test_the_mean_is_the_integral_by_the_period(tmp_path, monkeypatch, planes):
    monkeypatch.chdir(tmp_path)
    data, constant = spanwise(planes)
    write(data, "a.xml")
    found = CliRunner().invoke(elvis, ["average", "a.xml", "a.fld", "--direction", "z", "-o", "mean.xml"])
    assert found.exit_code == 0, found.output
    mean = read("mean.xml", "mean.fld")
    for text in ("u", "u*x"):
        whole = integrate(data, text, error=1e-9).value
        assert integrate(mean, text).value == pytest.approx(whole / PERIOD, rel=1e-10)
    assert mean["u"](0.4, 0.3) == pytest.approx(Dataset(mean.mesh, (constant,))["u"](0.4, 0.3), abs=1e-13)


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (("--direction", "x", "-o", "b.xml"), "with a Fourier direction along x, found one along z"),
        (("--direction", "z", "-o", "b.fld"), "expected --direction with -o NAME.xml"),
        (("--direction", "z", "--covariances", "-o", "b.xml"), "without --covariances"),
    ],
)
def test_bad_input_gives_one_line_errors(tmp_path, monkeypatch, words, reason):
    monkeypatch.chdir(tmp_path)
    write(spanwise(2)[0], "a.xml")
    found = CliRunner().invoke(elvis, ["average", "a.xml", "a.fld", *words])
    assert found.exit_code != 0
    assert reason in f"{found.output}{found.exception}"
    assert not (tmp_path / "b.xml").exists()


def at_random(data, texts, count=60):
    """Values (count, texts) at points of the prism over the middle of the square."""
    points = np.random.default_rng(4).uniform(0.2, 0.8, (count, 3)) * (1, 1, PERIOD)
    return Sampler(data, [Expression.of(data, text) for text in texts]).sample(points).values


def test_quantities_keep_the_waves():
    """Derivatives along the waves are exact; a square has shorter waves, whose part the stated error contains."""
    found = add_quantities(spanwise(4)[0], ["uz=d(u,z)", "twice=2*u-x", "k=u^2"], order=6)
    uz, twice, k = found.measures
    assert uz.is_exact
    assert twice.is_exact
    own = at_random(found.dataset, ["uz", "d(u,z)", "twice", "2*u-x", "k", "u^2"])
    assert np.abs(own[:, 0] - own[:, 1]).max() < 1e-11 * np.abs(own[:, 1]).max()
    assert np.abs(own[:, 2] - own[:, 3]).max() < 1e-11
    assert 0.05 * k.max < np.abs(own[:, 4] - own[:, 5]).max() <= k.max
    assert "k has waves beyond those of the data" in found.dataset.remarks[-1]
    with pytest.raises(ElvisError, match="inverse: expected finite values"):
        add_quantities(spanwise(2)[0], ["inverse=1/(u-u)"])


@pytest.mark.parametrize("shape", [Shape.QUADRILATERAL, Shape.TRIANGLE])
def test_slabs_hold_the_waves(shape, tmp_path):
    data = spanwise(4)[0] if shape is Shape.QUADRILATERAL else of_triangles()
    coarse, fine = (in_slabs(data, count, 4) for count in (4, 8))
    for found in (coarse, fine):
        assert found.dataset.mesh.dimension == 3
        assert integrate(found.dataset, "1").value == pytest.approx(PERIOD * integrate(data, "1").value / PERIOD)
        difference = np.abs(at_random(found.dataset, ["u"]) - at_random(data, ["u"])).max()
        assert difference <= found.report.fields[0].max
    assert fine.report.fields[0].max < coarse.report.fields[0].max / 16
    # the file of another program has volume elements
    losses = []
    export_vtu(fine.dataset, None, None, tmp_path / "a.vtu", losses.extend)
    assert max(loss.relative for loss in losses) < 1e-12


def of_triangles():
    """Plane data on triangles with a cosine and a sine."""
    mesh = grid(Shape.TRIANGLE, 2)
    parts = [approximated(Dataset(mesh), "u", lambda p, k=k: p[:, 0] + k * p[:, 1], 3).blocks for k in range(4)]
    waves = Homogeneous((Basis.FOURIER,), (PERIOD,), (0, 1, 2, 3))
    blocks = [
        replace(
            own[0],
            expansion=replace(own[0].expansion, homogeneous=waves),
            coefficients=np.hstack([each.coefficients for each in own]),
        )
        for own in zip(*parts, strict=True)
    ]
    return Dataset(mesh, (Field("u", tuple(blocks)),))


def test_waves_on_another_mesh():
    """Linear functions of the plane are exact on any plane mesh; a mesh of volume elements gets the slabs' values."""
    data = of_triangles()
    found = onto_any_mesh(data, Dataset(grid(Shape.QUADRILATERAL, 1)), 2, "error")
    assert all(own.is_exact for own in found.measures)
    assert found.integrals[0].after == pytest.approx(integrate(data, "u").value, rel=1e-12)
    assert np.abs(at_random(found.dataset, ["u"]) - at_random(data, ["u"])).max() < 1e-12
    box = grid(Shape.HEXAHEDRON, 1)
    volume = Dataset(replace(box, vertices=box.vertices * (1, 1, PERIOD / 8)))
    assert onto_any_mesh(data, volume, 4, "error").measures[0].relative < 1e-2
    with pytest.raises(ElvisError, match="expected error, nan, nearest or 0 for Fourier data, found 3"):
        onto_any_mesh(data, Dataset(grid(Shape.QUADRILATERAL, 1)), 2, "3")


def test_the_command_extrudes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write(spanwise(4)[0], "a.xml")
    for words in (["--extrude", "6", "-o", "b.xml"], ["--add", "uz=d(u,z)", "-o", "c.fld"]):
        found = CliRunner().invoke(elvis, ["convert", "a.xml", "a.fld", *words])
        assert found.exit_code == 0, found.output
    volume = read("b.xml", "b.fld")
    assert len(volume.mesh.of(Shape.HEXAHEDRON)) == 24
    found = CliRunner().invoke(elvis, ["convert", "a.xml", "a.fld", "--extrude", "6", "-o", "d.fld"])
    assert "expected no --add and a mesh file" in f"{found.output}{found.exception}"
    found = CliRunner().invoke(elvis, ["export", "a.xml", "a.fld", "-o", "a.vtu"])
    assert found.exit_code == 0, found.output
    assert "written as slabs of volume elements" in found.output


def test_plane_data_have_no_fourier_planes(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mesh = grid(Shape.QUADRILATERAL, 1)
    write(Dataset(mesh, (approximated(Dataset(mesh), "u", lambda p: p[:, 0], 2),)), "a.xml")
    for words in (["average", "--direction", "z"], ["convert", "--mean-mode"]):
        found = CliRunner().invoke(elvis, [words[0], "a.xml", "a.fld", *words[1:], "-o", "b.xml"])
        assert found.exit_code == 1
        assert "with a Fourier direction, found none" in str(found.exception)


def values_of(data):
    """Values of u at points of the first element, at heights over three periods."""
    heights = PERIOD * np.array([0.1, 0.45, 0.8, 1.3, 2.7])
    return data["u"](np.full(5, 0.3), np.full(5, 0.2), heights)


@pytest.mark.parametrize(
    ("basis", "numbers"),
    [
        (Basis.FOURIER, (0, 4, 3)),
        (Basis.FOURIER_SINGLE_MODE, (0, 1)),
        (Basis.FOURIER_HALF_MODE_RE, (0,)),
        (Basis.FOURIER_HALF_MODE_IM, (0,)),
    ],
)
def test_other_waves_are_the_same_functions(tmp_path, monkeypatch, basis, numbers):
    monkeypatch.chdir(tmp_path)
    waves = Homogeneous((basis,), (PERIOD,), numbers)
    whole, _ = spanwise(len(numbers))
    blocks = [replace(own, expansion=replace(own.expansion, homogeneous=waves)) for own in whole.fields[0].blocks]
    data = Dataset(whole.mesh, (Field("u", tuple(blocks)),))
    write(data, "a.xml")
    for words, period in ((["--full"], PERIOD), (["--stretch", "3"], 3 * PERIOD)):
        outcome = CliRunner().invoke(elvis, ["convert", "a.xml", "a.fld", *words, "-o", "b.xml", "--overwrite"])
        assert outcome.exit_code == 0, outcome.output
        found = read("b.xml", "b.fld")
        np.testing.assert_allclose(values_of(found), values_of(data), atol=1e-12)
        (expansion,) = {own.expansion.homogeneous for own in found.fields[0].blocks}
        assert (expansion.bases, expansion.lengths) == ((Basis.FOURIER,), (pytest.approx(period),))
        assert expansion.z_ids == tuple(range(len(expansion.z_ids)))
    # waves have the mean zero
    if basis is not Basis.FOURIER:
        assert not fourier_mean(data, "z").fields[0].blocks[0].coefficients.any()


def test_energies_of_waves_add_up_to_the_mean_square(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data, _ = spanwise(6)
    write(data, "a.xml")
    outcome = CliRunner().invoke(elvis, ["info", "a.xml", "a.fld", "--waves", "--json"])
    assert outcome.exit_code == 0, outcome.output
    facts = json.loads(outcome.stdout)
    assert facts["waves"] == [0, 1, 2]
    assert sum(facts["by_field"]["u"]) == pytest.approx(integrate(data, "average(u^2)", error=1e-9).value, rel=1e-9)
    # of wave 2, planes 4 and 5
    alone = [integrate(fourier_coefficients(data, number), "average(u^2)").value for number in (4, 5)]
    assert facts["by_field"]["u"][2] == pytest.approx(sum(alone) / 2, rel=1e-12)


def test_energies_of_waves_in_a_box_are_those_of_its_elements(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data, _ = spanwise(4)
    write(data, "a.xml")
    words = ["info", "a.xml", "a.fld", "--waves", "--json", "--box"]
    halves = [json.loads(CliRunner().invoke(elvis, [*words, box]).stdout) for box in ("0,0.5,0,1", "0.5,1,0,1")]
    # the area of elements is the square of their size h
    sizes = sample(data, "h", [(x, y, 0) for x in (0.25, 0.75) for y in (0.25, 0.75)]).values[:, 0] ** 2
    left, right = sizes.reshape(2, 2).sum(axis=1)
    found = left * np.array(halves[0]["by_field"]["u"]) + right * np.array(halves[1]["by_field"]["u"])
    found /= left + right
    whole = json.loads(CliRunner().invoke(elvis, ["info", "a.xml", "a.fld", "--waves", "--json"]).stdout)
    assert found == pytest.approx(np.array(whole["by_field"]["u"]), rel=1e-12)
    outcome = CliRunner().invoke(elvis, [*words, "5,6,5,6"])
    assert "--box: expected elements in 5,6,5,6, found none" in str(outcome.exception)


def test_cosines_of_half_modes_become_sines(tmp_path, monkeypatch):
    """With equal coefficients w is u a quarter of a period later."""
    monkeypatch.chdir(tmp_path)
    waves = Homogeneous((Basis.FOURIER_HALF_MODE_RE,), (PERIOD,), (0,))
    whole, _ = spanwise(1)
    blocks = [replace(own, expansion=replace(own.expansion, homogeneous=waves)) for own in whole.fields[0].blocks]
    data = Dataset(whole.mesh, (Field("u", tuple(blocks)), Field("w", tuple(blocks))))
    write(data, "a.xml")
    words = ["convert", "a.xml", "a.fld", "-o", "b.xml"]
    outcome = CliRunner().invoke(elvis, [*words, "--full", "--sine", "w"])
    assert outcome.exit_code == 0, outcome.output
    found = read("b.xml", "b.fld")
    for z in (0.1, 0.8, 1.7):
        value, angle = data["u"](0.3, 0.2, 0.0), 2 * np.pi * z / PERIOD
        assert found["u"](0.3, 0.2, z) == pytest.approx(value * np.cos(angle), abs=1e-12)
        assert found["w"](0.3, 0.2, z) == pytest.approx(value * np.sin(angle), abs=1e-12)
    outcome = CliRunner().invoke(elvis, [*words, "--overwrite", "--sine", "w"])
    assert "--sine: expected with --full" in str(outcome.exception)
    outcome = CliRunner().invoke(elvis, [*words, "--overwrite", "--full", "--sine", "q"])
    assert "--sine: expected some of the fields u, w; found q" in str(outcome.exception)


def test_planes_are_coefficients(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data, _ = spanwise(4)
    write(data, "a.xml")
    # at z = 0 and at half of the period: mean + cosine, and mean - cosine
    at = [data["u"](0.3, 0.2, z) for z in (0.0, PERIOD / 2)]
    cosine, mean = (at[0] - at[1]) / 2, (at[0] + at[1]) / 2
    for words, expected in ((["--plane", "2"], cosine), (["--plane", "0"], mean), (["--mean-mode"], mean)):
        CliRunner().invoke(elvis, ["convert", "a.xml", "a.fld", *words, "-o", "b.xml", "--overwrite"])
        assert read("b.xml", "b.fld")["u"](0.3, 0.2) == pytest.approx(expected, abs=1e-12)
    CliRunner().invoke(elvis, ["convert", "a.xml", "a.fld", "--zero-plane", "2", "-o", "c.xml"])
    assert read("c.xml", "c.fld")["u"](0.3, 0.2, 0.0) == pytest.approx((at[0] + at[1]) / 2, abs=1e-12)
    outcome = CliRunner().invoke(elvis, ["convert", "a.xml", "a.fld", "--plane", "7", "-o", "d.xml"])
    assert "--plane 7: expected one of the planes 0, 1, 2, 3" in str(outcome.exception)
    assert not (tmp_path / "d.xml").exists()


def test_boundaries_keep_the_fourier_direction(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    data, _ = spanwise(4)
    write(data, "a.xml")
    done = CliRunner().invoke(elvis, ["extract", "a.xml", "a.fld", "--boundary", "all", "-o", "skin.xml"])
    assert done.exit_code == 0, done.output
    skin = read("skin.xml", "skin.fld")
    for text in ("u", "u^2", "u*z + x*y"):
        assert integrate(skin, text).value == pytest.approx(integrate(data, text, over="all").value, rel=1e-9)
    words = ["extract", "a.xml", "a.fld", "--boundary", "all", "--field", "f=u*nx", "-o", "none.xml"]
    assert "all: expected only fields" in str(CliRunner().invoke(elvis, words).exception)
    assert not (tmp_path / "none.xml").exists()


def test_points_do_not_snap_to_walls_along_fourier_directions():
    data, _ = spanwise(2)
    with pytest.raises(ElvisError, match="all: expected data without Fourier directions"):
        at_walls(data, "all", np.array([[0.5, 0.0, 0.3]]), [Expression.of(data, "u")])


@pytest.mark.parametrize("plane", ["0,0,0.7:0,0,2", "z=3.2"])
def test_planes_have_the_values_of_their_position(tmp_path, monkeypatch, plane):
    """The second plane is one period further."""
    monkeypatch.chdir(tmp_path)
    data, _ = spanwise(4)
    write(data, "a.xml")
    found = CliRunner().invoke(elvis, ["extract", "a.xml", "a.fld", "--plane", plane, "-o", "plane.xml"])
    assert found.exit_code == 0, found.output
    cut = read("plane.xml", "plane.fld")
    for x, y in ((0.4, 0.3), (0.8, 0.6)):
        assert cut["u"](x, y) == pytest.approx(data["u"](x, y, 0.7), abs=1e-12)
    for wrong, reason in [
        ("0,0,0:1,0,1", "expected a plane across an axis"),
        ("0.5,0,0:1,0,0", "with a Fourier direction along x, found one along z"),
        ("z=a", "expected P:N or z=0.5"),
    ]:
        words = ["extract", "a.xml", "a.fld", "--plane", wrong, "-o", "none.xml"]
        done = CliRunner().invoke(elvis, words)
        assert done.exit_code != 0
        assert reason in f"{done.output}{done.exception}"
        assert not (tmp_path / "none.xml").exists()
