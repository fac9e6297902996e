"""Which tests run for a mutant, and for how long."""

import sys
from pathlib import Path

from choosing import AREAS, Imports, run_within

ROOT = Path(__file__).resolve().parents[2]


def test_every_kernel_has_tests_near():
    imports = Imports(ROOT)
    kernels = [path for area in AREAS for path in (ROOT / area / "elvis").rglob("*.slang")]
    assert len(kernels) > 50
    assert not [path.name for path in kernels if not imports.tests_near(path)]


def test_limits_are_seconds_of_the_processor():
    waiting = run_within([sys.executable, "-c", "import time; time.sleep(1.2); print(7)"], limit=1.0)
    assert waiting.stdout.strip() == "7"
    assert run_within([sys.executable, "-c", "while True: pass"], limit=1.0) is None
