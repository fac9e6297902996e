"""``elvis sample``: data to try the commands with."""

from __future__ import annotations

from pathlib import Path

import click

from elvis.core.arguments import overwrite_option

EPILOG = """\b
Examples:
  elvis sample wing
  elvis wing.xml wing.fld
  elvis render wing.xml wing.fld --field p --plane z=0.2 -o wing.png
"""


@click.command("sample", epilog=EPILOG, short_help="Write sample data to try the commands with.")
@click.argument("name", type=click.Choice(["wing"]), default="wing")
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
    """Write wing.xml and wing.fld, an analytic flow around a swept wing on 480 curved hexahedra of order 4.

    The fields are the velocity u, v, w and the pressure p; the boundaries are wing, far and symmetry.
    """
    import os

    from elvis.core.errors import ElvisError
    from elvis.core.terminal import say
    from elvis.formats.writing import write
    from elvis.plugins.sample_data import wing

    paths = [folder / f"{name}.xml", folder / f"{name}.fld"]
    taken = [path for path in paths if os.path.lexists(path)]
    if taken and not overwrite:
        raise ElvisError(f"{taken[0]} already exists; choose another folder with -o, or pass --overwrite")
    write(wing(), *paths)
    say(f"wrote {' and '.join(map(str, paths))}")
