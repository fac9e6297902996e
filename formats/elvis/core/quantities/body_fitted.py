"""Components of vectors in the directions of a wall: FieldConvert's bodyFittedVelocity, at every point.

At each point, dir1 is the normal of the wall at the nearest point of the wall and points into the data, dir0 = dir1 x a
is tangential, with the assisting vector a (the z axis by default), and dir2 = dir0 x dir1.  (Nektar++,
ProcessBodyFittedVelocity; its names are used here too.)
"""

from __future__ import annotations

from collections.abc import Sequence

from elvis.core.base.errors import ElvisError
from elvis.core.quantities.tree import AXES, ZERO, Direction, Node, call, dot, number

#: components of the velocity in the directions 0, 1 and 2, and components of the directions
VELOCITIES = ("u_bfc", "v_bfc", "w_bfc")
DIRECTIONS = tuple(f"bfc_dir{k}_{axis}" for k in range(3) for axis in AXES)
#: the vector a
ASSIST = (0.0, 0.0, 1.0)


def body_fitted(name: str, target: str, assist: Sequence[float], dimension: int, velocity: Sequence[Node]) -> Node:
    """One of `VELOCITIES` and `DIRECTIONS` at a wall; raises ElvisError where the data have no such component.

    velocity  components, as many as there are dimensions; for directions it isn't used
    """
    which = VELOCITIES.index(name) if name in VELOCITIES else int(name[7])
    axis = 0 if name in VELOCITIES else AXES.index(name[-1])
    if dimension < 2 or max(which, axis) >= dimension:
        raise ElvisError(f"{name} needs {max(2, which + 1, axis + 1)} coordinates, and the data have {dimension}")
    if not any(assist) or (dimension == 2 and any(assist[:2])):
        raise ElvisError(f"{name}: expected a vector across the plane or, in 3D, any but zero")
    direction = _directions(target, assist, dimension)[which]
    if name in DIRECTIONS:
        return direction[axis]
    return dot(direction[:dimension], velocity)


def _directions(target: str, assist: Sequence[float], dimension: int) -> list[list[Node]]:
    """The three directions, each with three components."""
    normal = [Direction(target, axis, is_away=True).attribute if axis < dimension else ZERO for axis in range(3)]
    across = _cross(normal, list(map(number, assist)))
    length = call("sqrt", dot(across, across))
    tangent = [call("/", part, length) if part is not ZERO else ZERO for part in across]
    return [tangent, normal, _cross(tangent, normal)]


def _cross(a: Sequence[Node], b: Sequence[Node]) -> list[Node]:
    """The cross product of two vectors."""
    return [call("-", call("*", a[i], b[j]), call("*", a[j], b[i])) for i, j in ((1, 2), (2, 0), (0, 1))]
