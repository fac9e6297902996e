"""The house stands as it should: areas, namespace, what may not be written into a file."""

import re
from collections import Counter
from pathlib import Path

import pytest

import elvis

#: folders at the top and the slices of the namespace that they hold
AREAS = {
    "formats": ("core", "formats"),
    "plugins": ("plugins",),
    "converters": ("converters",),
    "renderer": ("api", "renderer", "scene", "viewer"),
    "reference": ("reference",),
}

#: written so that this file does not match itself
REGISTRIES = re.compile(
    r"py[p]i\.org|python[h]osted|deb\.d[e]bian|archive\.u[b]untu|crates\.i[o]\b|npm[j]s|proxy\.gol[a]ng|repo1?\.mav[e]n",
    re.I,
)
MACHINE_PATHS = re.compile(r"(?<![\w.~-])/(?:wor[k]|roo[t]|hom[e])/\w")


def test_one_package_joins_the_areas(root):
    """`import elvis` finds the modules of all five."""
    assert list(root.glob("*/elvis/__init__.py")) == [root / "renderer" / "elvis" / "__init__.py"]
    assert len({Path(folder).parent.name for folder in elvis.__path__} & set(AREAS)) == len(AREAS)


@pytest.mark.parametrize("area", AREAS)
def test_every_area_has_its_page_and_its_types(root, area):
    assert (root / area / "README.md").is_file()
    found = {path.name for path in (root / area / "elvis").iterdir()} - {"__pycache__"}
    own = {"plugins": ["__main__.py"], "renderer": ["__init__.py", "py.typed"]}.get(area, [])
    assert found == {*AREAS[area], *own}
    for name in AREAS[area]:
        assert (root / area / "elvis" / name / "py.typed").is_file()


def base_names(paths):
    """The names of modules and folders of an area; a module may bear the name of the folder that it stands in."""
    folders = {folder for path in paths for folder in path.parents if len(folder.parts) > 3}
    own = [path.stem for path in paths if path.stem not in ("__init__", path.parent.name)]
    return own + [folder.name for folder in folders]


@pytest.mark.parametrize("area", AREAS)
def test_base_names_are_unique_in_an_area(root, module_paths, area):
    paths = [path.relative_to(root) for path in module_paths]
    names = base_names([path for path in paths if path.parts[0] == area])
    assert [name for name, count in Counter(names).items() if count > 1] == []


def test_base_names_are_counted_with_folders():
    paths = [Path("a/elvis/a/files/files.py"), Path("a/elvis/a/other/files.py"), Path("a/elvis/a/other/__init__.py")]
    assert Counter(base_names(paths)) == {"files": 2, "other": 1}


def test_modules_listed_as_long_exist(root):
    names = (root / "tests" / "long.txt").read_text(encoding="utf-8").split()
    assert len(names) > 10
    assert [name for name in names if not (root / "tests" / f"{name}.py").is_file()] == []


@pytest.mark.parametrize("pattern", [REGISTRIES, MACHINE_PATHS], ids=["registry", "machine path"])
def test_files_name_no_registry_and_no_machine(root, project_files, pattern):
    found = []
    for path in project_files:
        text = path.read_bytes().decode(errors="ignore")
        found += [f"{path.relative_to(root)}: {match.group()}" for match in pattern.finditer(text)]
    assert not found


def test_the_patterns_match_their_examples():
    assert REGISTRIES.search("https://" + "py" + "pi.org/simple")
    assert MACHINE_PATHS.search("see /" + "work/main")
    assert not MACHINE_PATHS.search("framework/main ../work/x")
