"""Complex fields agree with NumPy's complex numbers, in expressions and at phases."""

import json
from dataclasses import replace

import numpy as np
import pytest

from elvis import Dataset, ElvisError, Shape, at_phase, deform, sample
from elvis.core.data.complex_fields import ComplexChoice, cosine_and_sine, missing_components, pairs_in
from elvis.core.data.conversion_errors import REPORT, ConversionErrors
from elvis.core.quantities import Expression, Names
from elvis.core.testing import approximated, grid
from elvis.plugins.data.added_quantities import recorded_facts
from elvis.plugins.data.phases import with_complexes, without_phase

#: complex functions whose parts are in the spaces below
WAVES = {
    "p": lambda x: x[:, 0] + 1j * x[:, 1] ** 3,
    "E_x": lambda x: x[:, 0] ** 2 - 0.3j * x[:, 1],
    "E_y": lambda x: 1 + 1j * x[:, 0] * x[:, 1],
}
POINTS = np.array([[0.3, 0.4], [0.7, 0.9], [0.11, 0.62]])
PARTS = {"p": ("p_re", "p_im"), "E_x": ("E_re_x", "E_im_x"), "E_y": ("E_re_y", "E_im_y")}


def waves(modes=(4, 4)):
    data = Dataset(grid(Shape.TRIANGLE, 1))
    fields = []
    for name, pair in PARTS.items():
        for part, count, own in zip(pair, modes, (np.real, np.imag), strict=True):
            fields.append(approximated(data, part, lambda x, own=own, name=name: own(WAVES[name](x)), count))
    return replace(data, fields=tuple(fields))


def value(data, text):
    return sample(data, text, POINTS)[text]


def expected(name, degrees=0.0):
    return WAVES[name](np.column_stack([POINTS, np.zeros(3)])) * np.exp(1j * np.radians(degrees))


def test_functions_of_complex_fields_match_those_of_numpy():
    data = waves()
    assert Names.of(data).complexes == PARTS
    found = {
        text: value(data, text) for text in ("abs(p)", "arg(p)", "real(p)", "imag(E_x)", "real(p, 30)", "amplitude(p)")
    }
    assert np.allclose(found["abs(p)"], np.abs(expected("p")), rtol=1e-14)
    assert np.allclose(found["amplitude(p)"], np.abs(expected("p")), rtol=1e-14)
    assert np.allclose(found["arg(p)"], np.angle(expected("p")), rtol=1e-13)
    assert np.allclose(found["real(p)"], expected("p").real, rtol=1e-14)
    assert np.allclose(found["imag(E_x)"], expected("E_x").imag, rtol=1e-13)
    assert np.allclose(found["real(p, 30)"], expected("p", 30).real, rtol=1e-13)


def test_an_amplitude_is_the_maximum_length_over_a_period():
    phases = np.linspace(0, 360, 3601)
    lengths = [np.hypot(expected("E_x", each).real, expected("E_y", each).real) for each in phases]
    # between steps of 0.1 degrees the length differs from its maximum by (0.0017)^2 / 2 of it at most
    assert np.allclose(value(waves(), "amplitude(E)"), np.max(lengths, axis=0), rtol=2e-6)


def test_vectors_lack_the_components_of_which_others_are_known():
    assert missing_components("u", ["u_x", "p", "u_z"], 3) == ["u_y"]
    assert missing_components("u", ["u2"], 2) == ["u1"]
    assert missing_components("u", ["u_x", "u_y"], 2) == []
    assert missing_components("u", ["p", "v_x"], 3) == []


@pytest.mark.parametrize("modes", [(4, 4), (5, 4)], ids=["one space", "two spaces"])
def test_fields_at_a_phase_are_linear_combinations(modes):
    data = waves(modes)
    shown = at_phase(data, 210.0)
    assert list(shown) == [*data, *PARTS]
    for name in PARTS:
        assert np.allclose(value(shown, name), expected(name, 210).real, rtol=0, atol=1e-13)
        assert np.allclose(value(shown, f"real({name}, phase)"), value(shown, name), rtol=0, atol=0)
        assert np.allclose(value(shown, f"abs({name})"), np.abs(expected(name)), rtol=1e-13)
        # a polynomial of the degree of its parts
        assert Expression.of(data, f"real({name}, 210)").degree(lambda leaf: 3) == 3
    assert "210 degrees" in shown.remarks[-1]
    again = at_phase(shown, 0.0)
    assert list(again) == list(shown)
    assert len(again.remarks) == 1
    assert [field.name for field in without_phase(again).fields] == list(data)


def test_quarters_of_a_turn_are_exact():
    assert [cosine_and_sine(degrees) for degrees in (0, 90, -180, 270, 720)] == [
        (1, 0),
        (0, 1),
        (-1, 0),
        (0, -1),
        (1, 0),
    ]
    assert np.allclose(cosine_and_sine(-400.0), (np.cos(np.radians(-400)), np.sin(np.radians(-400))), rtol=1e-15)


def test_names_mark_the_parts_of_complex_fields():
    assert pairs_in(["u_re", "u_im", "v_real_x", "v_imag_x", "w_re", "a_re", "a_im", "a"]) == {
        "u": ("u_re", "u_im"),
        "v_x": ("v_real_x", "v_imag_x"),
    }
    data = waves()
    named = with_complexes(data, ComplexChoice(("H=E_re,E_im", "q=p_im,p_re"), 90.0))
    # the field -Im of each, whose real parts are E_re and p_im
    assert np.allclose(value(named, "H_x"), -expected("E_x").imag, atol=1e-14)
    assert np.allclose(value(named, "q"), -expected("p").real, atol=1e-14)


def test_a_complex_displacement_deforms_at_its_phase():
    data = waves()
    bent = deform(at_phase(data, 90.0), "E", 0.1)
    assert bent.deformation.displacement == ("E_x", "E_y")
    place = POINTS[:1] - 0.1 * np.stack([expected("E_x").imag, expected("E_y").imag], 1)[:1]
    assert sample(bent, "undeformed_x", place)["undeformed_x"] == pytest.approx(0.3, abs=1e-13)


def test_errors_of_a_conversion_belong_to_the_combinations():
    data = waves()
    facts = recorded_facts({})
    loss = {"state": "", "order": 3, "max": 0.1, "slope": 0.2, "relative": 0.3, "L2": 0.1, "range": 1.0, "element": 0}
    facts["fields"] = {"p_re": {**loss, "exact": False}, "p_im": {**loss, "exact": False, "max": 0.4}}
    data = replace(data, metadata={REPORT: json.dumps(facts)})
    errors = ConversionErrors.of(at_phase(data, 60.0).metadata)
    assert errors.of_field("p").value == pytest.approx(0.5 * 0.1 + np.sqrt(0.75) * 0.4)
    assert errors.of_field("p").slope == pytest.approx((0.5 + np.sqrt(0.75)) * 0.2)
    assert errors.of_field("E_x").value == 0.0


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("p", r"p is complex: use abs\(p\)"),
        ("E", r"E is complex"),
        ("abs(E)", r"one of its components E_x, E_y, or amplitude\(E\)"),
        ("arg(p_re)", "arg takes a complex field; these are p, E_x, E_y"),
        ("real(p, x)", "expected a constant phase in degrees"),
        ("real(p, 1", r"expected \) after p"),
        ("amplitude(q)", "amplitude takes a complex field"),
    ],
)
def test_misuse_of_complex_fields_gives_one_line_errors(text, words):
    with pytest.raises(ElvisError, match=words):
        Expression.of(waves(), text)


def test_a_phase_needs_complex_fields():
    data = waves()
    with pytest.raises(ElvisError, match="--phase: expected pairs such as E_re and E_im"):
        at_phase(replace(data, fields=data.fields[:1]), 30.0)
    with pytest.raises(ElvisError, match="finite number of degrees"):
        ComplexChoice((), float("inf"))
