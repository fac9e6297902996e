"""Compositions of quantities, as the Slang text with which kernels are linked (enclosures.slang)."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.plugins.runtime.volume import Enclosure, Part, Quantity


def enclosure_of(chosen: Part | Quantity) -> Enclosure | None:
    """The composition of a quantity that is not a polynomial, if its isosurfaces are proved; else None."""
    enclosure = chosen.enclosure
    return None if chosen.degree or enclosure is None or not enclosure.continuous else enclosure


def along_rays(part: Part, chosen: Part | Quantity) -> Enclosure | None:
    """The composition of a quantity along rays: polynomials are their own leaves; None if unknown."""
    if not chosen.degree:
        return chosen.enclosure
    type, rounding = f"Itself<{chosen.type}>", chosen.rounding

    def errors() -> Floats:
        """Errors of leaves: positions are as exact as rays; values have the rounding that plugins state."""
        values = np.zeros(len(part)) if rounding is None else rounding()
        return np.column_stack([np.zeros((len(part), 3)), values])

    degree, base = chosen.degree, chosen.base_degree
    return Enclosure(type, 1, degree, base, degree, False, errors, slopes=False)


def works_together(stage: str, chosen: Part | Quantity) -> bool:
    """Whether all lanes of a stage evaluate a quantity together.

    Distances are evaluated on some lanes only; so are quantities without proof where rays meet an isosurface.
    """
    if chosen.degree > 0:
        return True
    if chosen.enclosure is not None and chosen.enclosure.distances:
        return False
    return stage != "iso_draw" or enclosure_of(chosen) is not None


def leaves_along_rays(part: Part, chosen: Part | Quantity) -> str:
    """Slang text of a quantity's composition for stages of volumes."""
    enclosure = along_rays(part, chosen)
    if enclosure is None:
        return ""
    is_plain = str(chosen.degree > 0).lower()
    return (
        f"export static const bool bounded = true; export static const bool plain = {is_plain};"
        f"export static const bool leaf_slopes = {str(enclosure.slopes).lower()};{_leaf_constants(enclosure)}"
    )


def leaves(chosen: Part | Quantity) -> str:
    """Slang text of a quantity's composition if it is enclosed but not a polynomial."""
    enclosure = enclosure_of(chosen)
    return "" if enclosure is None else f"export static const bool analytic = true;{_leaf_constants(enclosure)}"


def _leaf_constants(enclosure: Enclosure) -> str:
    """Slang text that declares the leaves and their degrees."""
    return (
        f"import enclosures; export struct TheLeaves : ILeaves = {enclosure.type};"
        f"export static const int leaf_fields = {enclosure.fields};"
        f"export static const int leaf_degree = {enclosure.degree};"
        f"export static const int leaf_base_degree = {enclosure.base_degree or enclosure.degree};"
        f"export static const bool leaf_total = {str(enclosure.is_total).lower()};"
        f"export static const bool leaf_distances = {str(enclosure.distances).lower()};"
        f"export static const bool in_boxes = {str(enclosure.in_boxes).lower()};"
    )
