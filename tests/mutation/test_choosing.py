"""Which tests run for a mutant, and for how long."""

import json
import sys
from pathlib import Path

from choosing import AREAS, Imports, Touched, chosen_tests, lines_by_function, map_name, run_within

ROOT = Path(__file__).resolve().parents[2]


def test_every_kernel_has_tests_near():
    imports = Imports(ROOT)
    kernels = [path for area in AREAS for path in (ROOT / area / "elvis").rglob("*.slang")]
    assert len(kernels) > 50
    assert not [path.name for path in kernels if not imports.tests_near(path)]

    # modules that export what they import pass it on
    (exported,) = [path for path in kernels if path.name == "discs.slang"]
    assert {"enclosures", "iso_enclose", "iso_series", "iso_follow"} <= imports.kernels_including(exported)


def test_limits_are_seconds_of_the_processor():
    waiting = run_within([sys.executable, "-c", "import time; time.sleep(1.2); print(7)"], limit=1.0)
    assert waiting.stdout.strip() == "7"
    assert run_within([sys.executable, "-c", "while True: pass"], limit=1.0) is None


CODE = """
LIMIT = 2

class Box:
    def size(self):
        return (
            self.high
            - self.low
        )

def inner(a):
    return len(a) + 1
"""


def test_tests_that_run_a_line_are_chosen_within_the_budget_the_nearest_first(tmp_path):
    """Lines of functions by their distance from its start; lines that run on import count for the whole file."""
    code, near, far = (tmp_path / name for name in ("formats/elvis/box.py", "tests/test_box.py", "tests/test_far.py"))
    for path, text in ((code, CODE), (near, "import elvis.box"), (far, "pass")):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    name, kept = "formats/elvis/box.py", tmp_path / "kept"
    size, inner = [name, "Box.size", [1, 2, 3]], [name, "inner", [1]]
    maps = {near: {"a": [50.0, [0], []], "b": [1.0, [1], []]}, far: {"c": [2.0, [0], []], "d": [3.0, [0], []]}}
    touched = Touched(tmp_path, Imports(tmp_path), kept)
    for test, tests in maps.items():
        (kept / map_name(tmp_path, test)).write_text(json.dumps({"entries": [size, inner], "tests": tests}))

    assert lines_by_function(code, range(8, 9)) == {"Box.size": {3}}
    assert lines_by_function(code, range(12, 13)) == {"inner": {1}}
    assert lines_by_function(code, range(2, 3)) == {}

    def chosen(line, budget=60.0):
        return chosen_tests(touched._imports, touched, code, range(line, line + 1), budget)

    assert chosen(8) == ["a", "c", "d"]
    assert chosen(8, budget=10.0) == ["a"]
    assert chosen(8, budget=53.0) == ["a", "c"]
    assert chosen(12) == ["b"]
    assert chosen(2) == ["b", "c", "d", "a"]
