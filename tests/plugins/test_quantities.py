"""Quantities on a device: values and gradients on every shape against NumPy, pictures, what plugins can and can't."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from elvis import Dataset, Plane, read, render
from elvis.core.base.errors import ElvisError
from elvis.core.quantities import Expression
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.tree import world_derivative
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, curved, grid, mixed_plane, mixed_volume, ripple, scattered
from elvis.plugins.runtime.opening import PluginData
from elvis.plugins.runtime.serving import volume_of

NEKTAR = Path(__file__).resolve().parents[3] / "shared" / "data" / "nektar"
#: of the largest magnitude
VALUE, GRADIENT = 1e-11, 1e-7

#: gradients by the chain rule, and by differences
TEXTS = ("x*atan2(u*v, 2+v) + element/(2+order)", "q_criterion - jacobian*x + quality^0.7")


def flow(mesh, seed=2):
    """Fields of different orders, discontinuous, with random coefficients."""
    rng, dataset = np.random.default_rng(seed), Dataset(mesh, time=0.25)
    fields = []
    for name, modes in zip("uvw"[: mesh.dimension], (4, 3, 5), strict=False):
        field = approximated(dataset, name, lambda p: p[:, 0], modes)
        blocks = [
            replace(b, coefficients=b.coefficients + 0.1 * rng.normal(size=b.coefficients.shape)) for b in field.blocks
        ]
        fields.append(replace(field, blocks=tuple(blocks)))
    return replace(dataset, fields=tuple(fields))


def asked(part, count=40):
    """Elements of a part and reference points well inside (n, 3), away from the tips of pyramids."""
    shape = part.solve.patches[0].shape
    reference, middle = np.zeros((count, 3)), shape.vertices.mean(axis=0)
    reference[:, : shape.dimension] = middle + 0.9 * (scattered(shape, count, seed=1) - middle)
    if shape is Shape.PYRAMID:
        reference = reference[reference[:, 2] < 0.7]
    return shape, np.resize(np.arange(len(part)), len(reference)), reference


@cache
def bent_flow(dimension):
    """Elements of all shapes, and the volume of two quantities there."""
    mesh = curved(mixed_volume(seed=1) if dimension == 3 else mixed_plane(seed=1), ripple(0.02), n=4)
    dataset = flow(mesh)
    return dataset, volume_of(dataset, ("u", *TEXTS))


@pytest.mark.sampled
@pytest.mark.parametrize("text", TEXTS)
@pytest.mark.parametrize("shape", [shape for shape in Shape if shape.dimension > 1], ids=lambda shape: shape.label)
def test_quantities_and_their_gradients_match_numpy(renderer, shape, text):
    (dataset, volume), drawing = bent_flow(shape.dimension), renderer("vulkan")
    drawing.show(volume)
    expression = Expression.of(dataset, text)
    evaluator = Evaluator(dataset, [expression])
    (number,) = (k for k, part in enumerate(volume.parts) if asked(part)[0] is shape)
    _, elements, reference = asked(volume.parts[number])
    ids = volume.parts[number].element_ids[elements]
    centre = drawing.sample_elements(number, elements[:1], reference[:1], text).center
    found = drawing.sample_elements(number, elements, reference - centre, text)
    truth = evaluator.at(expression, ids, reference)
    assert np.abs(found.value - truth).max() < VALUE * np.abs(truth).max()
    gradients = differences(evaluator, expression, ids, reference)[:, : shape.dimension]
    error = np.abs(found.gradient[:, : shape.dimension] - gradients).max()
    assert error < GRADIENT * np.abs(gradients).max()


def differences(evaluator, expression, ids, reference, step=1e-4):
    """(n, 3) gradients by differences of fourth order."""
    columns = []
    for axis in np.eye(3):
        near, far = (
            evaluator.at(expression, ids, reference + k * step * axis)
            - evaluator.at(expression, ids, reference - k * step * axis)
            for k in (1, 2)
        )
        columns.append((8 * near - far) / (12 * step))
    return np.stack(columns, axis=1)


def test_a_part_has_all_quantities_by_name_and_shares_their_inputs(renderer):
    dataset = flow(curved(mixed_volume(seed=1), ripple(0.02), n=3))
    volume = volume_of(dataset, ["u", "v", "sin(u+v)", "sqrt(u*v*w)", "d(u,x)"])
    for part in volume.parts:
        assert set(part.quantities) == {"u", "v", "sin(u+v)", "sqrt(u*v*w)", "d(u,x)"}
        nets = {name: id(quantity.buffers["coefficients"]) for name, quantity in part.quantities.items()}
        assert nets["sin(u+v)"] == nets["sqrt(u*v*w)"]
        assert nets["u"] == nets["d(u,x)"] == id(part.buffers["coefficients"])


def test_fields_missing_on_an_element_are_nan_there(renderer):
    """The first quantity says which elements there are."""
    dataset = flow(mixed_volume(seed=1))
    partial = replace(dataset.field("v"), blocks=dataset.field("v").blocks[:2])
    dataset = replace(dataset, fields=(dataset.field("u"), partial))
    drawing, volume = renderer("vulkan"), volume_of(dataset, ["u", "v", "u+v"])
    assert sum(map(len, volume.parts)) == len(dataset.mesh.domain_ids())
    assert sum(map(len, volume_of(dataset, ["u+v"]).parts)) == sum(map(len, partial.blocks))
    drawing.show(volume)
    held = np.concatenate([block.element_ids for block in partial.blocks])
    for number, part in enumerate(volume.parts):
        elements = np.arange(len(part))
        for text in ("v", "u+v"):
            found = drawing.sample_elements(number, elements, np.zeros((len(part), 3)), text).value
            assert np.array_equal(np.isnan(found), ~np.isin(part.element_ids, held))


@pytest.mark.parametrize("text", ["vorticity_z + x", "1/(u-u)"])
def test_pictures_of_expressions_match_numpy(text):
    dataset = flow(curved(grid(Shape.TETRAHEDRON, 2), ripple(0.02), n=3))
    scene = {"field": text, "plane": Plane((0.5, 0.5, 0.45), (0.1, 0.2, 1.0)), "size": (50, 50)}
    frame = render(dataset, device="vulkan", **scene)
    expression = Expression.of(dataset, text)
    truth = Evaluator(dataset, [expression]).at(expression, frame.element[frame.seen], frame.reference[frame.seen])
    found = frame.field[frame.seen]
    assert np.array_equal(np.isnan(found), np.isnan(truth))
    assert np.isnan(found).all() == (text == "1/(u-u)")
    if text != "1/(u-u)":
        assert np.abs(found - truth).max() < VALUE * np.ptp(truth)


def test_second_derivatives_match_numpy(renderer):
    """By differences of sixth order, as are gradients of derivatives; NumPy has both exactly."""
    dataset, drawing = flow(curved(grid(Shape.PRISM, 1), ripple(0.02), n=3)), renderer("vulkan")
    second, first = (Expression.of(dataset, text) for text in ("laplacian(u)*v", "vorticity_z*u"))
    volume = volume_of(dataset, [second.text, first.text])
    drawing.show(volume)
    (part,), (_, elements, reference) = volume.parts, asked(volume.parts[0])
    ids, centre = part.element_ids[elements], drawing.sample_elements(0, elements[:1], reference[:1]).center
    found = drawing.sample_elements(0, elements, reference - centre)
    truth = Evaluator(dataset, [second]).at(second, ids, reference)
    assert np.abs(found.value - truth).max() < 1e-10 * np.abs(truth).max()

    along = [Expression(f"d{axis}", world_derivative(first.root, axis)) for axis in range(3)]
    gradient = np.stack([Evaluator(dataset, along).at(each, ids, reference) for each in along], axis=1)
    in_element = np.einsum("nc,nci->ni", gradient, found.jacobian)
    gradients = drawing.sample_elements(0, elements, reference - centre, first.text).gradient
    assert np.abs(gradients - in_element).max() < 1e-10 * np.abs(in_element).max()


def test_quasi_3d_data_have_expressions_of_all_their_fields(renderer):
    if not NEKTAR.is_dir():
        pytest.skip(f"there is no {NEKTAR}")
    dataset = read(*(NEKTAR / "chan3dh1d" / name for name in ("chan3DH1D.xml", "chan3DH1D_zVariation.fld")))
    texts = ("u", "speed", "d(u,z) + d(v,x)*z", "vorticity", "lambda2 + strain_xz")
    volume, drawing = volume_of(dataset, texts), renderer("vulkan")
    drawing.show(volume)
    for number, part in enumerate(volume.parts):
        rng = np.random.default_rng(3)
        reference, elements = rng.uniform(-0.9, 0.0, (40, 3)), np.resize(np.arange(len(part)), 40)
        centre = drawing.sample_elements(number, elements[:1], reference[:1]).center
        for text in texts:
            expression = Expression.of(dataset, text)
            truth = Evaluator(dataset, [expression]).at(expression, part.element_ids[elements], reference)
            found = drawing.sample_elements(number, elements, reference - centre, text)
            assert np.abs(found.value - truth).max() < VALUE * max(1, np.abs(truth).max()), text


# plugins


@pytest.fixture
def opened(tmp_path):
    """A box with the field u = cos(2 pi x), and a constant one."""
    from elvis.plugins.fourier import FourierBox, write_box

    wave = np.zeros((3, 1, 1))
    wave[1] = 1.0
    path = tmp_path / "box.npz"
    write_box(path, np.zeros(3), np.ones(3), ("fourier",) * 3, {"u": wave, "one": np.ones((1, 1, 1))})
    return PluginData("fourier", FourierBox([path]))


def test_a_plugins_field_makes_expressions(renderer, opened):
    drawing = renderer("vulkan")
    drawing.show(volume_of(opened, ["d(u,x)*y", "u", "u^2"]))
    points = np.random.default_rng(1).uniform(-0.9, 0.9, (50, 3))
    x, y, _ = ((points + 1) / 2).T
    wave, derivative = np.cos(2 * np.pi * x), -2 * np.pi * np.sin(2 * np.pi * x)
    for text, truth in ((None, derivative * y), ("d(u,x)*y", derivative * y), ("u", wave), ("u^2", wave**2)):
        assert np.abs(drawing.sample_elements(0, np.zeros(50, np.int64), points, text).value - truth).max() < 1e-12
    gradients = drawing.sample_elements(0, np.zeros(50, np.int64), points, "u^2").gradient[:, 0]
    assert np.abs(gradients - wave * derivative).max() < 1e-12


@pytest.mark.parametrize(
    ("texts", "sentence"),
    [
        (["u*order"], "there is no order of elements that a runtime plugin draws"),
        (["u*"], "expected a number, a name or (, found its end"),
        (["w*t"], "there is no 'w'; the fields are u, one; there are also x, y, z, t, pi"),
    ],
)
def test_unsupported_quantities_of_a_plugin_are_reported(opened, texts, sentence):
    with pytest.raises(ElvisError) as error:
        volume_of(opened, texts)
    assert sentence in str(error.value)


@pytest.mark.parametrize("shape", Shape.of_dimension(3))
def test_polynomials_are_known_by_their_degree(shape):
    """Isosurfaces of them are found with proof; degree 0 stands for all others.

    The degree is that in each direction, on pyramids in eta, where derivatives are fractions.
    """
    texts = ("u", "v", "w", "u*v/3", "(u-w)^2 + x*element", "d(u,x)", "sqrt(u)", "u/v", "u*jacobian", "(u+v)^3")
    (part,) = volume_of(flow(grid(shape, 1)), texts).parts
    degree = 2 if shape is Shape.TETRAHEDRON else 3
    expected = [3, 2, 4, 5, 8, degree, 0, 0, 0, 9] if shape is not Shape.PYRAMID else [4, 2, 6, 6, 12, 0, 0, 0, 0, 12]
    assert [part.quantities[text].degree for text in texts] == expected
    assert part.degree == expected[0]


def test_expressions_that_would_compile_for_minutes_are_rejected():
    with pytest.raises(ElvisError, match="at most 1000 parts in pictures"):
        volume_of(flow(grid(Shape.TETRAHEDRON, 1)), ["d(" * 8 + "tan(x*y)^tan(x)" + ",x)" * 8])


def test_shared_inputs_are_on_the_device_once(renderer):
    volume = volume_of(flow(mixed_volume(seed=1)), ["u", "sqrt(u*v)", "sin(v*w + u)", "d(u,x)"])
    drawing = renderer("vulkan")
    drawing.show(volume)
    loaded = drawing.stages.loaded
    distinct = {id(data): data.nbytes for part in volume.parts for data in part.buffers.values()}
    assert loaded.bytes == sum(distinct.values())
    assert len({id(part.buffers["control_points"]) for part in volume.parts}) == 1 < len(volume.parts)
    for number in range(len(volume.parts)):
        assert loaded.bindings(number, "u")["coefficients"] is loaded.buffers[number]["coefficients"]
        stacks = [loaded.bindings(number, text)["coefficients"] for text in ("sqrt(u*v)", "sin(v*w + u)")]
        assert stacks[0] is stacks[1]
        assert loaded.bindings(number, "d(u,x)")["control_points"] is loaded.buffers[number]["control_points"]
