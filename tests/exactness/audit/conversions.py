"""Random functions of objects in memory: the true error of the converted field against the one that is stated.

NGSolve's own evaluation at random points of all elements is the truth.  Functions are waves, fronts, bumps, kinks and
grid functions of several spaces, on straight and curved meshes, at orders that may or may not hold them.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from elvis import from_ngsolve, sample
from elvis.core.data.conversion_errors import ConversionErrors

#: points in each element
COUNT = 10
#: condition numbers of the map above which rounding of a place in the world counts: those of nearly folded elements
CONDITION = 100.0


@cache
def mesh_of(kind):
    import ngsolve
    from netgen.csg import CSGeometry, OrthoBrick, Pnt, Sphere
    from netgen.geom2d import SplineGeometry, unit_square

    if kind == "square":
        return ngsolve.Mesh(unit_square.GenerateMesh(maxh=0.6))
    if kind == "disk":
        geometry = SplineGeometry()
        geometry.AddCircle((0.5, 0.5), 0.5, bc="circle")
    else:
        geometry = CSGeometry()
        cube, sphere = OrthoBrick(Pnt(0, 0, 0), Pnt(1, 1, 1)).bc("box"), Sphere(Pnt(0.5, 0.5, 0.5), 0.5).bc("ball")
        geometry.Add(cube if kind == "cube" else sphere)
    mesh = ngsolve.Mesh(geometry.GenerateMesh(maxh=0.7 if kind == "disk" else 1.0))
    if kind in ("disk", "ball"):
        mesh.Curve(3)
    return mesh


def function_of(rng, mesh):
    """A function, the order to request, and a text."""
    import ngsolve as ng

    order, c = int(rng.integers(1, 5)), float(rng.uniform(0.2, 0.8))
    a, b = rng.uniform(1, 9, 2).tolist()
    w = float(np.exp(rng.uniform(np.log(0.1), 0)))
    kind = str(rng.choice(["wave", "front", "bump", "kink", "root", "H1", "L2", "HDiv", "HCurl", "gradient"]))
    made = {
        "wave": lambda: ng.sin(a * ng.x) * ng.cos(b * ng.y),
        "front": lambda: ng.atan((ng.x + ng.y - 2 * c) / w),
        "bump": lambda: ng.exp(-(((ng.x - c) / w) ** 2)),
        "kink": lambda: ng.IfPos(ng.x - c, ng.x - c, c - ng.x),
        "root": lambda: ng.sqrt(ng.x + ng.y + w),
    }
    if kind in made:
        return made[kind](), order, f"{kind} {a} {b} {c} {w} order {order}"
    name, lowest = ("H1", 2) if kind == "gradient" else (kind, 0 if kind == "L2" else 1)
    field = ng.GridFunction(getattr(ng, name)(mesh, order=max(lowest, min(order, 3))))
    field.vec.FV().NumPy()[:] = rng.uniform(-1, 1, len(field.vec))
    function = ng.grad(field) if kind == "gradient" else field
    return function, order if kind == "gradient" else None, f"{kind} order {order}"


def refutation(seed):
    """A sentence if the stated error of a case is less than the true one; None else."""
    import ngsolve as ng

    rng = np.random.default_rng([9, seed])
    kind = str(rng.choice(["square", "disk", "cube", "ball"]))
    mesh = mesh_of(kind)
    function, order, text = function_of(rng, mesh)
    dataset = from_ngsolve(mesh, u=function, order=order)
    points = rng.dirichlet([1] * (mesh.dim + 1), COUNT)[:, : mesh.dim]
    rule = ng.IntegrationRule([tuple(point) for point in points], [1] * COUNT)
    element = ng.ET.TRIG if mesh.dim == 2 else ng.ET.TET
    mapped = mesh.MapToAllElements({element: rule}, ng.VOL)
    places = np.asarray(ng.CoefficientFunction((ng.x, ng.y, ng.z)[: mesh.dim])(mapped))
    wanted = np.asarray(function(mapped)).reshape(len(places), -1)
    jacobians = np.asarray(ng.specialcf.JacobianMatrix(mesh.dim)(mapped)).reshape(-1, mesh.dim, mesh.dim)
    sound = np.linalg.cond(jacobians) < CONDITION
    places, wanted = places[sound], wanted[sound]
    errors = ConversionErrors.of(dataset.metadata).fields
    for column, name in enumerate(dataset):
        values = sample(dataset, name, places).values[:, 0]
        off = np.nanmax(np.abs(values - wanted[:, column]))
        stated = errors[name].value if name in errors else 1e-11 * max(1.0, float(np.abs(wanted).max()))
        if off > stated:
            return f"{text} on {kind} (case {seed}), {name}: off by {off:.3g}, stated {stated:.3g}"
    return None
