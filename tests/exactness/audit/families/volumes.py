"""Light of layers, thin or not, that a ray crosses in a domain: their optical depth is an integral of cubics.

The density is a hat over the values of u, which is quadratic along rays; colours are white, the background black.
"""

from functools import partial

import numpy as np

from audit.cases import ORDINARY, Case, camera, exact
from audit.families.isosurfaces import FORMS
from audit.truths import Rays, quadratic_roots
from audit.validating import counted_as
from audit.worlds import world
from elvis import Transfer, VolumeRendering

#: largest error of a colour that is requested
ERROR = 1e-3
WHITE = (1.0, 1.0, 1.0)


def case(rng, size):
    """One volume."""
    kind = str(rng.choice(["oblique", "perspective", "inside", "along"]))
    own = world(rng, placements=("plain", "off", "mirrored", "large", "small", "far"))
    form = str(rng.choice(list(FORMS)))
    field = FORMS[form]
    data, _, _ = exact(own, field, 3)
    view = camera(rng, own, kind)
    middle = float(rng.integers(1, 16)) / 16
    width = float(2.0 ** -rng.integers(1, 18))
    # an optical depth about 1 for a ray across a layer of unit slope
    scale = float(np.abs(own.scale).max())
    density = float(rng.choice([0.25, 1.0, 4.0])) / width / scale
    values, densities = (middle - width, middle, middle + width), (0.0, density, 0.0)
    look = VolumeRendering(Transfer(values, densities, (WHITE,) * 3), error=ERROR)
    scene = {"field": "u", "camera": view, "size": size, "objects": (look,), "background": (0.0, 0.0, 0.0)}
    name = f"{own.name}, {form} at {middle} within {width}, density {density}, {view}"
    ordinary = kind in ("oblique", "perspective") and own.name.split()[-1] in ORDINARY and width > 1e-2
    return Case(name, data, scene, partial(count, own, field, values, densities), ordinary)


def count(own, field, values, densities, case, frame):
    """The count of a picture of a layer."""
    rays = Rays(own, frame.view)
    weights = [float(field.terms.get(tuple(int(i == j) for j in range(3)), 0)) for i in range(3)]
    along = np.einsum("i,nij->nj", weights, rays.quadratics)
    depth = optical_depth(rays, along, values, densities)
    expected = -np.expm1(-depth.astype(float))
    found = frame.color.reshape(-1, 3)
    off = np.abs(found - expected[:, None]).max(axis=1)

    # a thin layer in coordinates that are rounded is somewhere else
    noise = float(np.abs(weights) @ rays.rounding) / (values[1] - values[0])
    wrong = rays.counted & (frame.status.reshape(-1) < 2) & ~(off <= ERROR + 8 * noise)

    def details(pixel):
        row, column = divmod(pixel, frame.view.width)
        return f"pixel ({column}, {row}): expected light {expected[pixel]:.9g}, found {found[pixel].max():.9g}"

    return counted_as(case, frame.status.reshape(-1), rays.counted, {"the wrong light": wrong}, details)


def optical_depth(rays, along, values, densities):
    """(n,) integral of the density along each ray in the unit cube; ``along`` (n, 3) is the field on it."""
    parts = [rays.quadratics[:, axis] - [side, 0, 0] for axis in range(3) for side in (0, 1)]
    parts += [along - [value, 0, 0] for value in values]
    stops = [np.zeros((len(along), 1)), *(quadratic_roots(q)[0] for q in parts)]
    last = np.where(rays.counted, rays.leave, 0.0)[:, None]
    stops = np.sort(np.clip(np.nan_to_num(np.concatenate([*stops, last], axis=1), nan=0.0), 0.0, last), axis=1)

    # between stops the density is quadratic or nothing, for which Simpson's rule is exact
    first, length = stops[:, :-1], np.diff(stops, axis=1)
    middle = rays.places(first + length / 2)
    slack = 1e-12 + rays.rounding
    inside = ((middle >= -slack) & (middle <= 1 + slack)).all(axis=2)
    total = np.zeros(first.shape, np.longdouble)
    for part, weight in ((0.0, 1), (0.5, 4), (1.0, 1)):
        t = first + part * length
        u = along[:, :1] + t * (along[:, 1:2] + t * along[:, 2:])
        hat = 1 - np.abs(u - values[1]) / (values[1] - values[0])
        total += weight * np.maximum(hat, 0) * densities[1]
    speed = np.sqrt((rays.ways**2).sum(axis=1))
    return (np.where(inside, total * length / 6, 0)).sum(axis=1) * speed
