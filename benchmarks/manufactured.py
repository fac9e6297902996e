"""Twelve fields in closed form, their approximations on meshes, and true errors: smooth, layer, shock and corner.

A plane field is a function g(t) of t = d . x.  The length of an element is the unit of t, so that a layer is as well
resolved on each mesh.  A radial field is a function of the distance to a vertex of the mesh.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from elvis import Dataset
from elvis.core.base.arrays import Floats
from elvis.core.data.dataset import Block, Field
from elvis.core.mapping import tangents
from elvis.core.mapping.geometry import GeometryBlock, geometry
from elvis.core.mapping.projections import best, rule
from elvis.core.numbers.norms import stretch_factors
from elvis.core.polynomials.cubature import COLLAPSE
from elvis.core.polynomials.evaluation import evaluate, evaluate_with_gradients
from elvis.core.polynomials.interpolation import modified

#: points in each direction beyond those for polynomials, for projections and for true errors, by dimension
EXTRA = {1: 30, 2: 12, 3: 5}
#: elements that are processed together
TOGETHER = 256
#: place of layers and shocks, in lengths of an element from the middle of the domain
PLACE = 0.37

Function = Callable[[Floats], Floats]


@dataclass(frozen=True)
class Profile:
    """A function of one variable t, in lengths of an element.

    value, slope  g and its derivative
    exponent      of a radial field r^exponent; None for plane fields
    """

    name: str
    kind: str
    value: Function
    slope: Function
    exponent: float | None = None


def _power(name: str, exponent: float) -> Profile:
    """A corner r^exponent."""
    tiny = 1e-300
    return Profile(
        name,
        "corner",
        lambda t: np.maximum(t, 0.0) ** exponent,
        lambda t: exponent * np.maximum(t, tiny) ** (exponent - 1),
        exponent,
    )


PROFILES = (
    Profile("exponential", "smooth", lambda t: np.exp(0.75 * t), lambda t: 0.75 * np.exp(0.75 * t)),
    Profile("wave", "smooth", lambda t: np.sin(t + 0.3), lambda t: np.cos(t + 0.3)),
    Profile("pole", "smooth", lambda t: 1 / (1 + t**2 / 4), lambda t: -t / 2 / (1 + t**2 / 4) ** 2),
    Profile("tanh", "layer", lambda t: np.tanh(t / 0.6), lambda t: 1 / np.cosh(np.clip(t, -90, 90) / 0.6) ** 2 / 0.6),
    Profile("arctan", "layer", lambda t: np.arctan(t / 0.6), lambda t: 1 / (1 + (t / 0.6) ** 2) / 0.6),
    Profile("error function", "layer", lambda t: _error_function(t / 0.6), lambda t: _bell(t / 0.6) / 0.6),
    Profile("jump", "shock", np.sign, np.zeros_like),
    Profile("kink", "shock", np.abs, np.sign),
    Profile("bend", "shock", lambda t: t * np.abs(t), lambda t: 2 * np.abs(t)),
    _power("reentrant", 2 / 3),
    _power("crack", 0.5),
    _power("root", 1.5),
)


def _error_function(t: Floats) -> Floats:
    from scipy.special import erf

    return np.asarray(erf(t))


def _bell(t: Floats) -> Floats:
    return np.asarray(2 / np.sqrt(np.pi) * np.exp(-(t**2)))


@dataclass(frozen=True)
class Manufactured:
    """A profile in space.

    value   (n,) of points (n, 3)
    slopes  (n, 3) gradients
    """

    profile: Profile
    value: Function
    slopes: Function

    @property
    def name(self) -> str:
        """The name of the profile."""
        return self.profile.name


def plane(profile: Profile, direction: Floats, cells: int, place: float = PLACE) -> Manufactured:
    """The profile along a direction, with t = 0 near the middle of the unit cube."""
    unit = direction / np.linalg.norm(direction)
    middle = 0.5 * np.abs(unit).sum() + place / cells

    def place_of(points: Floats) -> Floats:
        return cells * (points @ unit - middle)

    return Manufactured(
        profile,
        lambda points: profile.value(place_of(points)),
        lambda points: cells * profile.slope(place_of(points))[:, None] * unit,
    )


def radial(profile: Profile, dimension: int, cells: int) -> Manufactured:
    """The profile of the distance to the origin, in space to the z axis."""
    used = np.arange(3) < min(dimension, 2)

    def away(points: Floats) -> Floats:
        return cells * np.linalg.norm(points * used, axis=1)

    def slopes(points: Floats) -> Floats:
        distance = np.maximum(away(points), 1e-300)
        return cells**2 * (profile.slope(distance) / distance)[:, None] * points * used

    return Manufactured(profile, lambda points: profile.value(away(points)), slopes)


def twelve(dimension: int, cells: int) -> list[Manufactured]:
    """The twelve fields on a grid of the unit cube, with plane ones oblique to the axes."""
    direction = np.array([1.0, 0.6, 0.35]) * (np.arange(3) < dimension)
    return [plane(own, direction, cells) if own.exponent is None else radial(own, dimension, cells) for own in PROFILES]


def approximated(dataset: Dataset, value: Function, order: int, extra: int | None = None) -> Dataset:
    """The dataset with the best approximation u of a function on each element.

    extra  points in each direction beyond those for polynomials
    """
    blocks = []
    for own in geometry(dataset):
        expansion = modified(own.expansion.shape, (order + 1,) * own.expansion.shape.dimension)
        operator = best(expansion, extra or EXTRA[expansion.shape.dimension])
        parts = []
        for part in _batches(own):
            places = np.swapaxes(evaluate(own.expansion, own.coefficients[part], operator.points), 1, 2)
            parts.append(value(places.reshape(-1, 3)).reshape(places.shape[:2]) @ operator.matrix)
        blocks.append(Block(expansion, own.element_ids, np.concatenate(parts)))
    return Dataset(dataset.mesh, (Field("u", tuple(blocks)),))


def true_errors(dataset: Dataset, made: Manufactured, order: int) -> tuple[Floats, Floats]:
    """(n,) L2 norms of u - f and of its gradient on the elements of the only block."""
    (own,), (block,) = geometry(dataset), dataset.field("u").blocks
    shape = own.expansion.shape
    points, weights = rule(shape, order + 1 + EXTRA[shape.dimension])
    weights = weights * 0.5 ** sum(COLLAPSE[shape])
    errors, slopes = [], []
    for part in _batches(own):
        world, jacobians = evaluate_with_gradients(own.expansion, own.coefficients[part], points)
        places = np.swapaxes(world, 1, 2).reshape(-1, 3)
        measure = weights * stretch_factors(jacobians)
        found, reference = evaluate_with_gradients(block.expansion, block.coefficients[part], points)
        duals = tangents.duals(np.swapaxes(jacobians, 1, 2).reshape(-1, 3, shape.dimension))
        gradients = (duals * reference.reshape(-1, 1, shape.dimension)).sum(axis=2)
        squares = (found - made.value(places).reshape(found.shape)) ** 2
        errors.append(np.sqrt((squares * measure).sum(axis=1)))
        squares = ((gradients - made.slopes(places)) ** 2).sum(axis=1).reshape(found.shape)
        slopes.append(np.sqrt((squares * measure).sum(axis=1)))
    return np.concatenate(errors), np.concatenate(slopes)


def _batches(own: GeometryBlock) -> list[slice]:
    """Elements that are processed together."""
    return [slice(start, start + TOGETHER) for start in range(0, len(own), TOGETHER)]
