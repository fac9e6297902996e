"""Series and parts of ranks are deformed, and shown at a phase, as whole data of one state are."""

from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import Dataset, Shape, deform, read, sample, write
from elvis.core.data.complex_fields import ComplexChoice
from elvis.core.data.moments import Moment
from elvis.core.deformed.deformation import Deformation
from elvis.core.mapping.geometry import geometry
from elvis.core.testing import approximated, grid
from elvis.core.testing.played_ranks import played
from elvis.plugins.command.command import elvis as group
from elvis.plugins.data.data import Reading, dataset_of, part_of
from elvis.plugins.data.phases import at_phase

FUNCTIONS = {"E_re": lambda x: 0.1 * x[:, 1] ** 2, "E_im": lambda x: 0.2 * x[:, 0], "p": lambda x: x[:, 0] * x[:, 1]}
#: the displacement is the real part of E exp(i phase), and its double
STATE = {"deformation": Deformation("E,2*E", 0.5, "deformed"), "complexes": ComplexChoice((), 30.0)}


@pytest.fixture(scope="module")
def steps(tmp_path_factory):
    """Files of a mesh and of two steps, of which the second has twice the values of the first."""
    folder = tmp_path_factory.mktemp("steps")
    data = Dataset(grid(Shape.TRIANGLE, 2))
    for number in (0, 1):
        fields = [
            approximated(data, name, lambda x, own=own, number=number: (1 + number) * own(x), 4)
            for name, own in FUNCTIONS.items()
        ]
        step = replace(data, fields=tuple(fields), time=float(number))
        write(step, folder / "m.xml", folder / f"m_{number}.chk")
    return [folder / name for name in ("m.xml", "m_0.chk", "m_1.chk")]


def in_state(data):
    return deform(at_phase(data, 30.0), "E,2*E", 0.5, "deformed")


def coefficients(data, *names):
    """Rows of maps and of fields by element."""
    blocks = [*geometry(data), *(block for name in names for block in data.field(name).blocks)]
    rows = {}
    for block in blocks:
        for element, row in zip(block.element_ids.tolist(), block.coefficients, strict=True):
            rows.setdefault(element, []).append(np.ravel(row))
    return rows


def test_a_step_of_a_series_equals_its_file(steps):
    whole = in_state(read(steps[0], steps[2]))
    found = dataset_of(steps, Reading(moment=Moment(step=1), **STATE))
    for own, expected in zip(coefficients(found, "E").values(), coefficients(whole, "E").values(), strict=True):
        assert all(map(np.array_equal, own, expected))
    # between steps values are linear in time: one and a half times those of the first
    between = dataset_of(steps, Reading(moment=Moment(time=0.5), **STATE))
    first = read(*steps[:2])
    expected = deform(at_phase(first, 30.0), "E,2*E", 0.75, "deformed")
    places = [[0.4, 0.5], [0.2, 0.7]]
    ours, theirs = (sample(data, ["undeformed_x", "d(p,y)"], places).values for data in (between, expected))
    assert np.allclose(ours, theirs * [1.0, 1.5], rtol=1e-12)


def test_parts_of_ranks_match_those_of_the_whole(steps):
    whole = coefficients(in_state(read(*steps[:2])), "E", "p")
    reading = Reading(**STATE)
    parts = played(3, lambda ranks: part_of(steps[:2], replace(reading, ranks=ranks)).dataset)
    found = [coefficients(part, "E", "p") for part in parts]
    assert sum(len(rows) for rows in found) >= len(whole) == 8
    assert len({element for rows in found for element in rows}) == 8
    for rows in found:
        for element, own in rows.items():
            # products of matrices with other numbers of rows may be summed in another order
            for one, other in zip(own, whole[element], strict=True):
                assert np.allclose(one, other, rtol=0, atol=4e-16)


def test_values_over_time_are_probed_on_the_moving_geometry(steps):
    words = ["probe", *map(str, steps), "--deform", "E,2*E", "--scale", "0.5", "--phase", "30", "--times", "all"]
    outcome = CliRunner().invoke(group, [*words, "--point", "0.4,0.5", "--field", "p"], catch_exceptions=False)
    rows = [line.split(",") for line in outcome.stdout.splitlines()]
    values = [float(row[rows[0].index("p")]) for row in rows[1:]]
    expected = []
    for path in steps[1:]:
        bent = deform(at_phase(read(steps[0], path), 30.0), "E,2*E", 0.5)
        expected.append(float(sample(bent, "p", [[0.4, 0.5]])["p"][0]))
    assert values == pytest.approx(expected, rel=1e-12)
