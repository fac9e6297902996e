"""Power spectra against known tones, of arrays and of signals probed in a series."""

import csv

import numpy as np
import pytest
from click.testing import CliRunner

from elvis import Dataset, ElvisError, Shape, write
from elvis.core.numbers.spectra import power_spectrum
from elvis.core.testing import approximated, grid
from elvis.plugins.command.command import elvis

#: cycles per unit of time, and amplitudes
TONES = ((5.0, 2.0), (12.0, 0.5))


def signal(times):
    return 3 + sum(size * np.sin(2 * np.pi * rate * times) for rate, size in TONES)


@pytest.mark.parametrize("segment", [None, 200, 100])
def test_tones_have_their_frequency_and_power(segment):
    """A tone of amplitude a has the power a^2/2, which a Hann window spreads over three frequencies."""
    times = np.arange(400) / 100
    frequency, density = power_spectrum(times, signal(times)[:, None], segment)
    step = frequency[1]
    assert step == pytest.approx(100 / (segment or 400))
    for rate, size in TONES:
        middle = round(rate / step)
        assert density[middle - 1 : middle + 2, 0].sum() * step == pytest.approx(size**2 / 2, rel=1e-12)
    assert frequency[density[:, 0].argmax()] == pytest.approx(5)
    assert density.sum() * step == pytest.approx(sum(size**2 for _, size in TONES) / 2, rel=1e-12)


def test_bad_times_are_errors():
    for times, segment, reason in [
        (np.array([0.0, 1, 2, 4, 5]), None, "expected even steps of time"),
        (np.arange(3.0), None, "expected segments of 4 to 3 times, found 3"),
        (np.arange(8.0), 9, "expected segments of 4 to 8 times, found 9"),
    ]:
        with pytest.raises(ElvisError, match=reason):
            power_spectrum(times, np.zeros((len(times), 1)), segment)


def test_signals_of_a_series(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    bare = Dataset(grid(Shape.QUADRILATERAL, 1))
    for number in range(20):
        value = np.cos(2 * np.pi * 2.5 * number / 10)
        field = approximated(bare, "u", lambda p, value=value: value * (1 + p[:, 0]), 2)
        write(Dataset(bare.mesh, (field,), time=number / 10), f"run_{number}.xml")
    (tmp_path / "run_0.xml").rename("mesh.xml")
    words = ["probe", "mesh.xml", "run_*.fld", "--point", "0,0.5", "--point", "1,0.5"]
    series = [*words, "--times", "all", "--spectrum"]
    found = CliRunner().invoke(elvis, [*series, "all", "-o", "s.csv", "--plot", "s.svg"])
    assert found.exit_code == 0, found.output
    with (tmp_path / "s.csv").open() as file:
        table = list(csv.DictReader(file))
    power = {}
    for row in table:
        power.setdefault(row["point"], {})[float(row["frequency"])] = float(row["u"])
    for point, amplitude in (("0", 1), ("1", 2)):
        own = power[point]
        assert max(own, key=own.get) == pytest.approx(2.5)
        assert sum(own.values()) * 0.5 == pytest.approx(amplitude**2 / 2, rel=1e-10)
    assert ">frequency<" in (tmp_path / "s.svg").read_text()
    for wrong, reason in [
        ([*words, "--spectrum", "all"], "expected --spectrum with --times"),
        ([*series, "x"], "expected all, or a number of times"),
        ([*series, "21"], "expected segments of 4 to 20 times, found 21"),
    ]:
        done = CliRunner().invoke(elvis, wrong)
        assert done.exit_code != 0
        assert reason in f"{done.output}{done.exception}"
