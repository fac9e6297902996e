"""Light of volumes of expressions with kinks and jumps, along rays in the direction of x: their optical depth is 1.

A tent or a slab of half-width w about x = c; both are fields, so that few kernels are compiled.
"""

import numpy as np

from audit.cases import Case
from audit.validating import counted_as
from elvis import Camera, Transfer, VolumeRendering
from elvis.core.data.dataset import Dataset
from elvis.core.shapes import Shape
from elvis.core.testing import approximated, grid

#: largest error of a colour that is requested
ERROR = 1e-3
#: expressions of x, c and w; the values of the transfer function's ends, and its densities there, in parts of 1 / w
EXPRESSIONS = {
    "max(w-abs(x-c),0)": (lambda w: (0.0, w), (0.0, 1.0)),
    "w-abs(u-c)": (lambda w: (0.0, w), (0.0, 1.0)),
    "min(abs(u-c)/w,1)": (lambda w: (0.0, 1.0), (1.0, 0.0)),
    "sign(w-abs(x-c))": (lambda w: (-1.0, 1.0), (0.0, 0.5)),
}
WHITE = ((1.0, 1.0, 1.0),) * 2


def case(rng, size):
    """One volume."""
    solids = [shape for shape in Shape if shape.dimension == 3]
    shape, cells = solids[rng.integers(len(solids))], int(rng.choice([1, 2]))
    text = list(EXPRESSIONS)[rng.integers(len(EXPRESSIONS))]
    width = float(0.3 * 300.0 ** -rng.random())
    middle, modes = float(rng.uniform(width, 1.0 - width)), int(rng.integers(2, 10))
    mesh = Dataset(grid(shape, cells))
    parts = {"u": lambda p: p[:, 0], "c": lambda p: np.full(len(p), middle), "w": lambda p: np.full(len(p), width)}
    data = Dataset(mesh.mesh, tuple(approximated(mesh, name, part, modes) for name, part in parts.items()))
    values, densities = EXPRESSIONS[text]
    transfer = Transfer(values(width), tuple(density / width for density in densities), WHITE)
    eye = float(rng.choice([-3.0, 3.0]))
    view = Camera((eye, 0.5, 0.5), (0.5, 0.5, 0.5), height=0.9)
    scene = {"field": "u", "camera": view, "size": (size[1], size[1]), "background": (0.0, 0.0, 0.0)}
    scene["objects"] = (VolumeRendering(transfer, text, error=ERROR),)
    name = f"{shape.name.lower()}, {cells} cells each way, order {modes - 1}, {text}, c = {middle!r}, w = {width!r}"
    return Case(name, data, scene, count, ordinary=True)


def count(case, frame):
    """The count of a picture in which every pixel has the same light."""
    expected = -np.expm1(-1.0)
    found = frame.color.reshape(-1, 3)
    status = frame.status.reshape(-1)
    wrong = (status < 2) & ~(np.abs(found - expected).max(axis=1) <= ERROR)

    def details(pixel):
        return f"pixel {pixel}: expected light {expected:.9g}, found {found[pixel].max():.9g}"

    return counted_as(case, status, np.ones(len(status), bool), {"the wrong light": wrong}, details)
