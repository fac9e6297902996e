"""Files of solutions: ``dataset = read("wing.xml", "wing.fld")``; what they hold, and what one asks of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

from elvis.core.lazy import lazy_names

if TYPE_CHECKING:
    from elvis.core.dataset import Block, Dataset, Expansion, ExpansionRule, Field, Homogeneous
    from elvis.core.errors import ElvisError, FormatError
    from elvis.core.mesh import Composite, Curves, Entities, Mesh
    from elvis.core.norms import norms
    from elvis.core.polynomials.bases import Basis
    from elvis.core.queries import points_on_line
    from elvis.core.sampling import sample
    from elvis.core.shapes import Shape
    from elvis.formats.reading import read
    from elvis.formats.writing import write

__all__ = [
    "Basis",
    "Block",
    "Composite",
    "Curves",
    "Dataset",
    "ElvisError",
    "Entities",
    "Expansion",
    "ExpansionRule",
    "Field",
    "FormatError",
    "Homogeneous",
    "Mesh",
    "Shape",
    "norms",
    "points_on_line",
    "read",
    "sample",
    "write",
]

__getattr__ = lazy_names(
    __name__,
    {
        "elvis.core.dataset": ("Block", "Dataset", "Expansion", "ExpansionRule", "Field", "Homogeneous"),
        "elvis.core.errors": ("ElvisError", "FormatError"),
        "elvis.core.mesh": ("Composite", "Curves", "Entities", "Mesh"),
        "elvis.core.norms": ("norms",),
        "elvis.core.polynomials.bases": ("Basis",),
        "elvis.core.queries": ("points_on_line",),
        "elvis.core.sampling": ("sample",),
        "elvis.core.shapes": ("Shape",),
        "elvis.formats.reading": ("read",),
        "elvis.formats.writing": ("write",),
    },
)
