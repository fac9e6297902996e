import os
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


@pytest.fixture(scope="session")
def renderer():
    """An open device by name, opened once; only a missing Vulkan driver is a reason to skip, and not in CI."""
    from elvis.renderer import Renderer
    from elvis.renderer.adapters import ADVICE, adapters

    opened = {}

    def open_device(name):
        if name == "vulkan" and not any(adapter.kind == "vulkan" for adapter in adapters()):
            if os.environ.get("CI"):
                pytest.fail(f"no Vulkan device: {ADVICE}")
            pytest.skip(f"no Vulkan device: {ADVICE}")
        if name not in opened:
            opened[name] = Renderer(name)
        return opened[name]

    yield open_device
    for device in opened.values():
        device.device.close()
