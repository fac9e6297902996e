import ast
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

ROOT = Path(__file__).resolve().parents[2]
AREAS = ("formats", "plugins", "converters", "renderer", "reference")


@pytest.fixture(scope="session")
def root():
    """The top of the checkout."""
    return ROOT


@pytest.fixture(scope="session")
def project_files(root):
    """Every file of the project: what git tracks, or would."""
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard", "-z"]
    listed = subprocess.run(command, cwd=root, capture_output=True, check=True, text=True).stdout
    return [root / name for name in listed.split("\0") if name and (root / name).is_file()]


@pytest.fixture(scope="session")
def modules(root):
    """Path -> syntax tree of every Python module of the areas."""
    paths = [path for area in AREAS for path in sorted((root / area).rglob("*.py"))]
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in paths}


@pytest.fixture(scope="session")
def wing_files(tmp_path_factory):
    """``wing.xml`` and ``wing.fld``, which the pages speak of: all volume shapes, curved, with p, u, v and w."""
    from elvis.core.testing import approximated, curved, mixed_volume, ripple
    from elvis.formats import Dataset, write

    dataset = Dataset(curved(mixed_volume(seed=1), ripple(0.02), n=4))
    functions = {
        "p": lambda x: np.sin(2 * x[:, 0]) * np.cos(x[:, 1]) + x[:, 2] ** 2,
        "u": lambda x: 1 - x[:, 2] ** 2,
        "v": lambda x: x[:, 0] * x[:, 1],
        "w": lambda x: 0.1 * x[:, 0],
    }
    fields = tuple(approximated(dataset, name, function, modes=5) for name, function in functions.items())
    folder = tmp_path_factory.mktemp("wing")
    return write(replace(dataset, fields=fields), folder / "wing.xml")


@pytest.fixture
def wing(wing_files, tmp_path, monkeypatch):
    """An empty folder, now the working one, with a copy of these files."""
    for path in wing_files:
        shutil.copy(path, tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path
