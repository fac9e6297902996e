"""Integrals over elements, boundaries and surfaces: exact for polynomials on curved elements, else with a stated error.

reference_cells  elements and their sides as pieces of reference elements: points, measures, what is constant on them
degrees          of what polynomial an integrand is, with the map's derivatives
refinement       sums over the pieces: one rule where that is exact, else rules with bounded errors, and halved boxes
groups           boxes with what rules say on them, and by how much that may be off
eta_boxes        boxes in elements and their sides, with Gauss points
box_discs        what expressions attain on complex neighbourhoods of boxes; analytic_error: bounds of rules from it
levels_of_elements  planes and isosurfaces in elements; level_boxes, graph_orders, graphs, subcells: rules on them
touching         where surfaces lie so near sides of elements that rounding decides between these
targets          what is integrated over, from its name
integrands       what is integrated, from its text: forces, fluxes, averages
line_targets     the curves among these names
curves           lines, circles, splines, normals of walls; along_curves: rules on them, halved at borders
boundary_layers  thicknesses of layers along these
coefficients     of drag, lift and moment
integration      all of it in one call
"""

from __future__ import annotations

from elvis.core.lazy import lazy_names

TYPE_CHECKING = False
if TYPE_CHECKING:
    from elvis.core.integrals.integration import ERROR, Integral, Integrals, comes_apart, evaluated, integrate

__all__ = ["ERROR", "Integral", "Integrals", "comes_apart", "evaluated", "integrate"]

# what draws needs pieces of elements, not what integrates over them
__getattr__ = lazy_names(__name__, {"elvis.core.integrals.integration": tuple(__all__)})
