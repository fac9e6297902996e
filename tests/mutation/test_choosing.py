"""Limits of the time that tests of a mutant take."""

import sys

from choosing import run_within


def test_limits_are_seconds_of_the_processor():
    waiting = run_within([sys.executable, "-c", "import time; time.sleep(1.2); print(7)"], limit=1.0)
    assert waiting.stdout.strip() == "7"
    assert run_within([sys.executable, "-c", "while True: pass"], limit=1.0) is None
