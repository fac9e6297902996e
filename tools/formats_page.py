"""Writes docs/start/formats.md, the table of what each converter reads, from their own words; `make pages` runs it."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path

from elvis.plugins.conversion.discovery import installed_converters
from elvis.plugins.conversion.plugin import Converter, Reads

PAGE = Path(__file__).parents[1] / "docs" / "start" / "formats.md"
HEAD = """# Formats

This page lists what ElVis reads of each format. `elvis convert --list` also shows what each converter loses. Every
command reports which contents of your files it skipped.

* *All* shapes are segments, triangles, quadrilaterals, tetrahedra, pyramids, prisms and hexahedra.
* Entries *by place*: if a side has no partner but lies on sides of other elements, ElVis treats it as an inner side.
* *Numbered files*: files whose names differ in a number are steps, unless the format marks them as parts or their
  meshes don't overlap. All commands follow this rule.
* If a field is defined on a part of the mesh, its values elsewhere are NaN.
* The `vtk` converter reads the `.pvd` series of Firedrake's `VTKFile`: functions of any order, continuous or not,
  tensors and pieces of processes. In one dimension Firedrake numbers nodes from end to end; ElVis recognizes this.
* `--fields u,p` reads only these fields, in every command; so does `read(…, reader={"fields": "u,p"})`.
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
