"""``elvis sample``: data to try the commands with."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click

from elvis.core.data.arguments import overwrite_option

if TYPE_CHECKING:
    from elvis.core.data.dataset import Dataset

EPILOG = """\b
Examples:
  elvis sample wing
  elvis wing.xml wing.fld
  elvis render wing.xml wing.fld --field p --plane z=0.2 -o wing.png
  elvis sample wave
  elvis animate wave.xml wave_*.chk -o wave.webp
"""

#: names of the samples
NAMES = ("wing", "cylinder", "bend", "blocks", "wave", "resolved")


@click.command("sample", epilog=EPILOG, short_help="Write sample data to try the commands with.")
@click.argument("name", type=click.Choice(NAMES), default="wing")
@click.option(
    "-o",
    "--output",
    "folder",
    type=click.Path(path_type=Path, file_okay=False, exists=True),
    default=Path(),
    help="Folder to write to.  [default: the current folder]",
)
@overwrite_option
def sample(name: str, folder: Path, overwrite: bool) -> None:
    """Write NAME.xml and NAME.fld, the exact fields of which are known.

    \b
    wing      3D, an analytic flow u, v, w, p around a swept wing on 480 curved
              hexahedra of order 4; boundaries wing, far and symmetry
    cylinder  2D, potential flow u, v, Cp past a cylinder, triangles of order 8; boundaries cylinder and far
    bend      3D, the speed of a flow through a curved duct, hexahedra of order 5
    blocks    3D, a wave over all volume shapes in one mesh, order 6
    wave      2D, a series of nine steps, wave_0.chk to wave_8.chk, order 7
    resolved  2D, a smooth field, a layer, a shock and a corner, order 4
    """
    from elvis.core.base.terminal import say

    mesh, *fields = write_sample(name, folder, overwrite)
    say(f"wrote {mesh} and {fields[0]}" + (f" to {fields[-1].name}" if len(fields) > 1 else ""))


def write_sample(name: str, folder: Path, overwrite: bool = True) -> list[Path]:
    """Write a sample; returns the mesh file and the field files.

    Raises ElvisError for a file that exists, unless it may be overwritten.
    """
    import os

    from elvis.core.base.errors import ElvisError
    from elvis.formats.writing import write

    steps = _steps(name)
    mesh = folder / f"{name}.xml"
    fields = [folder / (f"{name}.fld" if len(steps) == 1 else f"{name}_{i}.chk") for i in range(len(steps))]
    taken = [path for path in (mesh, *fields) if os.path.lexists(path)]
    if taken and not overwrite:
        raise ElvisError(f"{taken[0]} already exists; choose another folder with -o, or pass --overwrite")
    if len(steps) == 1:
        write(steps[0], mesh, fields[0])
        return [mesh, *fields]
    write(replace(steps[0], fields=(), time=None), mesh)
    for step, path in zip(steps, fields, strict=True):
        write(step, field_path=path)
    return [mesh, *fields]


def _steps(name: str) -> list[Dataset]:
    """The steps of a sample, or its only state."""
    from elvis.plugins.samples import further_samples
    from elvis.plugins.samples.sample_data import wing

    if name == "wing":
        return [wing()]
    found = getattr(further_samples, name)()
    return found if isinstance(found, list) else [found]
