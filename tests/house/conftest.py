import ast
import gc
import shutil
import subprocess
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DATA = ROOT.parent / "shared" / "data"
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
def module_paths(root):
    """Every Python module of the areas."""
    return [path for area in AREAS for path in sorted((root / area).rglob("*.py"))]


@pytest.fixture(scope="module")
def modules(module_paths):
    """Path -> syntax tree of every Python module of the areas: 270 MB while a module of tests needs them."""
    # the garbage collector would look at a million nodes again and again
    gc.disable()
    trees = {path: ast.parse(path.read_text(encoding="utf-8")) for path in module_paths}
    gc.freeze()
    gc.enable()
    return trees


@pytest.fixture(scope="module")
def nodes(modules):
    """Path -> all nodes of the syntax tree of every module of the areas, listed once for all tests of a module."""
    return {path: list(ast.walk(tree)) for path, tree in modules.items()}


@pytest.fixture(scope="session")
def page_files(tmp_path_factory):
    """A folder with the files that the pages speak of (examples/page_data.py), once."""
    folder = tmp_path_factory.mktemp("pages")
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(ROOT / "examples")
        import_module("page_data").lay_out(folder, DATA)
    return folder


@pytest.fixture
def page_folder(page_files, tmp_path, monkeypatch):
    """A folder, now the working one, with a copy of these files."""
    shutil.copytree(page_files, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    return tmp_path
