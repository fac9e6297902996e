"""Reports: numbers recomputed from the records, the same bytes for the same input, planted errors found."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from elvis import Plane, Scene, Transfer, VolumeRendering
from elvis.core.base.errors import ElvisError
from elvis.reference.picture import render
from elvis.reference.record import Record
from elvis.reference.report.conclusion import conclusion
from elvis.reference.report.summary import summary
from elvis.reference.report.writing import write_report
from elvis.reference.study import compare_records, compare_scene, memory_limit

SCENE = Scene("wave", Plane((1.5, 0.5, 0.45), (0.1, 0.2, 1.0)), size=(60, 40), palette="viridis")


def draw(dataset, scene, device="auto"):
    return render(dataset, scene)


@pytest.fixture(scope="module")
def study(blocks):
    return compare_scene(blocks, SCENE, (0, 1), 1 << 30, draw=draw, validation_size=30)


@pytest.fixture(scope="module")
def report(study, tmp_path_factory):
    folder = tmp_path_factory.mktemp("reports") / "report"
    write_report(study, folder)
    return folder


def test_numbers_match_those_of_the_records(study, report):
    """summary.json, recomputed with nothing but the arrays."""
    told = json.loads((report / "summary.json").read_text())
    exact = study.exact
    low, high = np.nanmin(exact.field), np.nanmax(exact.field)
    assert told["picture"]["range"] == [low, high]
    for rival, found in zip(study.rivals, told["baselines"], strict=True):
        both = ~np.isnan(exact.field) & ~np.isnan(rival.record.field)
        away = np.abs(exact.field[both] - rival.record.field[both]) / (high - low)
        missing = (exact.element >= 0) & (rival.record.element < 0)
        assert found["value_max"] == pytest.approx(away.max(), rel=1e-12)
        assert found["value_mean"] == pytest.approx(away.mean(), rel=1e-12)
        assert found["missing"] == missing.sum()
        assert found["spurious"] == ((exact.element < 0) & (rival.record.element >= 0)).sum()
        share = ((away > 1 / 256).sum() + missing.sum()) / (exact.element >= 0).sum()
        assert found["off"] == pytest.approx(100 * share, rel=1e-12)
        worst = found["worst"]
        measure = np.abs(exact.field - rival.record.field)
        assert measure[worst["row"], worst["column"]] == np.nanmax(measure)
        assert worst["element"] == exact.element[worst["row"], worst["column"]]

        # a contour's displacement by trying all pairs of points
        for contour in found["contours"]:
            first, second = (points(record.field, contour["value"]) for record in (exact, rival.record))
            if not len(first) or not len(second):
                assert contour["maximum"] is None
                continue
            pairs = np.linalg.norm(first[:, None] - second, axis=2)
            expected = max(pairs.min(axis=1).max(), pairs.min(axis=0).max())
            assert contour["maximum"] == pytest.approx(expected, rel=1e-9)


def points(field, value):
    """Where a contour passes between neighbouring pixels, one pair of pixels after another."""
    found = []
    height, width = field.shape
    for row in range(height):
        for column in range(width):
            for down, right in ((1, 0), (0, 1)):
                if row + down < height and column + right < width:
                    a, b = field[row, column] - value, field[row + down, column + right] - value
                    if (a < 0) != (b < 0) and not np.isnan(a + b):
                        found.append((row + down * a / (a - b), column + right * a / (a - b)))
    return np.array(found)


def test_the_reference_is_within_its_tolerances(study):
    assert study.validation.passed
    assert max(study.validation.size) == 30
    assert conclusion(study).startswith(
        "Exact: all 600 pixels are within every tolerance. Linear elements after 1 refinement: "
    )


def test_every_file_named_on_the_page_exists(report):
    text = (report / "index.html").read_text()
    names = set(re.findall(r'(?:src|href|value)="([^"#]+\.(?:png|svg|json|toml))"', text))
    assert len(names) > 10
    assert all((report / name).is_file() for name in names)
    assert not re.search(r'(src|href)="(https?:)?//', text)
    written = {str(path.relative_to(report)) for path in report.rglob("*.*")}
    assert written - names == {"index.html", "times.json", "scene.toml", "report.json"}


@pytest.mark.thorough
def test_same_input_same_bytes(blocks, study, report, tmp_path):
    """All files but those of times, and the marked section of the page."""
    again = compare_scene(blocks, SCENE, (0, 1), 1 << 30, draw=draw, validation_size=30)
    write_report(again, tmp_path / "report")
    for path in sorted(report.rglob("*.*")):
        other = tmp_path / "report" / path.relative_to(report)
        if path.name == "index.html":
            assert timeless(path) == timeless(other)
        elif not path.name.startswith("times."):
            assert path.read_bytes() == other.read_bytes(), path.name


def timeless(path):
    before, rest = path.read_text().split("<!-- times:")
    return before, rest.split("<!-- end of times -->")[1]


@pytest.mark.thorough
def test_a_limit_skips_what_does_not_fit(blocks):
    limit = compare_scene(blocks, SCENE, (1,), draw=draw, validation_size=0).rivals[0].counts["needed"]
    found = compare_scene(blocks, SCENE, (0, 1, 2, 3), limit, draw=draw, validation_size=0)
    assert [bool(rival.skipped) for rival in found.rivals if rival.level is not None] == [False, False, True, True]
    needed = found.rivals[2].counts["needed"]
    assert conclusion(found).endswith(f"2 refinements would need {needed / 1000:.0f} kB.")
    nothing = compare_scene(blocks, SCENE, (2,), 0, draw=draw, validation_size=0)
    assert (
        conclusion(nothing) == f"No linear picture fits into memory: 2 refinements would need {needed / 1000:.0f} kB."
    )
    assert memory_limit() > 1 << 20


def test_linear_pictures_of_a_volume_are_compared_by_colour(blocks):
    volume = VolumeRendering(Transfer((-0.5, 0.5), (0.0, 4.0)))
    scene = Scene("wave", camera="iso", size=(20, 16), objects=(volume,))
    found = compare_scene(blocks, scene, (0, 2), 1 << 30, draw=draw, validation_size=0)
    coarse, fine = (rival.errors.colors_off for rival in found.rivals if rival.level is not None)
    assert 0 < fine < coarse
    assert "of the pixels have colours off by more than" in conclusion(found)


def test_linear_data_are_exact_without_refinement(tmp_path):
    from elvis import Dataset
    from elvis.core.shapes import Shape
    from elvis.core.testing import approximated, grid

    mesh = Dataset(grid(Shape.TETRAHEDRON, 2))
    data = Dataset(mesh.mesh, (approximated(mesh, "wave", lambda x: x[:, 0] + 2 * x[:, 2], modes=3),))
    scene = replace(SCENE, plane=Plane((0.5, 0.5, 0.4), (0.2, 0.1, 1.0)))
    found = compare_scene(data, scene, (0, 1), draw=draw, validation_size=0)
    assert conclusion(found) == "Linear elements are right to within one pixel after 0 refinements."


def test_only_reports_are_replaced(study, report, tmp_path):
    write_report(study, report)
    other = tmp_path / "other"
    other.mkdir()
    (other / "thesis.txt").write_text("years of work")
    with pytest.raises(ElvisError, match="it is a folder of other things"):
        write_report(study, other)
    assert [path.name for path in other.iterdir()] == ["thesis.txt"]
    with pytest.raises(ElvisError, match="there is no folder"):
        write_report(study, tmp_path / "no" / "report")
    with pytest.raises(ElvisError, match="it is a file"):
        write_report(study, other / "thesis.txt")


def test_no_partial_files_are_left(study, tmp_path, monkeypatch):
    def fail(value):
        raise RuntimeError("no more disk")

    monkeypatch.setattr("elvis.reference.report.writing.json_text", fail)
    with pytest.raises(RuntimeError, match="no more disk"):
        write_report(study, tmp_path / "report")
    assert list(tmp_path.iterdir()) == []


def test_a_missing_package_is_named_with_its_extra(study, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "jinja2", None)
    with pytest.raises(ElvisError, match=r"needs jinja2, which is not installed; pip install 'elvis-viz\[compare\]'"):
        write_report(study, tmp_path / "report")
    assert list(tmp_path.iterdir()) == []


def test_two_records_make_a_report(study, tmp_path):
    record = study.exact
    field = record.field.copy()
    field[20, 30] += 0.5 * np.ptp(field[record.seen])
    found = compare_records(record, replace(record, field=field), "other.npz")
    write_report(found, tmp_path / "report")
    told = json.loads((tmp_path / "report" / "summary.json").read_text())
    assert told["pixel_exact"] is False
    assert "worst at column 30, row 20" in told["conclusion"]
    assert f"element {record.element[20, 30]}" in told["conclusion"]
    assert summary(found)["baselines"][0]["value_max"] == pytest.approx(0.5)
    assert isinstance(record, Record)
