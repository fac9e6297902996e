"""The test of a converter: it samples, converts, writes, reads, and compares with the converter's own samples."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from elvis.core.base.arrays import Floats, Ints, every_pair
from elvis.core.data.dataset import Dataset
from elvis.formats.reading import read
from elvis.formats.writing import write
from elvis.plugins.conversion.converting import Conversion, Settings, convert
from elvis.plugins.conversion.discovery import with_defaults
from elvis.plugins.conversion.plugin import Converter, Elements
from elvis.plugins.conversion.report import Measure
from elvis.plugins.projection.checking import check_points
from elvis.plugins.projection.frames import affine_between
from elvis.plugins.testing.probing import positions_at, values_at

#: elements of each block that are compared, and how much greater than announced an error may be
_ELEMENTS, _FACTOR = 50, 1.5

#: differences below this share of the largest magnitude are rounding
_ROUNDING = 1e-11


def check(
    converter: type[Converter],
    files: Sequence[str | Path],
    settings: Settings | None = None,
    **options: Any,
) -> Conversion:
    """Convert ``files``; AssertionError, in one line, if the converter or the conversion breaks a promise.

    The converter must open the files and no others, and give the same results for batches of a block as for the whole.
    The converted data, written and read back, must agree with its own samples to 1.5 times the error that the report
    states.
    """
    paths = [Path(file) for file in files]
    _check_opens(converter, paths)
    source = converter(paths, **with_defaults(converter, options))
    for block in source.blocks:
        _check_batches(source, block)
    conversion = convert(source, settings, files)
    with TemporaryDirectory() as folder:
        again = read(*write(conversion.dataset, Path(folder) / "converted.xml"))
    for number, block in enumerate(source.blocks):
        if len(block):
            _compare(source, conversion, again, number, block)
    return conversion


def _check_opens(converter: type[Converter], paths: Sequence[Path]) -> None:
    assert converter.opens(paths), f"{converter.__name__} does not open {', '.join(map(str, paths))}"
    with TemporaryDirectory() as folder:
        other = Path(folder) / "other.txt"
        other.write_text("neither a mesh nor a solution\n")
        assert not converter.opens([other]), f"{converter.__name__} opens an empty file"


def _points(block: Elements) -> Floats:
    """(n, d) points in the coordinates that the converter takes."""
    own = check_points(block.shape, 8)[:-1]
    if block.frame is None:
        return own
    matrix, offset = affine_between(block.shape.vertices, np.asarray(block.frame, np.float64))
    return own @ matrix.T + offset


def _check_batches(source: Converter, block: Elements) -> None:
    """Every other element, requested by number, gets the same samples as in the whole block."""
    points, rows = _points(block), np.arange(0, len(block), 2)[:_ELEMENTS]
    whole = block.take(slice(0, len(block)))
    pairs = [("positions", source.positions(whole, points)[rows], source.positions(block.take(rows), points))]
    for field in source.fields:
        if field.order_on(list(source.blocks).index(block)) is not None:
            samples = source.sample(whole, field, points)[rows]
            pairs.append((f"samples of {field.name}", samples, source.sample(block.take(rows), field, points)))
    for what, expected, found in pairs:
        # sums may round otherwise for fewer elements, by parts of their largest terms
        rounding = 1e-12 * float(np.abs(expected).max(initial=0.0, where=np.isfinite(expected)))
        same = expected.shape == found.shape and np.allclose(expected, found, 1e-12, rounding, equal_nan=True)
        assert same, f"{what} of a batch of a block differ from those of the complete block: is block.rows used?"


def _compare(source: Converter, conversion: Conversion, again: Dataset, number: int, block: Elements) -> None:
    """Some elements of a block, each at its own points."""
    rng = np.random.default_rng(7)
    points = _points(block)
    some = np.sort(rng.choice(len(block), min(_ELEMENTS, len(block)), replace=False))
    rows, places = every_pair(some, points)
    batch = block.take(some)
    wanted = np.zeros((len(rows), 3))
    given = source.positions(batch, points).reshape(len(rows), -1)
    wanted[:, : given.shape[1]] = given
    found = positions_at(conversion, number, rows, places, again)
    _assert_near(conversion.report.geometry, wanted, found, rows)
    for measure, field in zip(conversion.report.fields, _converted_fields(source, conversion), strict=True):
        values = values_at(conversion, field.name, number, rows, places, again)
        if field.is_on(number):
            _assert_near(measure, source.sample(batch, field, points).reshape(-1), values, rows)
        else:
            assert np.isnan(values).all(), f"{field.name}: expected no values on block {number}, found some"


def _converted_fields(source: Converter, conversion: Conversion) -> list[Any]:
    names = [measure.name for measure in conversion.report.fields]
    return [field for field in source.fields if field.name in names]


def _assert_near(measure: Measure, wanted: Floats, found: Floats, rows: Ints) -> None:
    finite = np.isfinite(wanted)
    errors = np.abs(np.where(finite, found - np.where(finite, wanted, 0), 0)).reshape(len(rows), -1).max(axis=1)
    bound = _FACTOR * measure.max + _ROUNDING * float(np.abs(wanted[finite]).max(initial=0))
    worst = int(errors.argmax())
    assert errors[worst] <= bound, (
        f"{measure.name}: expected errors up to {bound:.3g}, found {errors[worst]:.3g} in element {rows[worst]}"
    )
