"""The benchmarks run, and what they compare is the same picture."""

import importlib.util
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

RUN = Path(__file__).resolve().parents[2] / "benchmarks" / "run.py"


def run(*arguments):
    return subprocess.run([sys.executable, RUN, *arguments], capture_output=True, text=True, timeout=600)


#: parts of which tests below look at the numbers
LOOKED_AT = ("cut", "orders", "million")
OTHERS = (
    "spectral", "surfaces", "isosurface", "volume", "compile", "load", "convert", "start", "repeat", "view", "large",
    "targets", "series", "measure", "resolution", "flow", "in-situ"
)  # fmt: skip


def smoke(path, *parts):
    """Text and numbers of a smoke run of some parts, whose tables all have rows."""
    process = run("--quick", "--only", ",".join(parts), "--json", path)
    assert process.returncode == 0, process.stderr[-3000:]
    text, numbers = process.stdout, json.loads(path.read_text())
    assert set(numbers) == {"machine", *parts}
    assert numbers["machine"]["date"] in text
    tables = text.split("\n## ")[1:]
    assert len(tables) >= len(parts)
    for table in tables:
        _head, _line, *rows = [line for line in table.splitlines() if line.startswith("|")]
        assert rows, table
    return text, numbers


@pytest.fixture(scope="module")
def quick(tmp_path_factory):
    return smoke(tmp_path_factory.mktemp("benchmarks") / "some.json", LOOKED_AT[0])


@pytest.fixture(scope="module")
def further(tmp_path_factory):
    return smoke(tmp_path_factory.mktemp("benchmarks") / "others.json", *LOOKED_AT[1:])


@pytest.mark.thorough
@pytest.mark.sampled(free=("part",))
@pytest.mark.parametrize("part", OTHERS)
def test_a_part_prints_its_tables(part, tmp_path):
    smoke(tmp_path / "part.json", part)


def test_all_parts_are_listed():
    process = run("--only", "nonsense")
    assert process.returncode == 2
    told = process.stderr.rpartition("unknown part 'nonsense': expected some of ")[2]
    assert sorted(told.strip().split(", ")) == sorted((*LOOKED_AT, *OTHERS))


@pytest.mark.parametrize("case", ["standard", "hard"])
def test_the_exact_picture_is_exact(quick, case):
    exact = quick[1]["cut"][case]["exact"]
    assert exact["error"]["greatest"] < 1e-11
    assert exact["error"]["coverage"] == 0
    assert exact["status"]["failed"] == 0


@pytest.mark.skipif(importlib.util.find_spec("vtk") is None, reason="vtk is not installed")
@pytest.mark.parametrize("case", ["standard", "hard"])
def test_linear_pictures_show_the_same_and_get_better(quick, case):
    found = quick[1]["cut"][case]
    if not found["linear"]:
        pytest.skip(found["remarks"][0])
    errors = [it["wrong"] for it in found["linear"]]
    assert errors == sorted(errors, reverse=True)
    assert [it["missed"] for it in found["linear"]][-1] < 0.05
    assert [it["pieces"] for it in found["linear"]] == [8**n * found["linear"][0]["pieces"] for n in (0, 1)]


@pytest.mark.thorough
def test_frames_of_all_orders_are_exact_and_above_the_floor(further):
    for case in further[1]["orders"]["cases"]:
        assert case["error"]["greatest"] < 1e-11
        assert case["processor"] > case["inside"] * case["operations of a pixel"] / max(
            further[1]["orders"]["peaks"].values()
        )


@pytest.mark.thorough
def test_device_memory_is_little_more_than_coefficients_and_vertices(further):
    numbers = further[1]["million"]
    assert numbers["device"]["loaded"] < 1.3 * numbers["raw"]
    assert numbers["probe error"] < 1e-11


def test_refinements_fill_the_tetrahedron():
    path = [str(RUN.parent), *filter(None, [os.environ.get("PYTHONPATH")])]
    code = (
        "import numpy as np, linear\n"
        "for level in range(4):\n"
        "    points, cells = linear.refinement(level)\n"
        "    corners = points[cells]\n"
        "    volumes = np.linalg.det(corners[:, 1:] - corners[:, :1]) / 6\n"
        "    assert len(cells) == 8**level and np.allclose(volumes, 4 / 3 / 8**level)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, env={**os.environ, "PYTHONPATH": os.pathsep.join(path)})


def test_tables_of_a_part_replace_its_older_ones():
    page = "# Benchmarks\n\n<!-- begin cut -->\nold\n<!-- end cut -->\n\n<!-- begin view -->\nkept\n<!-- end view -->\n"
    code = f"import run; print(run.with_tables({page!r}, {{'cut': 'new', 'load': 'more'}}, 'machine'), end='')"
    environment = {**os.environ, "PYTHONPATH": str(RUN.parent)}
    found = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True, env=environment)
    parts = [line for line in found.stdout.splitlines() if line]
    assert parts[1:5] == ["<!-- begin cut -->", "new", "machine", "<!-- end cut -->"]
    assert "kept" in parts
    assert parts[-4:] == ["<!-- begin load -->", "more", "machine", "<!-- end load -->"]
