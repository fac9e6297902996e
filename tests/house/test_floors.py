"""A slice of the namespace imports only from those below it."""

import ast

#: slices that each one may import beside itself; an area is a folder at the top and holds one or two slices
BELOW = {
    "core": set(),
    "formats": {"core"},
    "plugins": {"core", "formats"},
    "converters": {"core", "formats", "plugins"},
    "scene": {"core", "formats", "plugins"},
    "renderer": {"core", "formats", "plugins", "scene"},
    "reference": {"core", "formats", "plugins", "converters", "scene"},
}


def imported_slices(tree):
    """Pairs of line and slice, for every import of the namespace in a module, wherever it stands."""
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.ImportFrom) and node.level == 0:
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for name in names:
            first, _, rest = name.partition(".")
            if first == "elvis":
                yield node.lineno, rest.partition(".")[0]


def test_imports_go_down(root, modules):
    wrong = []
    for path, tree in modules.items():
        own = path.relative_to(root).parts[2]
        for line, other in imported_slices(tree):
            if other not in {own, *BELOW[own]}:
                wrong.append(f"{path.relative_to(root)}:{line}: {own} imports {other or 'elvis itself'}")
    assert not wrong


def test_imports_across_areas_are_absolute(root, modules):
    depth = {path: len(path.relative_to(root).parts) - 3 for path in modules}
    wrong = [
        f"{path.relative_to(root)}:{node.lineno}"
        for path, tree in modules.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom) and node.level > depth[path]
    ]
    assert not wrong


def test_every_way_to_import_is_seen():
    source = "import elvis.plugins.x\nfrom elvis import renderer\nfrom elvis.reference.y import z\nimport numpy"
    assert list(imported_slices(ast.parse(source))) == [(1, "plugins"), (2, "renderer"), (3, "reference")]
