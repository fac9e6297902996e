"""Modules and functions stay small enough to be read at one sitting."""

import ast
import re

import pytest

FILE_LINES = 450
FUNCTION_LINES = 40
SLANG_LINES = 60

#: what stands before the brace of a function, but also of a loop or condition
HEAD = re.compile(r"\b(\w+)\s*(?:<[^<>;{}]*>)?\s*\((?:[^(){};]|\([^(){};]*\))*\)\s*$")
NO_FUNCTION = ("if", "for", "while", "switch")


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


def test_slang_functions_are_short(project_files):
    lines = {
        (path.name, name): count
        for path in project_files
        if path.suffix == ".slang"
        for name, count in slang_functions(path.read_text(encoding="utf-8"))
        if count > SLANG_LINES
    }
    assert not lines


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


def slang_functions(source):
    """Names of all functions, and their lines from brace to brace."""
    code = re.sub(r"//[^\n]*", "", source)
    opened = []
    for match in re.finditer(r"[{}]", code):
        if match.group() == "{":
            opened.append(match.start())
            continue
        start = opened.pop()
        head = HEAD.search(code, max(0, start - 2000), start)
        if head and head.group(1) not in NO_FUNCTION:
            yield head.group(1), code.count("\n", start, match.start()) + 1


def is_broad(handler):
    return handler.type is None or getattr(handler.type, "id", "") in ("Exception", "BaseException")


def answers(handler):
    """Whether the handler raises, or returns what it was told."""
    named = [n for n in ast.walk(handler) if isinstance(n, ast.Name) and n.id == handler.name]
    return bool(named) or any(isinstance(node, ast.Raise) for node in ast.walk(handler))


@pytest.mark.parametrize(("source", "lines"), [("def f():\n  'doc'\n  x = 1\n  return x", 2), ("def f():\n  'doc'", 1)])
def test_a_docstring_is_no_body(source, lines):
    assert body_lines(ast.parse(source).body[0]) == lines


def test_slang_functions_are_found():
    source = """
struct Frame
{
    __init() {}
    public static Frame of<V : IVolume>(V volume, float3 at = float3(0, 0, 0))
    {
        if (volume.has(at)) { return Frame(); }
        for (int k = 0; k < 3; ++k)
        {
        }
        return Frame(); // not f()
    }
}
"""
    assert list(slang_functions(source)) == [("__init", 1), ("of", 7)]
