"""Two trees in turn: the comparison runs, and its figures are those of the right tree."""

import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture
def against(monkeypatch):
    """The module."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import against

    return against


def run(*arguments):
    command = [sys.executable, BENCHMARKS / "against.py", *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=600)


@pytest.mark.thorough
def test_a_tree_is_compared_with_itself():
    process = run(BENCHMARKS.parent, "--quick", "--only", "cut", "--rounds", "1")
    assert process.returncode == 0, process.stderr[-3000:]
    rows = [line.split("|")[1:-1] for line in process.stdout.splitlines() if line.startswith("| cut")]
    assert len(rows) == 3
    assert all(float(cell) > 0 for row in rows for cell in row[1:])


def test_ratios_are_of_the_cheapest_and_the_usual_runs_after_the_first(against):
    seconds = {"this": (9.0, 2.0, 3.0, 4.0), "other": (9.0, 1.0, 1.5, 8.0), "this again": (0.1, 2.0, 2.0, 2.0)}
    works = [iter(own) for own in seconds.values()]
    found = against.compare([lambda own=own: [next(own)] * 2 for own in works], rounds=3)
    assert found["processor"] == {"this": 2.0, "other": 1.0, "this again": 2.0}
    assert found["wall"] == {"this": 3.0, "other": 1.5, "this again": 2.0}
    cells = [cell.strip() for cell in against.table({"a scene": found}, "there").splitlines()[4].split("|")[1:-1]]
    assert cells == ["a scene", "2", "1", "2.000", "2.000", "1.000", "1.500"]


def test_each_round_begins_with_a_different_tree(against):
    order = []
    against.in_turns([lambda k=k: order.append(k) or (1.0,) for k in range(3)], rounds=2)
    assert order == [0, 1, 2, 1, 2, 0, 2, 0, 1]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [((BENCHMARKS.parent, "--only", "nonsense"), "unknown part"), ((BENCHMARKS,), "is no tree of this repository")],
)
def test_bad_input_gives_a_one_line_error(arguments, message):
    process = run(*arguments)
    assert process.returncode == 2
    assert message in process.stderr
