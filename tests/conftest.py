from pathlib import Path

import pytest

DATA = Path(__file__).resolve().parents[2] / "shared" / "data" / "nektar"


@pytest.fixture(scope="session")
def nektar():
    """The folder of the solver's own files, which lies beside the repository."""
    if not DATA.is_dir():
        pytest.skip(f"there is no {DATA}")
    return DATA
