"""Small files of kinds that once gave wrong numbers without a word, each against its closed form.

The files lie next to the repository; a page next to each derives the values.
"""

import math
import re

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import FormatError, integrate, open_series, read, sample, trace
from elvis.plugins.command.command import elvis as group

#: an accuracy of closed forms in floating-point numbers
ROUNDING = 1e-12
#: of values that are rounded in the pages that derive them
DIGITS_8 = 6e-9
CUBE_SIDES = dict.fromkeys(("imin", "imax", "jmin", "jmax", "kmin", "kmax"), 1.0)
SQUARE_SIDES = dict.fromkeys(("imin", "imax", "jmin", "jmax"), 1.0)
#: edges of a rectangle of 2 x 1, as pairs of length and the integral of y
RECTANGLE = {"bottom": (2, 0), "right": (1, 0.5), "top": (2, 2), "left": (1, 0.5)}
#: area of the disc of quadratic triangles
DISC = 3.1415562828
#: along x, in the meshes that lines cross
ALONG_X = ["1+0*x", "0*x", "0*x"]
#: the faces of a pyramid with its tip over a corner
CORNER_PYRAMID = {1: 1, 2: 0.5, 3: math.sqrt(0.5), 4: math.sqrt(0.5), 5: 0.5}


@pytest.fixture(scope="module")
def reported(findings):
    """Read files of the folder whose name begins with a number."""
    cases = findings.parent / "findings3"
    if not cases.is_dir():
        pytest.skip(f"there is no {cases}")

    def of(number, *names, **options):
        (folder,) = cases.glob(f"{number}-*")
        return read(*[folder / name for name in names], reader=options, cache=False)

    of.folder = cases
    return of


def total(dataset, quantity="1", over="domain"):
    """The value in the last row of an integral."""
    return integrate(dataset, quantity, over, error=1e-5)[-1].value


def areas(dataset):
    """Measures of all boundaries by name."""
    return {row.over: row.value for row in integrate(dataset, "1", "all")}


VOLUMES = [
    ("W01", ["emptyblock.e"], 2),
    ("W01", ["emptyfirst.e"], 2),
    ("W04", ["run.e.2.0", "run.e.2.1"], 2),
    ("W04", ["piece_0.vtu", "piece_1.vtu"], 2),
    ("W04", ["u_p0_000000.vtu", "u_p1_000000.vtu"], 2),
    ("W04", ["split_1.msh", "split_2.msh"], 1),
    ("W05", ["ghosts.msh"], 1),
    ("W06", ["mixed_orders_mesh.msh"], 1.075),
    ("W06", ["mixed41.msh"], 0.5 + 0.5 + 2 / 15),
    ("W15", ["commented.xml"], 1),
    ("W15", ["twice.xml"], 1),
    ("W21", ["mixed3.cgns"], 1),
    ("W21", ["mixed4.cgns"], 1),
    ("X02", ["blank.vol"], 2),
    ("X04", ["unset.e"], 2),
    ("X07", ["unit.mesh"], 1),
]


@pytest.mark.parametrize(("number", "names", "volume"), VOLUMES)
def test_measures_of_domains(reported, number, names, volume):
    assert total(reported(number, *names)) == pytest.approx(volume, rel=ROUNDING)


@pytest.mark.parametrize("name", ["disc_v3.cgns", "disc_v4.cgns"])
def test_versions_of_cgns_are_equivalent(reported, name):
    assert total(reported("W21", name)) == pytest.approx(DISC, abs=1e-10)


@pytest.mark.parametrize("names", [["piece_0.vtu", "piece_1.vtu"], ["split_1.msh", "split_2.msh"]])
def test_parts_are_not_steps(reported, names):
    (folder,) = reported.folder.glob("W04-*")
    with pytest.raises(FormatError, match="found one state"):
        open_series(*[folder / name for name in names])


def test_a_single_part_is_reported_as_a_part(reported):
    assert "1 of the 2 parts" in reported("W04", "run.e.2.0").remarks[-1]


BOUNDARIES = [
    ("W01", ["emptyblock.e"], {"inflow": 1, "outflow": 1, "boundary": 8}),
    ("W01", ["emptyfirst.e"], {"inflow": 1, "outflow": 1, "boundary": 8}),
    ("W02", ["nc.mesh"], {f"boundary{n}": 1 for n in range(1, 5)}),
    ("W03", ["mortar_mesh.h5"], {"bottom": 2, "front": 2, "right": 1, "back": 2, "left": 1, "top": 2}),
    ("W10", ["dg3.e"], {"in": 1, "out": 1, "boundary": 12}),
    ("W13", ["sets.mesh"], {"in": 1, "wall": 4, "all sides": 6}),
    ("W22", ["s345.cgns"], CUBE_SIDES),
    ("W22", ["s333.cgns"], CUBE_SIDES),
    ("W22", ["u_vertex.cgns"], CUBE_SIDES),
    ("W22", ["u_elrange.cgns"], CUBE_SIDES),
    ("W22", ["s2d.cgns"], SQUARE_SIDES),
    ("W23", ["p1.mesh"], {f"boundary{n}": 1 for n in range(1, 7)}),
    ("W23", ["p2.mesh"], {f"boundary{n}": 1 for n in range(1, 7)}),
    ("W23", ["q2.mesh"], {f"boundary{n}": area for n, area in CORNER_PYRAMID.items()}),
    ("X01", ["box.msh"], {"all": 10}),
    ("X04", ["unset.e"], {"sides 7": 1, "boundary": 5}),
    ("X05", ["named.xml"], {"inflow": 1, "far field": 5}),
    ("X07", ["unit.mesh"], {"boundary1": 1, "boundary2": 3}),
]


@pytest.mark.parametrize(("number", "names", "right"), BOUNDARIES)
def test_measures_of_boundaries(reported, number, names, right):
    found = areas(reported(number, *names))
    found.pop("total", None)
    assert found == pytest.approx(right, rel=ROUNDING)


def test_curved_faces_next_to_small_ones(reported):
    """Nine hexahedra of which four are curved: inner sides are none of the boundary."""
    assert total(reported("W02", "nc3.mesh", "nc3.u.gf"), over="all") == pytest.approx(6.0033284, abs=1e-6)


@pytest.mark.parametrize("name", ["pt.vtu", "pt.e"])
def test_a_curved_pyramid_next_to_a_tetrahedron(reported, name):
    assert total(reported("W23", name), over="all") == pytest.approx(4.7518976, abs=1e-6)


@pytest.mark.parametrize("name", ["shell.e", "tri3d.e", "quad3d.e"])
def test_sides_of_shells_are_edges(reported, name):
    dataset = reported("W07", name)
    found = {over: tuple(row.value for row in integrate(dataset, ["1", "y"], over)) for over in RECTANGLE}
    assert found == pytest.approx({over: pytest.approx(pair, abs=ROUNDING) for over, pair in RECTANGLE.items()})


def test_numbers_distinguish_boundaries_of_one_name(reported):
    dataset = reported("X03", "sides.vol")
    assert [total(dataset, over=str(number)) for number in range(1, 5)] == pytest.approx([2, 1, 2, 1], rel=ROUNDING)


LINES = [
    ("W02", ["mortar_mesh.h5"], ALONG_X, (0.1, 0.3, 0.3), "right", 1.9),
    ("W10", ["dg3.e"], None, (0.1, 0.5, 0.5), "out", 2.9),
    ("X01", ["box.msh"], ALONG_X, (0.1, 0.3, 0.3), "boundary", 1.9),
]


@pytest.mark.parametrize(("number", "names", "velocity", "seed", "end", "length"), LINES)
def test_lines_cross_inner_sides(reported, number, names, velocity, seed, end, length):
    line = trace(reported(number, *names), [seed], velocity=velocity)
    assert line.ends[line.end[0]] == end
    assert line.length[-1] == pytest.approx(length, abs=1e-10)


def test_a_line_turns_once_through_hanging_nodes(reported):
    line = trace(reported("W02", "nc.mesh", "vel.gf"), [(0.5, 0.1)], velocity="vel_x,vel_y", duration=2 * math.pi)
    assert line.ends[line.end[0]] == "duration"
    assert line.points[-1, :2] == pytest.approx((0.5, 0.1), abs=1e-9)


DISTANCES = [
    ("W02", "nc.mesh", (0.5, 0.48), -0.48),
    ("W23", "p1.mesh", (0.25, 0.5, 0.45), -0.25),
    ("W23", "p2.mesh", (0.25, 0.5, 0.45), -0.25),
]


@pytest.mark.parametrize(("number", "name", "point", "distance"), DISTANCES)
def test_distances_pass_inner_sides(reported, number, name, point, distance):
    found = sample(reported(number, name), "distance(all)", [point]).values
    assert found[0, 0] == pytest.approx(distance, abs=1e-11)


NAN = math.nan
#: files, points and all fields there
PARTS = [
    (["blockvar1.e"], [(0.5, 0.5, 0.5), (1.5, 0.5, 0.5)], {"u": (0.5, 1.5), "stress": (1, NAN)}),
    (["cht.vtm"], [(0.5, 0.5, 0.5), (2.5, 0.5, 0.5)], {"u": (0.5, NAN), "T": (NAN, 2.5)}),
    (["partial_elem.msh"], [(0.6, 0.3, 0.0), (0.3, 0.6, 0.0)], {"flux": (5, NAN)}),
    (["partial_node.msh"], [(0.6, 0.3, 0.0), (0.3, 0.6, 0.0)], {"T": (1.9, NAN)}),
]


@pytest.mark.parametrize(("names", "points", "right"), PARTS)
def test_fields_exist_on_parts(reported, names, points, right):
    dataset = reported("W08", *names)
    assert set(dataset) == set(right)
    for name, values in right.items():
        assert sample(dataset, name, points).values[:, 0] == pytest.approx(values, abs=ROUNDING, nan_ok=True)


def test_corners_of_curved_triangles_carry_linear_data(reported):
    dataset = reported("W08", "p1_on_p2.msh")
    assert list(dataset) == ["T"]
    assert sample(dataset, "T", [(0, 0), (1, 0), (0, 1)]).values[:, 0] == pytest.approx((1, 2, 3), abs=ROUNDING)


def test_flux_of_curved_elements_is_within_its_error(reported):
    """NGSolve's own values, and its integral of the divergence."""
    dataset = reported("W09", "disc.vol", "disc.flux.gfu", spaces="HDiv:1")
    (folder,) = reported.folder.glob("W09-*")
    truth = np.loadtxt(folder / "truth2.csv", delimiter=",", skiprows=1)
    samples = sample(dataset, ["flux_x", "flux_y"], truth[:, :2])
    assert np.all(np.abs(samples.values - truth[:, 3:]) <= samples.errors)
    assert samples.errors.max() < 1e-4
    row = integrate(dataset, "flux_x*nx+flux_y*ny", "circle")[-1]
    assert abs(row.value + 5.88280807) <= row.error + DIGITS_8
    assert row.error < 1e-3


def test_rational_cells_are_within_their_error(reported):
    dataset = reported("W11", "bez1.vtu")
    for quantity, right in (("1", 0.75 * math.pi), ("x", 7 / 3)):
        row = integrate(dataset, quantity)[-1]
        assert abs(row.value - right) <= min(row.error, 1e-6)


@pytest.mark.parametrize("space", ["nd_r2d", "rt_r2d"])
def test_plane_vectors_have_three_components(reported, space):
    """Against MFEM's own values at points of each element."""
    mfem = pytest.importorskip("mfem.ser")
    dataset = reported("W12", "q.mesh", f"q_{space}.gf")
    assert list(dataset) == [f"{space}_{axis}" for axis in "xyz"]
    (folder,) = reported.folder.glob("W12-*")
    mesh = mfem.Mesh(str(folder / "q.mesh"), 1, 1)
    function = mfem.GridFunction(mesh, str(folder / f"q_{space}.gf"))
    rule = mfem.IntRules.Get(mesh.GetElementGeometry(0), 4)
    for element in range(mesh.GetNE()):
        transformation = mesh.GetElementTransformation(element)
        values, points = mfem.DenseMatrix(), mfem.DenseMatrix()
        function.GetVectorValues(transformation, rule, values, points)
        own = sample(dataset, None, points.GetDataArray().T)
        assert own.values == pytest.approx(values.GetDataArray().T, abs=float(np.max(own.errors)) + ROUNDING)


def test_nodes_at_gauss_points_are_recognised(reported):
    assert sample(reported("W18", "gauss_quads.vtu"), None, [(0.2, 0.5)]).values[0, 0] == pytest.approx(0.008)
    assert total(reported("W18", "all5_gll.vtu")) == pytest.approx(1.0212887, abs=5e-8)


def test_extrema_over_steps_are_within_the_stated_error(reported, tmp_path):
    """Minima, maxima and their times at points, against those of the steps."""
    (folder,) = reported.folder.glob("N-avg1*")
    steps = sorted(folder.glob("w_?.chk"))
    arguments = ["average", folder / "w.xml", *steps, "--extrema", "-o", tmp_path / "extrema.fld"]
    outcome = CliRunner().invoke(group, list(map(str, arguments)))
    assert outcome.exit_code == 0
    told = dict(re.findall(r"note: (\w+): no basis represents it: its error is at most ([0-9.e+-]+)", outcome.stderr))
    points = np.random.default_rng(0).random((300, 3))
    series = open_series(folder / "w.xml", *steps)
    found = read(folder / "w.xml", tmp_path / "extrema.fld")
    for name in "uv":
        values = np.array([sample(step, name, points).values[:, 0] for step in series])
        times = series.times[[values.argmin(axis=0), values.argmax(axis=0)]]
        wanted = {"min": values.min(axis=0), "max": values.max(axis=0), "min_time": times[0], "max_time": times[1]}
        for kind, truth in wanted.items():
            own = sample(found, f"{name}_{kind}", points).values[:, 0]
            assert np.abs(own - truth).max() <= float(told[f"{name}_{kind}"]) * np.abs(truth).max()
