"""Modules and functions stay small enough to be read at one sitting."""

import ast

import pytest

FILE_LINES = 450
FUNCTION_LINES = 40


def test_files_are_short(root, project_files):
    code = [path for path in project_files if path.suffix in (".py", ".slang")]
    lengths = {path.relative_to(root): path.read_text(encoding="utf-8").count("\n") for path in code}
    assert not {path: lines for path, lines in lengths.items() if lines > FILE_LINES}


def test_functions_are_short(root, modules):
    long = {
        f"{path.relative_to(root)}:{node.lineno} {node.name}": body_lines(node)
        for path, tree in modules.items()
        for node in ast.walk(tree)
        if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef)) and body_lines(node) > FUNCTION_LINES
    }
    assert not long


def test_no_handler_swallows_everything(root, modules):
    silent = [
        f"{path.relative_to(root)}:{node.lineno}"
        for path, tree in modules.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.ExceptHandler) and is_broad(node) and not answers(node)
    ]
    assert not silent


def body_lines(function):
    """Lines of the body without the docstring."""
    first = function.body[ast.get_docstring(function) is not None :]
    return function.end_lineno - first[0].lineno + 1 if first else 1


def is_broad(handler):
    return handler.type is None or getattr(handler.type, "id", "") in ("Exception", "BaseException")


def answers(handler):
    """Whether the handler raises, or returns what it was told."""
    named = [n for n in ast.walk(handler) if isinstance(n, ast.Name) and n.id == handler.name]
    return bool(named) or any(isinstance(node, ast.Raise) for node in ast.walk(handler))


@pytest.mark.parametrize(("source", "lines"), [("def f():\n  'doc'\n  x = 1\n  return x", 2), ("def f():\n  'doc'", 1)])
def test_a_docstring_is_no_body(source, lines):
    assert body_lines(ast.parse(source).body[0]) == lines
