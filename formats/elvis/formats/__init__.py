"""The native format: the data model, its meaning, reading and writing.

from elvis.formats import read
dataset = read("wing.xml", "wing.fld")
"""

from elvis.formats.bases import Basis
from elvis.formats.dataset import Block, Dataset, Expansion, ExpansionRule, Field, Homogeneous
from elvis.formats.errors import ElvisError, FormatError
from elvis.formats.mesh import Composite, Curves, Entities, Mesh
from elvis.formats.reading import read
from elvis.formats.shapes import Shape

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
]
