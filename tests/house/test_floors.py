"""A slice of the namespace imports only from those below it."""

import ast
import re

import pytest

import elvis
from elvis import api

#: slices that each one may import next to itself; an area is a folder at the top and holds one or two slices
BELOW = {
    "core": set(),
    "formats": {"core"},
    "plugins": {"core", "formats"},
    "converters": {"core", "formats", "plugins"},
    "scene": {"core"},
    "renderer": {"core", "formats", "plugins", "scene"},
    "viewer": {"core", "formats", "plugins", "scene", "renderer"},
    "reference": {"core", "formats", "plugins", "scene"},
    "api": {"core", "formats", "plugins", "converters", "scene", "renderer", "viewer", "reference"},
}

MODULE = re.compile(r"elvis(\.\w+)+")


def imported_slices(nodes):
    """Pairs of line and slice, for every import of the namespace in a module, wherever it stands."""
    for node in nodes:
        names = []
        if isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for name in names:
            first, _, rest = name.partition(".")
            if first == "elvis":
                yield node.lineno, rest.partition(".")[0]


def slice_of(path):
    """The slice of a module: `python -m elvis` belongs to plugins, `import elvis` to the API."""
    return {"__main__.py": "plugins", "__init__.py": "api"}.get(path.parts[2], path.parts[2])


def test_imports_point_downwards(root, nodes):
    wrong = []
    for path, own_nodes in nodes.items():
        own = slice_of(path.relative_to(root))
        for line, other in imported_slices(own_nodes):
            if other not in {own, *BELOW[own]}:
                wrong.append(f"{path.relative_to(root)}:{line}: {own} imports {other or 'elvis itself'}")
    assert not wrong


def test_imports_across_areas_are_absolute(root, nodes):
    depth = {path: len(path.relative_to(root).parts) - 3 for path in nodes}
    wrong = [
        f"{path.relative_to(root)}:{node.lineno}"
        for path, own_nodes in nodes.items()
        for node in own_nodes
        if isinstance(node, ast.ImportFrom) and node.level > depth[path]
    ]
    assert not wrong


def test_the_api_is_one_table(modules, root):
    """What type checkers see, what Python imports, and what ``dir`` lists are the same names."""
    tree = modules[root / "renderer/elvis/api/__init__.py"]
    seen = {
        (node.module, alias.name) for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for alias in node.names
    }
    names = {(module, name) for module, names in api.NAMES.items() for name in names}
    assert names == seen - {
        ("__future__", "annotations"),
        ("typing", "TYPE_CHECKING"),
        ("elvis.core.base.lazy", "lazy_names"),
    }
    assert sorted(name for _, name in names) == sorted(api.__all__) == sorted(dir(elvis))
    assert all(hasattr(elvis, name) for name in api.__all__)
    with pytest.raises(AttributeError, match="has no attribute 'render_all'"):
        elvis.render_all  # noqa: B018


def test_modules_named_in_text_are_also_below(root, nodes):
    """What ``import_module``, ``lazy_names`` and their like are told."""
    wrong = []
    for path, own_nodes in nodes.items():
        own = slice_of(path.relative_to(root))
        for node in own_nodes:
            if isinstance(node, ast.Constant) and isinstance(node.value, str) and MODULE.fullmatch(node.value):
                other = node.value.split(".")[1]
                if other in BELOW and other not in {own, *BELOW[own]} and node.value not in groups(root):
                    wrong.append(f"{path.relative_to(root)}:{node.lineno}: {own} names {node.value}")
    assert not wrong


def test_the_core_reaches_the_api_in_one_place(root, nodes):
    """Methods that are short for functions of ``import elvis`` find these by `elvis.core.base.lazy.public`."""
    callers = {
        path.relative_to(root).as_posix()
        for path, own_nodes in nodes.items()
        for node in own_nodes
        if isinstance(node, ast.Call) and any(isinstance(a, ast.Constant) and a.value == "elvis" for a in node.args)
        if getattr(node.func, "id", getattr(node.func, "attr", "")) == "import_module"
    }
    assert callers == {"formats/elvis/core/base/lazy.py"}


def test_no_command_receives_objects_from_above_it(root, nodes):
    """The object of click's context holds the settings of a run and nothing else; it is read where it is made."""
    readers = {
        path.relative_to(root).as_posix()
        for path, own_nodes in nodes.items()
        for node in own_nodes
        if isinstance(node, ast.Attribute) and node.attr == "obj"
    }
    assert readers == {"plugins/elvis/plugins/command/running.py"}


def test_entry_points_are_also_open_to_other_distributions(root):
    """A group that only our own slices used would be an import upwards in disguise."""
    page = (root / "plugins" / "README.md").read_text(encoding="utf-8")
    assert groups(root) == set(re.findall(r"^\| `(elvis\.\w+)` \|", page, re.M))


def groups(root):
    """The groups of entry points that the distribution uses."""
    text = (root / "pyproject.toml").read_text(encoding="utf-8")
    return set(re.findall(r'^\[project\.entry-points\."([\w.]+)"\]', text, re.M))


def test_every_form_of_import_is_recognised():
    source = "import elvis.plugins.x\nfrom elvis import renderer\nfrom elvis.reference.y import z\nimport numpy"
    assert list(imported_slices(ast.walk(ast.parse(source)))) == [(1, "plugins"), (2, "renderer"), (3, "reference")]


def test_scripts_from_before_find_their_names():
    from elvis import formats, renderer

    assert formats.read is elvis.read
    assert renderer.Plane is elvis.Plane
    with pytest.raises(AttributeError, match="no attribute 'render_all'"):
        renderer.render_all  # noqa: B018
