"""Quantities: expressions over fields, coordinates, time and derivatives, and attributes of elements.

expression  the meaning of a text for a dataset: `Expression.of`
evaluator   its values at reference points of elements, and at world points
bounding    certified bounds on elements, and its range over all of them
"""

from __future__ import annotations

from elvis.core.quantities.expression import Expression
from elvis.core.quantities.names import Names

__all__ = ["Expression", "Names"]
