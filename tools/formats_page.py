"""Writes docs/start/formats.md, the table of what each converter reads, from their own words; `make pages` runs it."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from elvis.plugins.conversion import Converter, Reads
from elvis.plugins.discovery import installed_converters

PAGE = Path(__file__).parents[1] / "docs" / "start" / "formats.md"
HEAD = """# What is read of each format

Look here before you try. `elvis convert --list` shows what each converter keeps and loses. Every command reports what
it left out of your files.

* *All* shapes are segments, triangles, quadrilaterals, tetrahedra, pyramids, prisms and hexahedra.
* *By place*: a side with no partner that lies on sides of other elements is found to be an inner one.
* *Numbered files*: files whose names differ in a number are steps, unless the format marks them as parts or their
  meshes don't overlap. All commands follow this rule.
* A field that lives on a part of the mesh is kept there; elsewhere its values are NaN.
* The `vtk` converter reads the `.pvd` series of Firedrake's `VTKFile`: functions of any order, continuous or not,
  tensors and pieces of processes. In one dimension Firedrake numbers nodes from end to end, which is recognized.
* `--fields u,p` reads some of the fields, in every command; so does `read(…, reader={"fields": "u,p"})`.
"""
TITLES = {"nonconforming": "non-conforming", "parts": "parallel pieces"}


def page() -> str:
    """The page in Markdown."""
    columns = [column.name for column in fields(Reads)]
    titles = ["converter", "files", *(TITLES.get(name, name) for name in columns)]
    lines = [HEAD, _row(titles), _row(["---"] * len(titles))]
    for candidate in installed_converters():
        converter = candidate.converter
        if converter is not None and _is_own(converter):
            words = [getattr(converter.reads, name) or "?" for name in columns]
            lines.append(_row([f"`{candidate.name}`", converter.format, *words]))
    return "\n".join(lines) + "\n"


def _is_own(converter: type[Converter]) -> bool:
    """Whether a converter is of this distribution."""
    return converter.__module__.startswith("elvis.")


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
