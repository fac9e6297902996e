import numpy as np
import pytest
from browsers import find_browser

from elvis import Dataset, write
from elvis.core.testing import approximated, curved, mixed_volume, ripple


@pytest.fixture(scope="session")
def browser():
    """The command of a Chromium; ``make test`` installs one where it can."""
    return find_browser()


@pytest.fixture(scope="session")
def blocks():
    """All volume shapes, curved, with a field that waves within the elements."""
    mesh = Dataset(curved(mixed_volume(seed=1), ripple(0.03), n=4))
    wave = approximated(mesh, "wave", lambda x: np.sin(4 * x[:, 0] + 2 * x[:, 1]) * np.cos(3 * x[:, 2]), modes=6)
    return Dataset(mesh.mesh, (wave,))


@pytest.fixture(scope="session")
def block_files(blocks, tmp_path_factory):
    """These data as files."""
    return write(blocks, tmp_path_factory.mktemp("blocks") / "blocks.xml")
