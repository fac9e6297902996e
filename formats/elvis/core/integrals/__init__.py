"""Integrals over elements, boundaries and surfaces: exact for polynomials on curved elements, else with a stated error.

reference_cells  elements and their sides as pieces of reference elements: points, measures, constant factors
degrees          the degree of an integrand as a polynomial, with the map's derivatives
refinement       sums over the pieces: one exact rule, or else rules with bounded errors on bisected boxes
groups           boxes with the results of rules on them and their errors
eta_boxes        boxes in elements and their sides, with Gauss points
box_discs        ranges of expressions on complex neighbourhoods of boxes; analytic_error: bounds of rules from these
levels_of_elements  planes and isosurfaces in elements; level_boxes, graph_orders, graphs, subcells: rules on them
touching         surfaces so close to sides of elements that rounding decides between the elements
targets          the integration domain, from its name
integrands       integrands from their text: forces, fluxes, averages
line_targets     the curves among the domains
curves           lines, circles, splines, normals of walls; along_curves: rules on them, bisected at borders
boundary_layers  thicknesses of boundary layers along these
coefficients     of drag, lift and moment
integration      all of this in one call
"""

from __future__ import annotations

from elvis.core.base.lazy import lazy_names

TYPE_CHECKING = False
if TYPE_CHECKING:
    from elvis.core.integrals.integration import ERROR, Integral, Integrals, comes_apart, evaluated, integrate

__all__ = ["ERROR", "Integral", "Integrals", "comes_apart", "evaluated", "integrate"]

# drawing needs pieces of elements, not integration
__getattr__ = lazy_names(__name__, {"elvis.core.integrals.integration": tuple(__all__)})
