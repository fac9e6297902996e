"""The house stands as it should: areas, namespace, what may not be written into a file."""

import re

import pytest

#: folders at the top and the slices of the namespace that they hold
AREAS = {
    "formats": ("core", "formats"),
    "plugins": ("plugins",),
    "converters": ("converters",),
    "renderer": ("renderer", "scene"),
    "reference": ("reference",),
}

#: written so that this file does not match itself
REGISTRIES = re.compile(
    r"py[p]i\.org|python[h]osted|deb\.d[e]bian|archive\.u[b]untu|crates\.i[o]\b|npm[j]s|proxy\.gol[a]ng|repo1?\.mav[e]n",
    re.I,
)
MACHINE_PATHS = re.compile(r"(?<![\w.~-])/(?:wor[k]|roo[t]|hom[e])/\w")


def test_no_module_hides_the_areas(root):
    assert not list(root.glob("*/elvis/__init__.py"))


@pytest.mark.parametrize("area", AREAS)
def test_every_area_has_its_page_and_its_types(root, area):
    assert (root / area / "README.md").is_file()
    slices = sorted(folder.name for folder in (root / area / "elvis").iterdir() if folder.name != "__pycache__")
    assert slices == sorted(AREAS[area])
    for name in slices:
        assert (root / area / "elvis" / name / "py.typed").is_file()


def test_modules_that_are_called_long_are_there(root):
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


def test_the_patterns_catch_what_they_should():
    assert REGISTRIES.search("https://" + "py" + "pi.org/simple")
    assert MACHINE_PATHS.search("see /" + "work/main")
    assert not MACHINE_PATHS.search("framework/main ../work/x")
