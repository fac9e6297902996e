"""The reports of the example cases: made by one command, their table from their numbers."""

import json
import re
import sys

import pytest
from PIL import Image


@pytest.fixture
def make(request, monkeypatch):
    """The script, as a module."""
    monkeypatch.syspath_prepend(request.config.rootpath / "examples" / "reports")
    yield __import__("make")
    sys.modules.pop("make", None)


def test_the_table_lists_the_summaries(make):
    """Every case has its rows; numbers of a summary come out as the page has them."""
    counts = {"bytes": 2.5e6, "needed": 7e6}
    rivals = [
        {"key": f"n{n}", "off": 123.4 / 2**n, "contour_max": 2.0 / n if n else None, "counts": counts} for n in range(4)
    ]
    rivals.append({"key": "n4", "counts": {"needed": 2e9}})
    times = {"exact": {"exact": 1.5}, "n0": {"mesh": 0.1, "draw": 0.2}}
    rows = make.table_rows("delta", {"data": {"bytes": 1.5e6}, "baselines": rivals}, times)
    assert rows[0] == "| delta | off | 123 % | 62 % | 31 % | 15 % | – |  |  |  |"
    assert rows[1] == "|  | contours | – | 2 px | 1 px | 0.67 px | – |  |  |  |"
    assert rows[2] == "|  | memory | 2.5 MB | 2.5 MB | 2.5 MB | 2.5 MB | needs 2000 MB |  |  | 1.5 MB |"
    assert rows[3] == "|  | time | 0.3 s | – | – | – | – |  |  | 1.5 s |"
    assert len(rows) == 4
    page = make.PAGE.read_text()
    assert set(re.findall(r"^\| (\w+) \|", page, re.M)) - {"case"} == set(make.CASES)
    assert page.startswith(make.HEAD.split("{size}")[0])
    assert page.count("Exact: all") == len(make.CASES)


def test_unknown_cases_are_rejected(make, capsys):
    assert make.main(["nothing"]) == 2
    assert "there is no case nothing; the cases are delta" in capsys.readouterr().err


@pytest.mark.thorough
def test_one_case_is_made(make, block_files, monkeypatch, tmp_path, capfd):
    """The command that it runs writes a report."""
    data = tmp_path / "out" / "cases"
    data.mkdir(parents=True)
    for file, name in zip(block_files, ("delta.xml", "delta.fld"), strict=True):
        (data / name).write_bytes(file.read_bytes())
    monkeypatch.setattr(make, "ROOT", tmp_path)
    monkeypatch.setitem(make.CASES, "delta", ("delta", "--plane 1.5,0.5,0.45:0.1,0.2,1", "the blocks in its place"))
    options = ["--size", "40x30", "--device", "reference", "--validate", "0", "--refinements", "0,1"]
    assert make.main(["delta", "--", *options]) == 0
    told = json.loads((tmp_path / "out" / "reports" / "delta" / "summary.json").read_text())
    assert told["picture"]["size"] == [40, 30]


@pytest.fixture
def shoot(request, monkeypatch):
    """The script that takes a picture of a report, as a module."""
    monkeypatch.syspath_prepend(request.config.rootpath / "examples" / "reports")
    yield __import__("shoot")
    sys.modules.pop("shoot", None)


def test_a_picture_of_a_report_is_taken(shoot, browser, monkeypatch, tmp_path, capsys):
    monkeypatch.setattr(shoot, "ROOT", tmp_path)
    assert shoot.main(["nothing"]) == 1
    assert "there is no report; python examples/reports/make.py nothing makes it" in capsys.readouterr().err
    page = tmp_path / "out" / "reports" / "twist" / "index.html"
    page.parent.mkdir(parents=True)
    page.write_text("<body style='background: rgb(10, 20, 30)'>")
    assert shoot.main(["twist", str(tmp_path / "shot.png")]) == 0
    shot = Image.open(tmp_path / "shot.png").convert("RGB")
    assert (shot.size, shot.getpixel((5, 5))) == (shoot.WINDOW, (10, 20, 30))
    assert shoot.main(["a", "b", "c"]) == 2
