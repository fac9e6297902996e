"""Modules and functions stay small enough to be read at one sitting."""

import ast
import importlib.util
import re

SLANG_LINES = 60

#: what stands before the brace of a function, but also of a loop or condition
HEAD = re.compile(r"\b(\w+)\s*(?:<[^<>;{}]*>)?\s*\((?:[^(){};]|\([^(){};]*\))*\)\s*$")
#: how handlers begin that catch everything
BROAD = re.compile(r"except(\s*:|\s+(Base)?Exception\b)")
NO_FUNCTION = ("if", "for", "while", "switch")


def test_size_faults_name_oversized_and_needlessly_listed_items(root):
    sizes = loaded(root / "tools" / "sizes.py")
    faults = list(sizes.size_faults({"a.py:f": 401, "b.py": 4001}, {"b.py", "c.py"}))
    assert faults == [
        "a.py:f has 401 tokens, 400 are allowed: divide it",
        "c.py is within the limits: remove it from oversized.txt",
    ]
    text = "def f(x):\n    'doc'\n    # comment\n    def g():\n        return 1\n    return x + g()\n"
    assert dict(sizes.function_sizes(text)) == {"f": 19, "g": 7}
    # an f-string is one token in each version of Python
    assert sizes.python_size("x = f'{f(a, b)} and {c}'\n") == (3, 1)


def loaded(path):
    """A program of the folder tools as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_slang_functions_are_short(project_files):
    lines = {
        (path.name, name): count
        for path in project_files
        if path.suffix == ".slang"
        for name, count in slang_functions(path.read_text(encoding="utf-8"))
        if count > SLANG_LINES
    }
    assert not lines


def test_no_handler_catches_everything_silently(root, module_paths):
    sources = {path: path.read_text(encoding="utf-8") for path in module_paths}
    # only these have such handlers: all would take seconds to parse
    suspects = {path: source for path, source in sources.items() if BROAD.search(source)}
    assert suspects
    silent = [
        f"{path.relative_to(root)}:{node.lineno}"
        for path, source in suspects.items()
        for node in ast.walk(ast.parse(source))
        if isinstance(node, ast.ExceptHandler) and is_broad(node) and not answers(node)
    ]
    assert not silent


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
