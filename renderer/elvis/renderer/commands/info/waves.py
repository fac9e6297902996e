"""``elvis info --waves``: the energy of fields by waves of a Fourier direction, as a table."""

from __future__ import annotations

from dataclasses import asdict
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from elvis.renderer.commands.sources import NativeSource


def print_waves(source: NativeSource, box: str | None, as_json: bool) -> None:
    """Print a row for each wave, of all elements or of those in a box ``x0,x1,y0,y1``."""
    from elvis.core.base.terminal import print_json, print_table, say, stage
    from elvis.core.data.arguments import numbers
    from elvis.plugins.fourier.planes import wave_energies

    with stage("integrating"):
        found = wave_energies(source.dataset, () if box is None else numbers(box, 4))
    if as_json:
        print_json(asdict(found))
        return
    names = list(found.by_field)
    rows = []
    for number, wave in enumerate(found.waves):
        length = f"{found.period / wave:.6g}" if wave else "mean"
        rows.append((wave, length, *(f"{found.by_field[name][number]:.6g}" for name in names)))
    print_table(("wave", "wavelength", *names), rows)
    where = "the elements in the box" if box else "the plane"
    say(f"\nMean squares over {where} and the period; they add up to those of the fields.")
