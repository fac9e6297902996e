"""Maps of single elements."""

from elvis import Dataset
from elvis.core.mapping.geometry import geometry


def by_element(mesh):
    """Element id -> (expansion, (3, m) coefficients)."""
    blocks = geometry(Dataset(mesh))
    return {int(id): (b.expansion, c) for b in blocks for id, c in zip(b.element_ids, b.coefficients, strict=True)}
