"""Zeros of d polynomials at once, as tensor Bernstein nets (k, d, D, …) on each of k boxes [0, 1]^d."""

from __future__ import annotations

import numpy as np

from elvis.core.base.arrays import Bools, Floats
from elvis.core.polynomials.bernstein import line_tables

#: tolerance for a zero on a side
_ZERO = 1e-11
#: steps of Newton's method, the last one's length, and how far beyond a box its zero may seem to be
_STEPS, _SHORT, BEYOND = 12, 1e-13, 1e-9


def divided(nets: Floats) -> Floats:
    """Nets (…, degree + 1) of polynomials, zero at the start of the last axis, divided by t, in the old degree."""
    degree = nets.shape[-1] - 1
    order = np.arange(1, degree + 1)
    return _raised(nets[..., 1:] * (degree / order))


def _raised(nets: Floats) -> Floats:
    """Nets of a degree raised by one in the last axis."""
    degree = nets.shape[-1]
    part = np.arange(degree + 1) / degree
    before = np.concatenate([nets[..., :1], nets], axis=-1)
    after = np.concatenate([nets, nets[..., -1:]], axis=-1)
    return np.asarray(part * before + (1 - part) * after)


def without_walls(nets: Floats, sizes: Floats) -> tuple[Floats, Bools]:
    """Nets of vectors divided by the heights over sides of boxes where these are zero, as on walls.

    The vectors and their products with the gradient keep their directions.

    sizes  (k,) largest coefficients, to which zeros are relative

    Returns the nets, and (k, d, 2) whether all components are zero on the lower and upper side along each axis.
    """
    d = nets.ndim - 2
    nets, on_side = nets.copy(), np.zeros((len(nets), d, 2), bool)
    for axis in range(d):
        for end in (0, 1):
            moved = np.moveaxis(nets, 2 + axis, -1)
            moved = moved[..., ::-1] if end else moved
            rest = np.abs(moved[..., 0]).max(axis=tuple(range(1, d + 1)), initial=0.0) <= _ZERO * sizes
            on_side[:, axis, end] = rest
            quotient = divided(moved[rest])
            nets[rest] = np.moveaxis(quotient[..., ::-1] if end else quotient, -1, 2 + axis)
    return nets, on_side


def has_no_zero(nets: Floats, rounding: Floats) -> Bools:
    """(k,) whether a component has one sign all over its box, beyond rounding (k, d)."""
    flat = nets.reshape(*nets.shape[:2], int(np.prod(nets.shape[2:])))
    return np.asarray(((flat.min(axis=2) > rounding) | (flat.max(axis=2) < -rounding)).any(axis=1))


def values_of(nets: Floats, places: Floats) -> Floats:
    """(k, c) components of nets (k, c, D, …) at places (k, d) in [0, 1]^d of their boxes."""
    for axis in range(places.shape[1]):
        table = line_tables(nets.shape[2] - 1, places[:, axis])[0]
        nets = np.einsum("kci...,ki->kc...", nets, table)
    return nets


def derivatives(nets: Floats, places: Floats) -> Floats:
    """(k, c, d) derivatives of components of nets (k, c, D, …) at places (k, d) in [0, 1]^d."""
    return np.stack([values_of(slope_nets(nets, axis), places) for axis in range(places.shape[1])], axis=2)


def slope_nets(nets: Floats, axis: int) -> Floats:
    """(k, d, D, …) nets of the derivatives in one direction, of the old degree: of the lower one, raised."""
    moved = np.moveaxis(nets, 2 + axis, -1)
    degree = moved.shape[-1] - 1
    return np.moveaxis(_raised(degree * np.diff(moved, axis=-1)), -1, 2 + axis)


def inverses(matrices: Floats) -> Floats:
    """(k, d, d) inverses; for singular matrices the unit matrix."""
    d = matrices.shape[1]
    sizes = np.abs(matrices).max(axis=(1, 2), initial=1e-300)[:, None, None]
    sound = np.abs(np.linalg.det(matrices / sizes)) > 1e-12
    found = np.tile(np.eye(d), (len(matrices), 1, 1))
    found[sound] = np.linalg.inv(matrices[sound])
    return found


def is_injective(unit: Floats) -> Bools:
    """(k,) whether derivatives differ so little from the unit matrix all over a box that one zero is there at most."""
    d = unit.shape[1]
    found = np.zeros((len(unit), d))
    for axis in range(d):
        flat = slope_nets(unit, axis).reshape(len(unit), d, int(np.prod(unit.shape[2:])))
        target = np.eye(d)[axis][None, :, None]
        found += np.abs(flat - target).max(axis=2)
    return np.asarray((found < 1).all(axis=1))


def newton_zeros(nets: Floats) -> tuple[Floats, Bools]:
    """Places (k, d) of zeros in [0, 1]^d, and whether (k,) they are in the boxes."""
    places = np.full((len(nets), nets.shape[1]), 0.5)
    step = np.full_like(places, np.inf)
    for _ in range(_STEPS):
        step = np.einsum("kij,kj->ki", inverses(derivatives(nets, places)), values_of(nets, places))
        places = (places - step).clip(-0.5, 1.5)
    close = np.abs(step).max(axis=1, initial=0.0) < _SHORT
    inside = ((places >= -BEYOND) & (places <= 1 + BEYOND)).all(axis=1)
    return places, close & inside
