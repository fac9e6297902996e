"""Interfaces between elements whose sides don't match: hanging nodes, mortars, quadrilaterals next to triangles.

side_groups  sides of elements as polynomials, with normals that point into the element
feet         the point of a side that is nearest to a given point
hanging      sides without a partner that lie on sides of other elements
interface_composites  the composites that hold such sides, and the composites that a periodic mesh identifies
"""
