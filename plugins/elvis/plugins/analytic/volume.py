"""The elements of a native mesh with a field in closed form."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from elvis.formats.arrays import Floats, Ints
from elvis.formats.dataset import Block, Dataset, Field
from elvis.formats.geometry import geometry
from elvis.plugins.analytic.expression import Expression
from elvis.plugins.native import NativeVolume
from elvis.plugins.volume import Part, Solution

_SOURCE = """import formula; import elementary;
struct Given : IFormula
{{
    static double at(double3 p) {{ return {0}; }}
    static double3 slope(double3 p) {{ return double3({1}, {2}, {3}); }}
}}
"""


@dataclass(frozen=True, eq=False)
class AnalyticVolume:
    """A Volume: native elements, a field that is a formula of the place."""

    dimension: int
    parts: Sequence[Part]
    shader_folder: Path

    #: the expression that a text says
    parse = staticmethod(Expression.parse)

    @staticmethod
    def carrier(dataset: Dataset) -> Dataset:
        """The mesh with one field, its own coordinate ``x``; maps that travel as fields stay where they are."""
        blocks = tuple(Block(own.expansion, own.element_ids, own.coefficients[:, 0]) for own in geometry(dataset))
        maps = tuple(field for field in dataset.fields if field.name.startswith("map_"))
        return replace(dataset, fields=(*maps, Field("x", blocks)))

    @staticmethod
    def of(dataset: Dataset, expression: str) -> AnalyticVolume:
        """All elements of a dataset's mesh with the field that an expression of x, y and z says.

        Raises ElvisError for what is no expression, and for meshes without pictures (see NativeVolume).
        """
        function = Expression.parse(expression)
        native = NativeVolume.of(AnalyticVolume.carrier(dataset), "x")
        parts = [expressed(part, function) for part in native.parts]
        return AnalyticVolume(native.dimension, parts, native.shader_folder)


def expressed(part: Part, function: Expression) -> Part:
    """The elements of a part with a field in closed form."""
    source = _SOURCE.format(function.slang(), *(function.derivative(c).slang() for c in "xyz"))
    return replace(part, type=f"Expressed<{part.type}, Given>", source=source, solve=_solver(part, function))


def _solver(part: Part, function: Expression) -> Callable[[Ints, Floats], Solution] | None:
    """The part's own last resort, with the function for the field."""
    solve = part.solve
    if solve is None:
        return None

    def answer(elements: Ints, points: Floats) -> Solution:
        return replace(solve(elements, points), field=function(points))

    return answer
