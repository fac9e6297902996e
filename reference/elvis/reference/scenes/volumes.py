"""Light along rays through the volume: what elements send out and take up, by fine quadrature in every element.

Along a ray the colour gathered is the integral of T s c, T = exp(-integral of s), with density s and colour c piecewise
linear in the quantity.  Each way through an element is parted evenly; within a part s is integrated by Gauss's rule and
c is its mean weighted by s (Max, Optical Models for Direct Volume Rendering, 1995, section 4).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.formats.arrays import Floats, Ints
from elvis.formats.patch import Patch
from elvis.formats.quadrature import gauss
from elvis.reference.quantities import Quantities
from elvis.reference.scenes.crossings import Crossings
from elvis.reference.scenes.faces import face_crossings
from elvis.reference.scenes.newton import inverses
from elvis.reference.solids import faces_of, margins_of, placed
from elvis.renderer.scene import Transfer
from elvis.renderer.view import View

#: parts of a way as long as the scene; how many parts a way through an element may have; Gauss points in each
ALONG, PARTS, POINTS = 256, (4, 8, 16, 32, 64, 128), 2
#: ways that are summed together
_AT_ONCE = 1 << 13
_STEPS = 12


@dataclass(frozen=True, eq=False)
class Ways:
    """Ways of rays through elements of one patch.

    pixel        (k,)    row by row from the top
    row          (k,)    of the elements
    near, far    (k,)    depths of both ends
    first, last  (k, …)  reference coordinates of both ends, or whatever else is linear between them
    """

    pixel: Ints
    row: Ints
    near: Floats
    far: Floats
    first: Floats
    last: Floats

    def between(self, cuts: Sequence[Floats]) -> Ways:
        """The ways, parted at depths (n,) by pixel."""
        made = self
        for cut in cuts:
            at = cut[made.pixel]
            crossed = np.flatnonzero((at > made.near) & (at < made.far))
            part = ((at - made.near) / (made.far - made.near))[crossed, None]
            middle = made.first[crossed] + part * (made.last - made.first)[crossed]
            far, last = made.far.copy(), made.last.copy()
            far[crossed], last[crossed] = at[crossed], middle
            beyond = Ways(
                made.pixel[crossed], made.row[crossed], at[crossed], made.far[crossed], middle, made.last[crossed]
            )
            shorter = {**vars(made), "far": far, "last": last}
            made = Ways(**{name: np.concatenate([shorter[name], own]) for name, own in vars(beyond).items()})
        return made


def ways_through(number: int, patch: Patch, view: View, size: float) -> Ways:
    """The ways of all rays through the elements of a patch: between neighbouring hits of faces, where inside."""
    hits = face_crossings(number, patch, np.ones((len(patch), len(faces_of(patch))), bool), view, size)
    hits = hits.part(np.lexsort([hits.depth, hits.row, hits.pixel]))
    pairs = np.flatnonzero((np.diff(hits.pixel) == 0) & (np.diff(hits.row) == 0))
    found = _paired(hits, pairs)
    middle = 0.5 * (found.near + found.far)
    reference = _followed(patch, found.row, 0.5 * (found.first + found.last), _points(view, found.pixel, middle))
    inside = margins_of(patch, reference) > -1e-9
    return Ways(**{name: column[inside] for name, column in vars(found).items()})


def _paired(hits: Crossings, pairs: Ints) -> Ways:
    after = pairs + 1
    ends = (hits.depth[pairs], hits.depth[after], hits.reference[pairs], hits.reference[after])
    return Ways(hits.pixel[pairs], hits.row[pairs], *ends)


def gathered(
    ways: Ways, patch: Patch, quantities: Quantities, name: str, transfer: Transfer, view: View, size: float
) -> tuple[Floats, Floats]:
    """Colours (k, 3) times alpha, and alphas (k,), of each way; ``size`` of the scene in world units."""
    colors, alphas = np.zeros((len(ways.pixel), 3)), np.zeros(len(ways.pixel))
    needed = np.ceil(ALONG * lengths(ways, view) / size)
    parts = np.array(PARTS)[np.searchsorted(PARTS, needed).clip(0, len(PARTS) - 1)]
    for count in PARTS:
        here = np.flatnonzero(parts == count)
        for chunk in np.array_split(here, -(-len(here) // _AT_ONCE)) if len(here) else ():
            some = Ways(**{key: column[chunk] for key, column in vars(ways).items()})
            colors[chunk], alphas[chunk] = _summed(some, patch, quantities, name, transfer, view, count)
    return colors, alphas


def points_along(parts: int) -> Floats:
    """(parts * POINTS,) Gauss points of equal parts of the unit interval."""
    return np.asarray(((np.arange(parts)[:, None] + (1 + gauss(POINTS)[0]) / 2) / parts).ravel())


def _summed(
    ways: Ways, patch: Patch, quantities: Quantities, name: str, transfer: Transfer, view: View, parts: int
) -> tuple[Floats, Floats]:
    """The sums over as many parts of some ways."""
    places = points_along(parts)
    depth = ways.near[:, None] + places * (ways.far - ways.near)[:, None]
    start = ways.first[:, None] + places[:, None] * (ways.last - ways.first)[:, None]
    rows, pixel = np.repeat(ways.row, len(places)), np.repeat(ways.pixel, len(places))
    reference = _followed(patch, rows, start.reshape(-1, 3), _points(view, pixel, depth.ravel()))
    values = quantities.values(name, patch, rows, reference).reshape(depth.shape)

    return integrated(values, lengths(ways, view), transfer)


def lengths(ways: Ways, view: View) -> Floats:
    """(k,) lengths of ways in world units."""
    row, column = np.divmod(ways.pixel, view.width)
    directions = view.rays(column.astype(np.float64), row.astype(np.float64))[1]
    return np.asarray(np.linalg.norm(directions, axis=1) * (ways.far - ways.near))


def integrated(values: Floats, length: Floats, transfer: Transfer) -> tuple[Floats, Floats]:
    """Colours (k, 3) times alpha, and alphas (k,), of ways of some length (k,).

    values  (k, parts * POINTS) of the quantity at Gauss points of equal parts; beyond the ends of the transfer function
            it stays as it is there, and what is no number sends out and takes up nothing
    """
    known = np.isfinite(values)
    density = np.where(known, np.interp(values, transfer.values, transfer.densities), 0.0)
    tables = np.asarray(transfer.colors, np.float64)
    color = np.stack([np.interp(values, transfer.values, tables[:, axis]) for axis in range(3)], axis=-1)
    color = np.where(known[..., None], color, 0.0)

    # optical depths of the parts, mean colours in them, what of them reaches the beginning
    parts, weights = values.shape[1] // POINTS, gauss(POINTS)[1]
    taken = (0.5 * length[:, None, None] / parts * weights) * density.reshape(-1, parts, POINTS)
    depths = taken.sum(axis=2)
    mean = np.einsum("kpg,kpgc->kpc", taken, color.reshape(-1, parts, POINTS, 3))
    mean /= np.where(depths > 0, depths, 1.0)[..., None]
    before = np.cumsum(depths, axis=1) - depths
    sent = np.exp(-before) * -np.expm1(-depths)
    return np.einsum("kp,kpc->kc", sent, mean), -np.expm1(-depths.sum(axis=1))


def _points(view: View, pixel: Ints, depth: Floats) -> Floats:
    """(k, 3) world points of rays at some depths."""
    row, column = np.divmod(pixel, view.width)
    origins, directions = view.rays(column.astype(np.float64), row.astype(np.float64))
    return np.asarray(origins + depth[:, None] * directions)


def _followed(patch: Patch, rows: Ints, start: Floats, points: Floats) -> Floats:
    """(n, 3) reference points of world points (n, 3) in elements (n,), from near ones, by Newton's method."""
    reference, active = start.copy(), np.arange(len(rows))
    for _ in range(_STEPS):
        world, slopes = placed(patch, rows[active], reference[active])
        with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
            step = np.einsum("nij,nj->ni", inverses(slopes), points[active] - world)
        length = np.linalg.norm(step, axis=1)
        good = np.isfinite(length)
        part = np.minimum(1.0, 0.5 / np.maximum(length, 1e-300))
        reference[active[good]] += part[good, None] * step[good]
        active = active[good & (length > 1e-9)]
        if not len(active):
            break
    return reference
