"""The native format: the data model, its meaning, reading and writing.

from elvis.formats import read
dataset = read("wing.xml", "wing.fld")

Names are imported from their modules when they are first used, so that importing one module stays cheap.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from elvis.core.dataset import Block, Dataset, Expansion, ExpansionRule, Field, Homogeneous
    from elvis.core.errors import ElvisError, FormatError
    from elvis.core.mesh import Composite, Curves, Entities, Mesh
    from elvis.core.polynomials.bases import Basis
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
    "read",
    "write",
]

_MODULES = {
    "elvis.core.dataset": ("Block", "Dataset", "Expansion", "ExpansionRule", "Field", "Homogeneous"),
    "elvis.core.errors": ("ElvisError", "FormatError"),
    "elvis.core.mesh": ("Composite", "Curves", "Entities", "Mesh"),
    "elvis.core.polynomials.bases": ("Basis",),
    "elvis.core.shapes": ("Shape",),
    "elvis.formats.reading": ("read",),
    "elvis.formats.writing": ("write",),
}


def __getattr__(name: str) -> object:
    for module, names in _MODULES.items():
        if name in names:
            return getattr(import_module(module), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
