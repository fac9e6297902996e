"""Counting pixels: the wrong ones that are called certain, the ambiguous, the failed."""

from dataclasses import dataclass, field

import numpy as np

from audit.worlds import BORDER, margins
from elvis.scene.record.frame import Status


@dataclass
class Count:
    """Pixels of some cases.

    pixels     whose rays come near the domain
    wrong      certain (hit or missed), but not so
    first      sentences about the first wrong pixel of cases that have any
    given_up   cases that took longer than they were given, which are not counted otherwise; their names are in ``slow``
    ordinary, ordinary_ambiguous  pixels of ordinary scenes, and those of them that are ambiguous
    """

    cases: int = 0
    pixels: int = 0
    wrong: int = 0
    ambiguous: int = 0
    failed: int = 0
    ordinary: int = 0
    ordinary_ambiguous: int = 0
    seconds: float = 0.0
    first: list = field(default_factory=list)
    given_up: int = 0
    slow: list = field(default_factory=list)

    def add(self, other):
        """Add another count to this one."""
        for name, value in vars(other).items():
            setattr(self, name, getattr(self, name) + value)


def validate(case, frame, truth, rays):
    """The count of one picture of surfaces."""
    status, depth = frame.status.reshape(-1), frame.depth.reshape(-1)
    counted = (truth.counted | (status != Status.MISS)) & ~truth.free
    certain = (status == Status.CERTAIN) & counted
    missed = (status == Status.MISS) & counted
    matched, found, slack = _matched(frame, truth, depth)
    with np.errstate(invalid="ignore"):
        hidden = (truth.sure & (truth.depth + truth.slack < (found - slack)[:, None])).any(axis=1)
    reasons = {
        "missed what must be seen": missed & truth.sure.any(axis=1),
        "seen where nothing is": certain & ~matched,
        "seen behind what must be seen": certain & matched & hidden,
    }
    there = np.flatnonzero(certain & matched)
    reasons |= _contents(frame, truth, rays, there, found[there])
    return counted_as(case, status, counted, reasons, lambda pixel: _details(frame, truth, pixel))


def counted_as(case, status, counted, reasons, details):
    """The count of pixels with a status (n,); reasons are masks (n,) of what is wrong."""
    wrong = np.any(list(reasons.values()), axis=0)
    ambiguous = int((counted & (status == Status.AMBIGUOUS)).sum())
    pixels, first = int(counted.sum()), []
    if wrong.any():
        kinds = ", ".join(f"{int(mask.sum())} {name}" for name, mask in reasons.items() if mask.any())
        first = [f"{case.name}: {int(wrong.sum())} of {pixels} ({kinds}); {details(int(np.flatnonzero(wrong)[0]))}"]
    return Count(
        cases=1,
        pixels=pixels,
        wrong=int(wrong.sum()),
        ambiguous=ambiguous,
        failed=int((counted & (status == Status.FAILED)).sum()),
        ordinary=pixels if case.ordinary else 0,
        ordinary_ambiguous=ambiguous if case.ordinary else 0,
        first=first,
    )


def _matched(frame, truth, depth):
    """(n,) whether a depth is that of a candidate; the candidate's depth and slack."""
    slack, own = truth.slack, getattr(frame, "uncertainty", None)
    if own is not None:
        # the record's own word, as far as certain pixels may go
        promised = np.nan_to_num(own.reshape(-1), nan=0.0, posinf=0.0)
        most = 1e-8 * np.where(np.isfinite(depth), np.abs(depth), 0.0)
        slack = np.maximum(slack, np.minimum(promised, most)[:, None])
    with np.errstate(invalid="ignore"):
        distance = np.abs(truth.depth - depth[:, None])
    distance = np.where(np.isfinite(distance), distance, np.inf)
    best = np.where(distance <= slack, distance, np.inf).argmin(axis=1)
    rows = np.arange(len(depth))
    return (distance <= slack)[rows, best], truth.depth[rows, best], slack[rows, best]


def _contents(frame, truth, rays, pixels, depth):
    """Masks (n,): whether the element and the value of some certain pixels, seen at ``depth``, are wrong."""
    element, value = frame.element.reshape(-1), frame.field.reshape(-1)
    wrong = np.zeros((2, len(element)), bool)
    places, own = rays.at(pixels, depth), element[pixels]
    if rays.sides is not None:
        legal = (own >= 0) & (own < len(rays.sides))
        away = margins(rays.sides, np.where(legal, own, 0), places)
        wrong[0, pixels] = ~legal | (away < -BORDER - rays.rounding.max())
    if truth.field is not None:
        wanted = truth.field(places.astype(float))
        wrong[1, pixels] = ~(np.abs(value[pixels] - wanted) <= truth.tolerance + rays.noise(truth.field))
    return {"the wrong element": wrong[0], "the wrong value": wrong[1]}


def _details(frame, truth, pixel):
    row, column = divmod(pixel, frame.view.width)
    depths = truth.depth[pixel][np.isfinite(truth.depth[pixel])]
    wanted = ", ".join(f"{float(d):.12g}" for d in np.sort(depths)[:4]) or "nothing"
    found = frame.depth[row, column]
    return f"pixel ({column}, {row}): expected {wanted}, found {found:.12g} in element {frame.element[row, column]}"
