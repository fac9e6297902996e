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


def repeated_prefixes(paths):
    """Modules named after their folder, and prefixes that three modules of a folder share: these are a folder."""
    wrong, first = [], Counter()
    for path in paths:
        prefix, mark, _ = path.stem.partition("_")
        if mark and prefix and prefix == path.parent.name:
            wrong.append(path.as_posix())
        first[path.parent, prefix] += bool(mark and prefix)
    return wrong + [f"{folder}: {prefix}_" for (folder, prefix), count in first.items() if count > 2]


def test_a_prefix_is_a_folder(root, module_paths):
    assert repeated_prefixes([path.relative_to(root) for path in module_paths]) == []


def test_prefixes_are_found():
    paths = [Path("a/cgns/cgns_sides.py"), Path("a/cgns/cgns.py"), Path("a/two_x.py"), Path("a/two_y.py")]
    assert repeated_prefixes(paths) == ["a/cgns/cgns_sides.py"]
    assert repeated_prefixes([*paths, Path("a/two_z.py")]) == ["a/cgns/cgns_sides.py", "a: two_"]


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
