"""Integrals over data that a runtime plugin opens, by the plugin's own kernels and rules that are refined.

Only values of the functions are known, so rules with more and more points are tried, the same in all elements, until
two of them agree; twice the last difference is the error.  On the faces of elements the tangents are the columns of the
map's Jacobian along the face, and the area per unit of its coordinates is the length of their cross product.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from elvis.core.base.arrays import EPS, Floats, Ints
from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps
from elvis.core.base.rounded_up import rounded_up
from elvis.core.base.terminal import Progress
from elvis.core.integrals import Integral, Integrals
from elvis.core.integrals.integrands import Integrand
from elvis.core.polynomials.cubature import Cubature, field_cubature
from elvis.core.polynomials.interpolation import modified
from elvis.core.quantities.functions import function
from elvis.core.quantities.tree import Node, fold
from elvis.plugins.faces import Faces, faces_of
from elvis.plugins.runtime.volume import Part, Volume
from elvis.plugins.runtime.volume_checks import Samples

#: modes of rules that are tried in turn, and the most points of a rule
_MODES, _MOST = (4, 6, 8, 12, 16, 24, 32, 48, 64, 96), 1 << 22
_DOMAIN, _ALL, _NORMALS = "domain", "all", ("nx", "ny", "nz")
#: safety factor on the difference of two rules, and rounding relative to the sum of magnitudes
_SAFETY, _ROUNDING = 2.0, 64 * EPS


class Sample(Protocol):
    """Samples in a part's elements (n,) at reference points (n, 3), of a quantity or of the part's own field."""

    def __call__(self, number: int, elements: Ints, reference: Floats, *, quantity: str | None) -> Samples:
        """Samples at some points."""


@dataclass(frozen=True, eq=False)
class _Points:
    """Points of a rule in elements of a part, with shares (n,) of the measure, and unit normals (n, 3) on faces."""

    part: int
    elements: Ints
    reference: Floats
    shares: Floats
    positions: Floats
    normals: Floats | None = None


@dataclass(frozen=True, eq=False)
class PluginIntegration:
    """Integrals over a plugin's volume.

    rule    of a part, for functions with a number of modes
    """

    volume: Volume
    sample: Sample
    rule: Callable[[Part, int], Cubature]

    def over(
        self, wanted: Sequence[Integrand], over: Sequence[str], error: float, progress: Progress | None = None
    ) -> Integrals:
        """The rows of a table, target by target; ElvisError for targets that these data don't have."""
        rows, remarks = [], list[str]()
        for done, name in enumerate(over):
            choose = self._chooser(name)
            is_side, d = name != _DOMAIN, self.volume.dimension
            for each in wanted:
                each.check_on(name, d - is_side, in_plane=d == 2, has_normals=is_side)
            found = self._converged(wanted, choose, error)
            for each, (value, off, magnitude, measure) in zip(wanted, found.T, strict=True):
                if off > 2 * error * magnitude:
                    share = rounded_up(off / magnitude)
                    remarks.append(f"{each.text} over {name} is known to {share} of its size only")
                if each.is_average:
                    value, off = value / measure, off / measure
                rows.append(Integral(name, each.text, float(value), float(off), float(measure), False))
            if progress is not None:
                progress(done + 1, len(over))
        return Integrals(rows, remarks)

    def _sampled(self, number: int, elements: Ints, reference: Floats, quantity: str | None = None) -> Samples:
        return self.sample(number, elements, reference, quantity=quantity)

    def _chooser(self, name: str) -> Callable[[int], Iterator[_Points]]:
        """Function that gives the points of a target for a number of modes."""
        if name == _DOMAIN:
            return self._inside
        faces = faces_of(None, self.volume) if self.volume.dimension == 3 else None
        known = [_DOMAIN, *((_ALL, *faces.boundaries) if faces is not None else ())]
        if faces is None or name not in known:
            raise ElvisError(
                f"there is no {name!r} in a plugin's data{perhaps(name, known)}; there are {', '.join(known)}"
            )
        chosen = faces.select([name])
        return lambda modes: self._on_faces(faces, chosen, modes)

    def _inside(self, modes: int) -> Iterator[_Points]:
        """Points of the rule in all elements."""
        for number, part in enumerate(self.volume.parts):
            rule = self.rule(part, modes)
            elements = np.repeat(np.arange(len(part)), len(rule.points))
            reference = np.tile(rule.points, (len(part), 1))
            place = self._sampled(number, elements, reference)
            shares = np.tile(rule.weights, len(part)) * np.abs(np.linalg.det(place.jacobian))
            yield _Points(number, elements, reference, shares, place.position)

    def _on_faces(self, faces: Faces, chosen: Sequence[Ints], modes: int) -> Iterator[_Points]:
        """Points on faces, whose rows are chosen by block."""
        for block, rows in zip(faces.blocks, chosen, strict=True):
            if not len(rows):
                continue
            rule = field_cubature(modified(block.space.shape, (modes, modes)))
            frames = np.repeat(block.frames[block.local[rows]], len(rule.points), axis=0)
            steps = np.tile(rule.points, (len(rows), 1))
            elements = np.repeat(block.element[rows], len(rule.points))
            reference = frames[:, 0] + np.einsum("nk,nkd->nd", steps, frames[:, 1:])
            place = self._sampled(block.part, elements, reference)

            # the normal is the gradient of the reference coordinate that grows out of the element
            across = np.cross(frames[:, 1], frames[:, 2])
            outwards = np.sign(np.einsum("nd,nd->n", across, reference - place.center))[:, None] * across
            normals = np.linalg.solve(place.jacobian.transpose(0, 2, 1), outwards[:, :, None])[:, :, 0]
            along = np.einsum("ncd,nkd->nkc", place.jacobian, frames[:, 1:])
            areas = np.linalg.norm(np.cross(along[:, 0], along[:, 1]), axis=1)
            shares = np.tile(rule.weights, len(rows)) * areas
            units = normals / np.linalg.norm(normals, axis=1, keepdims=True)
            yield _Points(block.part, elements, reference, shares, place.position, units)

    def _converged(
        self, wanted: Sequence[Integrand], choose: Callable[[int], Iterator[_Points]], error: float
    ) -> Floats:
        """(4, k) values, errors, integrals of magnitudes and measures, by the first rule that agrees with the last."""
        before, off = np.full((3, len(wanted)), np.nan), np.full(len(wanted), np.inf)
        for modes in _MODES:
            points = list(choose(modes))
            now = np.sum([self._sums(wanted, own) for own in points], axis=0)
            off = _SAFETY * np.abs(now[0] - before[0])
            before = now
            enough = (off <= error * now[1]).all()
            if enough or sum(len(own.elements) for own in points) * 4 > _MOST:
                break
        off = np.where(np.isnan(off), np.inf, off)
        return np.stack([before[0], off + _ROUNDING * before[1], before[1], before[2]])

    def _sums(self, wanted: Sequence[Integrand], points: _Points) -> Floats:
        """(3, k) integrals of values, of their magnitudes and of 1."""
        terms = np.stack([self._values(each, points) * points.shares for each in wanted])
        measure = np.full(len(wanted), points.shares.sum())
        return np.stack([terms.sum(axis=1), np.abs(terms).sum(axis=1), measure])

    def _values(self, integrand: Integrand, points: _Points) -> Floats:
        """(n,) an integrand at points: as the kernels say, but for normals, which they don't know."""
        expression = integrand.expression
        if points.normals is None or not set(_NORMALS) & set(expression.attributes):
            return np.broadcast_to(self._leaf(expression.root, points, expression.text), len(points.elements))
        with np.errstate(all="ignore"):
            found = fold(
                expression.root,
                lambda leaf: self._leaf(leaf, points, leaf.name),
                lambda node, parts: function(node).numpy(*parts),
            )
        return np.broadcast_to(found, len(points.elements))

    def _leaf(self, node: Node, points: _Points, text: str) -> Floats | float:
        if node.op == "number":
            return node.value
        if node.op == "coordinate":
            return points.positions[:, node.axes[0]]
        if node.op == "attribute" and node.name in _NORMALS and points.normals is not None:
            return points.normals[:, _NORMALS.index(node.name)]
        if node.op == "field" and node.axes and text == node.name:
            raise ElvisError("expected normals times values, without derivatives, of what a plugin opens")
        name = text if text in self.volume.parts[points.part].quantities else None
        return self._sampled(points.part, points.elements, points.reference, name).value
