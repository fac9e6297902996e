import time
from pathlib import Path

import pytest

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "nektar"
#: processor seconds of ``job`` on the machine for which limits were chosen
JOB_SECONDS = 0.045


@pytest.fixture(scope="session")
def nektar():
    """The folder of the solver's own files, which lies beside the repository."""
    if not DATA.is_dir():
        pytest.skip(f"there is no {DATA}")
    return DATA


@pytest.fixture(scope="session")
def slowness():
    """How many times slower than that machine this one is, 1 at least: limits in seconds are multiplied by it."""

    def seconds():
        start = time.process_time()
        job()
        return time.process_time() - start

    return max(1.0, min(seconds() for _ in range(5)) / JOB_SECONDS)


def job():
    """Work as readers do it: numbers to text and back."""
    text = " ".join(str(number / 7) for number in range(50000))
    return sum(float(word) for word in text.split())
