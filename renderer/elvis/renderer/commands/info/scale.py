"""``elvis info --largest-scale``: the smallest factor of a displacement at which an element folds."""

from __future__ import annotations

from dataclasses import asdict, replace
from math import isfinite
from typing import TYPE_CHECKING

import click

from elvis.core.base.ranks import is_idle

if TYPE_CHECKING:
    from elvis.core.base.ranks import Ranks
    from elvis.core.validity.largest_scale import LargestScale
    from elvis.renderer.commands.sources import Data

#: what is proved of the Jacobian at the second bound
_STATES = {
    "negative": "the Jacobian is negative there",
    "zero": "the Jacobian is zero within rounding there",
    "undecided": "that is an estimate: the Jacobian there is too small for a proof",
}


def print_largest_scale(data: Data, ranks: Ranks, as_json: bool) -> None:
    """Print both bounds, the element and the place; UsageError without a displacement."""
    from elvis.core.base.terminal import print_json, say, stage
    from elvis.plugins.data.deforming import largest_scale
    from elvis.renderer.commands.sources import native_source

    if data.deformation is None or data.deformation.height:
        raise click.UsageError("expected --deform with --largest-scale", click.get_current_context())
    if is_idle(ranks):
        return
    text = data.deformation.displacement
    # the geometry itself is not deformed: its folds at some scale say nothing of others
    source = native_source(replace(data, deformation=None).source(), "--largest-scale")
    with stage("proving"):
        found = largest_scale(source.dataset, text)
    if as_json:
        print_json(_facts(found))
    else:
        say("\n".join(_sentences(found)))


def _facts(found: LargestScale) -> dict[str, object]:
    """As plain data that JSON can hold."""
    facts = {**asdict(found), "certified": found.is_certified}
    return facts if isfinite(found.folded) else {**facts, "folded": None, "state": None, "element": None}


def _sentences(found: LargestScale) -> list[str]:
    """The proved bounds, in sentences."""
    if found.folded == 0:
        return [f"element {found.element} is inverted or folded without any displacement"]
    valid = f"no element folds at any scale from 0 to {found.valid:.9g}: proved"
    if not isfinite(found.folded):
        return [f"{valid}; larger scales were not considered"]
    before, after = (", ".join(f"{x:.9g}" for x in place) for place in (found.before, found.after))
    where = f"element {found.element} folds at scale {found.folded:.9g}, at {before}, which is moved to {after}"
    certain = [] if found.is_certified else ["the two scales differ by more than 1e-6: no closer bounds are proved"]
    return [valid, f"{where}; {_STATES[found.state]}", *certain]
