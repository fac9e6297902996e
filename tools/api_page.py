"""The page of the Python API, made from the docstrings of what ``import elvis`` offers (docs/conf.py)."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from typing import Any

import elvis
from elvis.scene.model.settings import settings

#: a line of a table in a docstring: names, two spaces or more, what they mean
ROW = re.compile(r"^(\S.*?)\s{2,}(\S.*)$")


def page() -> str:
    """The functions, then the classes, then the models of scenes."""
    return "\n".join(_chapters())


def _chapters() -> Iterator[str]:
    own = {name: getattr(elvis, name) for name in elvis.__all__}
    functions = {name: each for name, each in own.items() if inspect.isfunction(each)}
    models = {name: each for name, each in own.items() if is_dataclass(each) and settings(each)}
    classes = {name: each for name, each in own.items() if inspect.isclass(each) and name not in models}
    for name, each in sorted(functions.items()):
        yield f"## {name}\n\n{_signature(name, each)}\n\n{prose(each)}\n"
    for name, each in sorted(classes.items()):
        yield from _class(name, each)
    if models:
        yield "## Classes of scenes\n"
        yield "These dataclasses have the keys of [scene files](scene.md) as fields; that page describes them.\n"
        yield "| class | description | fields |\n|---|---|---|"
        yield from (f"| `{name}` | {_sentence(each)} | {_keys(each)} |" for name, each in sorted(models.items()))
        yield ""


def _class(name: str, each: type) -> Iterator[str]:
    """A class with what its docstring says, and its public methods and properties."""
    yield f"## {name}\n\n{prose(each)}\n"
    rows = []
    for member, found in sorted(vars(each).items()):
        call = found.__func__ if isinstance(found, classmethod | staticmethod) else found
        if member.startswith("_") or not (isinstance(call, property) or inspect.isfunction(call)):
            continue
        shown = f"`{member}`" if isinstance(call, property) else f"`{_call(member, call)}`".replace("|", "\\|")
        rows.append(f"| {shown} | {_sentence(call)} |")
    if rows:
        yield "| member | description |\n|---|---|"
        yield from rows
        yield ""


def _signature(name: str, function: Any) -> str:
    """The call of a function with its types, one argument a line where it is long."""
    text = _call(name, function)
    result = inspect.signature(function).return_annotation
    if len(text) > 90:
        arguments = ",\n    ".join(_arguments(function))
        text = f"{name}(\n    {arguments},\n)"
    return f"```python3\n{text} -> {result}\n```"


def _call(name: str, function: Any) -> str:
    return f"{name}({', '.join(_arguments(function))})"


def _arguments(function: Any) -> list[str]:
    """The arguments as they are written, without ``self``."""
    signature = inspect.signature(function)
    kept = [each for key, each in signature.parameters.items() if key not in ("self", "cls")]
    text = str(signature.replace(parameters=kept, return_annotation=inspect.Signature.empty))
    return re.split(r", (?=[\w*]+(?::|=|, |$)|\*)", text[1:-1].replace("'", "")) if kept else []


def prose(each: Any) -> str:
    """A docstring as Markdown: aligned lines of names and meanings become tables."""
    text = inspect.getdoc(each) or ""
    return "\n\n".join(_paragraph(part.splitlines()) for part in re.split(r"\n\s*\n", text))


def _paragraph(lines: list[str]) -> str:
    if not (ROW.match(lines[0]) and lines[0][0].isalpha() and len(ROW.match(lines[0])[1].split()) <= 4):  # type: ignore[index]
        return _text(" ".join(line.strip() for line in lines))
    rows: list[list[str]] = []
    for line in lines:
        row = ROW.match(line)
        if row:
            rows.append([row[1], row[2]])
        else:
            rows[-1][1] += f" {line.strip()}"
    cells = (f"| `{name.strip()}` | {_text(meaning)} |".replace("||", "|") for name, meaning in rows)
    return "\n".join(["| | |", "|---|---|", *cells])


def _sentence(each: Any) -> str:
    """The first paragraph of a docstring."""
    return _text(" ".join((inspect.getdoc(each) or "").split("\n\n")[0].split())).replace("|", "\\|")


def _keys(model: Any) -> str:
    return ", ".join(f"`{field.name}`" for field in fields(model) if field.name in settings(model))


def _text(text: str) -> str:
    """Text whose double back quotes are code, and in which ``<`` and ``*`` mean nothing."""
    parts = re.split(r"(`+[^`]*`+)", text)
    return "".join(part if part.startswith("`") else re.sub(r"([*<])", r"\\\1", part) for part in parts)


if __name__ == "__main__":
    print(page())
