"""Runtime plugins that ship, against analytic expressions and against the solver's own evaluation."""

from pathlib import Path

import numpy as np
import pytest
from archives import arrays_of

from elvis import Camera, Dataset, Plane, Scene, read, render
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Homogeneous
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.factors import fourier
from elvis.core.quantities.functions import FUNCTIONS
from elvis.core.testing import curved, mixed_volume, ripple
from elvis.plugins.fourier import FourierBox, write_box
from elvis.plugins.fourier.box import BASES
from elvis.plugins.native.waves import waves
from elvis.plugins.nurbs import Nurbs
from elvis.plugins.nurbs.knots import KnotVector
from elvis.plugins.runtime.opening import PluginData
from elvis.plugins.runtime.serving import volume_of
from elvis.plugins.testing import check_volume, values_found

MFEM = Path(__file__).resolve().parents[3] / "shared" / "data" / "solvers" / "mfem"
DEVICES = ("vulkan", "cpu")
#: tolerances of fields (of their range) and of places (of the diagonal of the domain)
FIELD, PLACE = 1e-11, 1e-10


@pytest.fixture(scope="session")
def pipe():
    """The NURBS mesh with its functions, and the solver's own values at points."""
    if not MFEM.is_dir():
        pytest.skip(f"there is no {MFEM}")
    source = Nurbs([MFEM / "pipe_nurbs.mesh", MFEM / "pipe_nurbs.u.gf", MFEM / "pipe_nurbs.w.gf"])
    return source, arrays_of(MFEM / "pipe_nurbs.truth.npz")


@pytest.fixture
def box(tmp_path):
    """A box with the given bases and amplitudes, written and opened."""

    def make(bases, amplitudes, low=(0.0, -1.0, 2.0), high=(1.0, 2.0, 5.0)):
        path = tmp_path / "box.npz"
        write_box(path, np.array(low), np.array(high), bases, {"u": amplitudes}, time=2.5)
        assert FourierBox.opens([path])
        return FourierBox([path])

    return make


def pixels_of(frame):
    """World points and field of the pixels that are seen."""
    y, x = np.nonzero(frame.seen)
    return frame.view.points_of(x, y), frame.field[y, x]


def draw(renderer, volume, plane, size=(120, 120)):
    renderer.show(volume)
    frame = renderer.render(Scene("u", plane=plane, size=size))
    assert frame.counts()["failed"] == 0
    return frame


# NURBS


@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("field", ["u", "w"])
def test_nurbs_match_the_solver(renderer, pipe, device, field):
    source, truth = pipe
    drawing = renderer(device)
    drawing.show(source.volume(field))
    found = drawing.probe(truth["xyz"])
    assert np.array_equal(found.element, truth["elem"])
    assert np.abs(found.reference - truth["ref"]).max() < PLACE
    values = truth[f"f_{field}"][:, 0]
    assert np.abs(found.field - values).max() < FIELD * np.ptp(values)


def test_nurbs_pass_the_test_kit(renderer, pipe):
    check_volume(pipe[0].volume("u"), renderer("vulkan"))


@pytest.mark.parametrize("plane", [Plane((0, 0, 10), (1, 1, 0.2)), Plane((8, 0, 20), (1, 0, 0.3))])
def test_every_pixel_of_a_cut_through_nurbs_matches_probes(renderer, pipe, plane):
    drawing = renderer("vulkan")
    frame = draw(drawing, pipe[0].volume("u"), plane)
    y, x = np.indices(frame.element.shape).reshape(2, -1)
    found = drawing.probe(frame.view.points_of(x, y))
    assert np.array_equal(found.element, frame.element.ravel())
    seen = frame.seen.ravel()
    assert np.abs(found.field - frame.field.ravel())[seen].max() < FIELD * np.ptp(frame.field[frame.seen])


def test_a_rational_field_is_the_map_where_its_values_are_the_control_points(renderer, pipe, tmp_path):
    mesh = pipe[0].mesh
    lines = [f"{point[0]!r}" for point in mesh.points.tolist()]
    path = tmp_path / "x.gf"
    header = "FiniteElementSpace\nFiniteElementCollection: NURBS2\nVDim: 1\nOrdering: 0\n\n"
    path.write_text(header + "\n".join(lines) + "\n")
    source = Nurbs([path, MFEM / "pipe_nurbs.mesh"])
    assert source.fields == ("x",)
    points, values = pixels_of(draw(renderer("vulkan"), source.volume("x"), Plane((0, 0, 10), (1, 1, 0.2))))
    assert np.abs(values - points[:, 0]).max() < PLACE * np.ptp(mesh.points)


def test_bezier_pieces_are_the_spline():
    """Cox and de Boor's recursion gives the same, for knots of every multiplicity."""
    knots = np.array([0, 0, 0, 0, 0.5, 1, 1, 2.5, 2.5, 2.5, 3, 3, 3, 3])
    vector = KnotVector(3, knots)

    def spline(i, p, t):
        if p == 0:
            return ((knots[i] <= t) & (t < knots[i + 1])).astype(float)
        left, right = knots[i + p] - knots[i], knots[i + p + 1] - knots[i + 1]
        first = (t - knots[i]) / left * spline(i, p - 1, t) if left else 0 * t
        return first + ((knots[i + p + 1] - t) / right * spline(i + 1, p - 1, t) if right else 0 * t)

    s = np.linspace(0.01, 0.99, 9)
    for span, matrix in zip(vector.spans, vector.pieces(), strict=True):
        t = knots[span] + s * (knots[span + 1] - knots[span])
        bernstein = np.stack([(1 - s) ** 3, 3 * s * (1 - s) ** 2, 3 * s**2 * (1 - s), s**3], axis=1)
        wanted = np.stack([spline(i, 3, t) for i in range(vector.count)], axis=1)
        assert np.abs(bernstein @ matrix - wanted).max() < 1e-14


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("dimension\n3", "dimension\n2", "dimension: expected 3, found 2"),
        ("2 3 0 0 0 1 1 1", "2 3 0 0 1 0 1 1", "knotvectors: expected 6 ascending knots"),
        ("0 0 1\n", "7 0 1\n", "edges: expected a knot vector from 0 to 2, found 7"),
        ("weights\n1\n", "weights\n", r"weights: expected an array \(120,\), found \(119,\)"),
        ("weights\n1\n", "weights\n-1\n", "weights: expected positive weights, found -1"),
        ("2 0 0\n", "2 0 zero\n", "Ordering: expected numbers"),
    ],
)
def test_damaged_nurbs_meshes_give_a_one_line_error(pipe, tmp_path, old, new, sentence):
    path = tmp_path / "spoilt.mesh"
    text = (MFEM / "pipe_nurbs.mesh").read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(ElvisError, match=rf"spoilt\.mesh: {sentence}"):
        Nurbs([path])


# Fourier


@pytest.mark.parametrize("device", DEVICES)
def test_a_fourier_box_is_its_closed_form(renderer, box, device):
    """The plugin's own words: sin 6 pi x cos 4 pi (y+1)/3 sin 2 pi (z-2)/3, and a constant."""
    amplitudes = np.zeros((7, 5, 3))
    amplitudes[6, 3, 2], amplitudes[0, 0, 0] = 2.0, 0.25
    volume = box(("fourier",) * 3, amplitudes).volume("u")
    points, values = pixels_of(draw(renderer(device), volume, Plane((0.5, 0.5, 3.5), (0.3, 1, 0.5))))
    x, y, z = points.T
    truth = 0.25 + 2 * np.sin(6 * np.pi * x) * np.cos(4 * np.pi * (y + 1) / 3) * np.sin(2 * np.pi * (z - 2) / 3)
    assert np.abs(values - truth).max() < FIELD * 4


@pytest.mark.sampled
@pytest.mark.parametrize("ends", BASES)
@pytest.mark.parametrize("middle", BASES)
def test_every_tensor_product_matches_numpy(renderer, box, ends, middle):
    """Also kept: what the kit asks, in which the device is compared with NumPy."""
    amplitudes = np.random.default_rng(3).normal(size=(6, 1, 9))
    check_volume(box((ends, middle, ends), amplitudes).volume("u"), renderer("cpu"))


def test_high_frequencies_keep_their_digits(renderer, box):
    amplitudes = np.zeros((257, 1, 1))
    amplitudes[255, 0, 0] = 1.0
    volume = box(("fourier",) * 3, amplitudes, low=(0, 0, 0), high=(1, 1, 1)).volume("u")
    drawing = renderer("vulkan")
    points = np.random.default_rng(2).uniform(0, 1, (2000, 3))
    drawing.show(volume)
    assert np.abs(drawing.probe(points).field - np.cos(2 * np.pi * 128 * points[:, 0])).max() < 2e-12


def test_time_and_fields_are_read(box):
    source = box(("fourier", "legendre", "fourier"), np.ones((1, 2, 3)))
    assert (source.time, source.fields) == (2.5, ("u",))


# closed forms

WAVES = Plane((0.5, 0.5, 0.45), (0.1, 0.2, 1.0))


@pytest.fixture(scope="session")
def mixed():
    """All shapes, curved."""
    return Dataset(curved(mixed_volume(seed=1), ripple(0.02), n=4))


def test_a_closed_form_is_drawn_on_every_shape(renderer, mixed):
    volume = volume_of(mixed, ["sin(20*x)*exp(y) - z^2/(1+x)"])
    assert len(volume.parts) == len(mixed.mesh.elements) == 4
    points, values = pixels_of(draw(renderer("vulkan"), volume, WAVES))
    x, y, z = points.T
    assert np.abs(values - (np.sin(20 * x) * np.exp(y) - z**2 / (1 + x))).max() < FIELD


@pytest.mark.thorough
def test_devices_agree_on_a_closed_form(mixed):
    camera = Camera((1.5, 0.2, 4.5), (1.5, 0.5, 0.45), (0.0, 1.0, 0.0), height=3.2)
    scene = {"field": "log(0.3+x)*tanh(y)", "plane": WAVES, "size": (24, 24), "camera": camera}
    drawn, wanted = (render(mixed, device=name, **scene) for name in ("cpu", "reference"))
    assert np.array_equal(drawn.element, wanted.element)
    assert len(np.unique(drawn.element)) > 5
    assert np.nanmax(np.abs(drawn.field - wanted.field)) < FIELD
    assert wanted.scene.field == scene["field"]


#: arguments of the functions, and units in the last place that they may be off
ACCURACY = {"sin": 2, "cos": 2, "tan": 4, "exp": 2, "log": 2, "sinh": 6, "cosh": 3, "tanh": 5, "sqrt": 1, "abs": 0}
ACCURACY |= {"sign": 0, "atan": 2, "asin": 5, "acos": 5}
#: of two operands, the second of which is y
BINARY = {"min": 0, "max": 0, "atan2": 4}
#: of matrices: their bars are in test_eigenvalues, and the device's in test_predefined
OF_MATRICES = {"middle_eigenvalue", "imaginary_root"}


def test_every_function_has_a_tolerance():
    assert set(ACCURACY) | set(BINARY) | OF_MATRICES | {"pow"} == set(FUNCTIONS)


@pytest.mark.sampled
@pytest.mark.parametrize("device", DEVICES)
@pytest.mark.parametrize("half", [1.0, 256.0])
def test_elementary_functions_are_exact_to_the_last_digits(renderer, box, device, half):
    """In a box whose half lengths are powers of two, so that places are the same whoever computes them."""
    drawing, corner = renderer(device), np.full(3, half)
    opened = PluginData("fourier", box(("fourier",) * 3, np.ones((1, 1, 1)), -corner, corner))
    texts = {name: f"{name}(x)" for name in ACCURACY} | {name: f"{name}(x, y)" for name in BINARY}
    drawing.show(volume_of(opened, ["u", *texts.values()]))
    points = np.random.default_rng(5).uniform(-1, 1, (4000, 3))
    for name, tolerance in (ACCURACY | BINARY).items():
        samples = drawing.sample_elements(0, np.zeros(4000, np.int64), points, texts[name])
        operands = samples.position.astype(np.longdouble).T[: FUNCTIONS[name].arity]
        with np.errstate(invalid="ignore"):
            truth = FUNCTIONS[name].numpy(*operands)
        assert np.array_equal(np.isnan(samples.value), np.isnan(truth)), name
        ulps = np.abs(samples.value - truth) / np.spacing(np.abs(truth.astype(np.float64)))
        assert np.nanmax(ulps) <= tolerance, name


# quasi-3D data

NEKTAR = MFEM.parents[1] / "nektar"
CHANNEL = (NEKTAR / "chan3dh1d" / "chan3DH1D.xml", NEKTAR / "chan3dh1d" / "chan3DH1D_zVariation.fld")
SQUARE = (NEKTAR / "triquad_h1d" / "square_mix.xml", NEKTAR / "triquad_h1d" / "zero-homo-plane_pre.fld")


@pytest.mark.thorough
@pytest.mark.parametrize(("files", "field"), [(CHANNEL, "u"), (SQUARE, "u")])
def test_quasi_3d_data_are_cut_like_solid_ones(renderer, files, field):
    if not NEKTAR.is_dir():
        pytest.skip(f"there is no {NEKTAR}")
    dataset = read(*files)
    volume = volume_of(dataset, [field])
    check_volume(volume, renderer("vulkan"))
    frame = render(dataset, field=field, plane=Plane((0.4, 0.4, 0.3), (1, 2, 3)), size=(60, 60), device="vulkan")
    points, values = pixels_of(frame)
    truth = values_found(dataset, field, points)
    inner = ~np.isnan(truth)
    assert inner.mean() > 0.99
    assert np.abs(values - truth)[inner].max() < FIELD * 3


@pytest.mark.parametrize("basis", [b for b in Basis if "FOURIER" in b.name])
def test_waves_are_the_fourier_functions_of_the_format(basis):
    zeta = np.linspace(-1, 1, 11)
    turns, cosines, sines, shift = waves(Homogeneous((basis,), (1.0,), tuple(range(6))))[:, 0].T
    angle = np.pi * turns * (zeta[:, None] + shift)
    found = cosines * np.cos(angle) + sines * np.sin(angle)
    assert np.abs(found - fourier(basis, range(6), zeta)[0]).max() < 1e-14


def test_the_range_of_all_is_that_of_the_bounds(box):
    """A cosine and its mean: a picture of a plane where it is 3 all over has the colours of [1, 5] nonetheless."""
    amplitudes = np.zeros((3, 1, 1))
    amplitudes[0], amplitudes[1] = 3.0, 2.0
    opened = PluginData("fourier", box(("fourier",) * 3, amplitudes, (0.0,) * 3, (1.0,) * 3))
    plane = Plane((0.25, 0.5, 0.5), (1.0, 0.0, 0.0))
    frame = render(opened, Scene("u", plane, size=(30, 30), range="all"))
    assert np.allclose(frame.field[frame.seen], 3.0, rtol=0, atol=1e-12)
    low, high = frame.range
    assert low <= 1.0 + 1e-9
    assert high >= 5.0 - 1e-9
    assert high - low < 4.1
    with pytest.raises(ElvisError, match="no bounds of 'sin\\(u\\)' over all data are known: use two values"):
        render(opened, Scene("sin(u)", plane, size=(30, 30), range="all"))
