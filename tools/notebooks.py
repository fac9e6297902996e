"""Run the notebooks of docs/notebooks and keep what they show: `make pages` does; the site shows them (docs/conf.py).

    python tools/notebooks.py FOLDER      in a folder that has the data which they read

Cells run in this process, one after another, as `docs/python.md` does in the tests; no Jupyter is needed.
"""

from __future__ import annotations

import ast
import base64
import contextlib
import io
import json
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "notebooks"


def run(path: Path, changed: Callable[[str], str] = str) -> dict[str, Any]:
    """The notebook with what its cells print and show, in the current folder; an exception of a cell comes out.

    changed  what runs in place of a cell's source, for tests
    """
    notebook: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    names: dict[str, Any] = {"__name__": "__main__"}
    code = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for number, cell in enumerate(code, 1):
        cell["execution_count"] = number
        cell["outputs"] = _outputs(changed("".join(cell["source"])), f"{path.name} cell {number}", names, number)
    return notebook


def _outputs(source: str, title: str, names: dict[str, Any], number: int) -> list[dict[str, Any]]:
    """What a cell prints, and the value of its last line where that is an expression."""
    tree = ast.parse(source, title)
    last = tree.body.pop() if tree.body and isinstance(tree.body[-1], ast.Expr) else None
    printed, value = io.StringIO(), None
    with contextlib.redirect_stdout(printed):
        exec(compile(tree, title, "exec"), names)
        if isinstance(last, ast.Expr):
            value = eval(compile(ast.Expression(last.value), title, "eval"), names)
    outputs: list[dict[str, Any]] = []
    if printed.getvalue():
        outputs.append({"name": "stdout", "output_type": "stream", "text": _lines(printed.getvalue())})
    if value is not None:
        shown = {"data": _shown(value), "execution_count": number, "metadata": {}, "output_type": "execute_result"}
        outputs.append(shown)
    return outputs


def _shown(value: Any) -> dict[str, Any]:
    """A value as notebooks show it, by MIME type."""
    data: dict[str, Any] = {"text/plain": _lines(repr(value))}
    if hasattr(value, "_repr_png_"):
        data["image/png"] = base64.b64encode(value._repr_png_()).decode()
    elif hasattr(value, "_repr_html_"):
        data["text/html"] = _lines(value._repr_html_())
    return data


def _lines(text: str) -> list[str]:
    return text.splitlines(keepends=True)


def as_markdown(text: str) -> str:
    """A notebook as a page: its code in blocks, what it shows below."""
    parts = []
    for cell in json.loads(text)["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source}\n```")
        parts += [_output(each) for each in cell["outputs"]]
    return "\n\n".join(parts) + "\n"


def _output(output: dict[str, Any]) -> str:
    data = output.get("data", {"text/plain": output.get("text")})
    if "image/png" in data:
        return _html(f'<img class="shown" alt="" src="data:image/png;base64,{data["image/png"]}">')
    if "text/html" in data:
        return _html(f'<div class="shown">{"".join(data["text/html"])}</div>')
    return "```{code-block} text\n:class: shown\n\n" + "".join(data["text/plain"]) + "\n```"


def _html(text: str) -> str:
    return f"```{{raw}} html\n{text}\n```"


def parser() -> Any:
    """The parser that lets Sphinx read notebooks."""
    from myst_parser.parsers.sphinx_ import MystParser

    class NotebookParser(MystParser):
        """Notebooks by way of Markdown."""

        supported = ("notebook",)

        def parse(self, inputstring: str, document: Any) -> None:
            super().parse(as_markdown(inputstring), document)

    return NotebookParser


def main() -> None:
    """Run the notebooks and write them with what they show."""
    os.chdir(sys.argv[1])
    for path in sorted(FOLDER.glob("*.ipynb")):
        path.write_text(json.dumps(run(path), indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
        print(f"{path.name}: {path.stat().st_size / 1000:.0f} kB")


if __name__ == "__main__":
    main()
