"""Integrands from text: expressions, and words that represent one or several of them.

area, volume, length  1, on domains with such a measure; in 2D data, faces and volumes have unit span
displacement_thickness(u), momentum_thickness(u)  thicknesses of a boundary layer, along a curve that leads out of it
average(f)            the integral of f divided by the integral of 1
force, moment, …      the components of the predefined quantities of these names (`elvis.core.quantities.predefined`)
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.integrals.targets import Part
from elvis.core.quantities.elements.sides import SIDES
from elvis.core.quantities.evaluator import Sampler
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.names import Names
from elvis.core.quantities.tree import call, number

#: dimensions of domains with these measures, and of domains that have them per unit span in 2D data
_MEASURES: Mapping[str, tuple[int, int]] = {"length": (1, -1), "area": (2, 1), "volume": (3, 2)}
#: vectors among the predefined quantities
VECTORS = ("force", "pressure_force", "viscous_force", "moment")
_VECTOR = re.compile(rf"\s*({'|'.join(VECTORS)})\s*(\(.*\))?\s*", re.S)
_AVERAGE = re.compile(r"\s*average\s*\((.*)\)\s*", re.S)
#: thicknesses of a boundary layer by the speed u and that at its end, U (Schlichting, Boundary-Layer Theory)
_THICKNESS = re.compile(r"\s*(displacement|momentum)_thickness\s*\((.*)\)\s*", re.S)


@dataclass(frozen=True, eq=False)
class Integrand:
    """A requested integral.

    text        as it was written, or the component of a vector
    is_average  whether it is to be divided by the measure
    is_load     whether it is a force or a moment, which a section has per unit of span
    """

    text: str
    expression: Expression
    is_average: bool = False
    is_load: bool = False

    def check(self, over: str, pieces: Sequence[Part]) -> None:
        """Raise ElvisError if it means nothing on pieces: a volume of a surface, a normal inside of elements."""
        for piece in pieces:
            in_plane = piece.patch.dimension == 2 and piece.patch.is_flat
            self.check_on(over, piece.dimension, in_plane, piece.has_normals)

    def check_on(self, over: str, dimension: int, in_plane: bool, has_normals: bool) -> None:
        """Check the integrand on a domain of a dimension.

        ``in_plane``: the data are 2D, so measures per unit span also apply.
        """
        needed = sorted(set(SIDES) & set(self.expression.attributes))
        if needed and not has_normals:
            raise ElvisError(
                f"{self.text}: {needed[0]} is only known on boundaries and cuts, not on {over}; name one with --over"
            )
        if self.text in _MEASURES:
            own, by_span = _MEASURES[self.text]
            if dimension != own and not (in_plane and dimension == by_span):
                raise ElvisError(f"{over} has {_OF_DIMENSION[dimension]}, no {self.text}")


_OF_DIMENSION = {1: "a length", 2: "an area", 3: "a volume"}


def integrands(dataset: Dataset, texts: Sequence[str], end: Floats | None = None) -> list[Integrand]:
    """The integrands of some texts, with components of vectors separate; raises ElvisError for an invalid text.

    end  (3,) end of the curve of integration, None unless the domain is a single curve
    """
    names = Names.of(dataset)
    layers = [_THICKNESS.fullmatch(text) for text in texts]
    return [
        found
        for text, layer in zip(texts, layers, strict=True)
        for found in (_integrands(text, names) if layer is None else [_thickness(dataset, text, layer, end)])
    ]


def integrands_of(names: Names, texts: Sequence[str]) -> list[Integrand]:
    """The integrands of texts other than layer thicknesses, for data with known names."""
    return [found for text in texts for found in _integrands(text, names)]


def _thickness(dataset: Dataset, text: str, layer: re.Match[str], end: Floats | None) -> Integrand:
    """1 - u/U, or u/U (1 - u/U), with U the speed at the end of a curve."""
    if end is None:
        raise ElvisError(f"{text}: expected one curve, such as --over normal:wall:0.5,0.1:0.2")
    speed = Expression.of(dataset, layer[2])
    outer = float(Sampler(dataset, [speed]).sample(end[None]).values[0, 0])
    if not abs(outer) > 0:
        where = ", ".join(f"{x:.6g}" for x in end)
        raise ElvisError(f"{text}: expected a speed at the end of the curve, {where}, found {outer:g}")
    part = call("/", speed.root, number(outer))
    deficit = call("-", number(1.0), part)
    return Integrand(text, Expression(text, deficit if layer[1] == "displacement" else call("*", part, deficit)))


def _integrands(text: str, names: Names) -> Iterator[Integrand]:
    vector, average = _VECTOR.fullmatch(text), _AVERAGE.fullmatch(text)
    if text in names.fields:
        yield Integrand(text, Expression.parse(text, names))
    elif text in _MEASURES:
        yield Integrand(text, Expression.parse("1", names))
    elif vector is not None and vector[1] not in names.fields:
        for component in _components(vector[1], names):
            own = component + (vector[2] or "")
            yield Integrand(own, Expression.parse(own, names), is_load=True)
    elif average is not None and "average" not in names.fields:
        yield Integrand(text, Expression.parse(average[1], names), is_average=True)
    else:
        yield Integrand(text, Expression.parse(text, names))


def _components(name: str, names: Names) -> list[str]:
    """The components of a vector in flows of a dimension; in a plane, a moment has only the z component."""
    axes = "xyz"[: names.dimension] if name != "moment" else {2: "z", 3: "xyz"}.get(names.dimension, "x")
    return [f"{name}_{axis}" for axis in axes]
