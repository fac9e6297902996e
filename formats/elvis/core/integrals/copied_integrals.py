"""Integrals over copies of the domain: sums of integrals over the domain, of the quantities of each copy.

An isometry keeps lengths, areas and volumes, so the integral of f over the copy R x + s is the integral of f(R x + s)
over the domain.  Copies with the same quantities, such as pressures, are integrated once.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.deformed.isometries import Isometry
from elvis.core.integrals.integration import BOUND, ESTIMATE, EXACT, Integral, Integrals, integrate, moved_integrands
from elvis.core.integrals.levels.of_elements import Level
from elvis.core.integrals.line_targets import is_line
from elvis.core.quantities.tree import Node

#: kinds of errors, from the best to the worst
_KINDS = (EXACT, BOUND, ESTIMATE)


def integrate_copies(
    dataset: Dataset,
    field: Sequence[str],
    over: Sequence[str],
    isometries: Sequence[Isometry],
    error: float,
    coefficients: str | None = None,
    clip: str | None = None,
    *options: Any,
) -> Integrals:
    """Integrals of quantities over all copies of the domain, regions or boundaries.

    Parameters
    ----------
    dataset, field, over, error, coefficients, options
        As in `integrate`.
    isometries : sequence of Isometry
        They make the copies, the data included.

    Returns
    -------
    Integrals
        Sums of values, errors and measures; averages are those over all copies.

    Raises
    ------
    ElvisError
        As `integrate`, and for surfaces, curves and clips in space.
    """
    in_space = [name for name in over if is_line(name) or Level.parse(dataset, name) is not None]
    if in_space or clip is not None:
        found = in_space[0] if in_space else "a clip"
        raise ElvisError(f"--with-copies: expected the domain, regions and boundaries, found {found}")
    groups: dict[tuple[Node, ...], list[Isometry]] = {}
    for isometry in isometries:
        wanted = moved_integrands(dataset, field, coefficients, isometry)
        groups.setdefault(tuple(each.expression.root for each in wanted), []).append(isometry)
    parts = []
    for own in groups.values():
        moved = partial(integrate, copy=own[0])
        parts += len(own) * [moved(dataset, list(field), list(over), error, coefficients, None, *options)]
    rows = [_total(each) for each in zip(*parts, strict=True)]
    return Integrals(rows, tuple(dict.fromkeys(remark for part in parts for remark in part.remarks)))


def _total(rows: Sequence[Integral]) -> Integral:
    """The sum of integrals over copies, or their mean for averages."""
    first = rows[0]
    share = 1.0 / len(rows) if first.integrand.strip().startswith("average") else 1.0
    return replace(
        first,
        value=share * sum(row.value for row in rows),
        error=share * sum(row.error for row in rows),
        measure=sum(row.measure for row in rows),
        exact=all(row.exact for row in rows),
        kind=max((row.kind for row in rows), key=_KINDS.index),
        finished=all(row.finished for row in rows),
    )
