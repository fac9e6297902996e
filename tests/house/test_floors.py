"""An area imports only from the floors below it."""

import ast

FLOORS = {"formats": 1, "plugins": 2, "converters": 3, "renderer": 3, "reference": 4}


def imported_areas(tree):
    """Pairs of line and area, for every import of the namespace in a module, wherever it stands."""
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
        area = path.relative_to(root).parts[0]
        for line, other in imported_areas(tree):
            if other != area and FLOORS.get(other, 99) >= FLOORS[area]:
                wrong.append(f"{path.relative_to(root)}:{line}: {area} imports {other or 'elvis itself'}")
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
    assert list(imported_areas(ast.parse(source))) == [(1, "plugins"), (2, "renderer"), (3, "reference")]
