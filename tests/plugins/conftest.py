import sys
from pathlib import Path

import pytest

MINIATURE = Path(__file__).parent / "miniature"


@pytest.fixture
def miniature(monkeypatch):
    """The folder of the distribution ``miniature``, installed for one test."""
    monkeypatch.syspath_prepend(str(MINIATURE))
    yield MINIATURE
    for name in ("miniature", "raises"):
        sys.modules.pop(name, None)
