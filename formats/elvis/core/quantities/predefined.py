"""Predefined quantities of flows, from fields with customary names.

speed          |u|
velocity_x, velocity_y, velocity_z    the components of u
vorticity      rot u: its length, in two dimensions its one component; vorticity_x, vorticity_y, vorticity_z
divergence     div u
q_criterion    (|Omega|^2 - |S|^2) / 2 = -(1/2) sum_ij d_i u_j d_j u_i (Hunt, Wray and Moin 1988)
helicity       u . rot u
pressure       (gamma - 1) (E - |rho u|^2 / (2 rho)), where only the total energy is there
mach           |u| / sqrt(gamma p / rho)
schlieren      |grad rho|
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial, reduce

from elvis.core.quantities.tree import Node, call, field, number, world_derivative

Made = Callable[[], Node]

_VELOCITIES = (
    ("u", "v", "w"),
    ("velocity_x", "velocity_y", "velocity_z"),
    ("Velocity_x", "Velocity_y", "Velocity_z"),
    ("VelocityX", "VelocityY", "VelocityZ"),
    ("v_x", "v_y", "v_z"),
    ("V_x", "V_y", "V_z"),
    ("U_x", "U_y", "U_z"),
    ("vx", "vy", "vz"),
)
_MOMENTA = (
    ("rhou", "rhov", "rhow"),
    ("rho_u", "rho_v", "rho_w"),
    ("momentum_x", "momentum_y", "momentum_z"),
    ("MomentumX", "MomentumY", "MomentumZ"),
)
_DENSITIES = ("rho", "density", "Density")
_PRESSURES = ("p", "pressure", "Pressure")
_ENERGIES = ("E", "rhoE", "energy", "Energy", "TotalEnergy", "EnergyStagnationDensity")

#: what each quantity is made of, in words
INGREDIENTS = {
    **dict.fromkeys(
        (
            "speed",
            "velocity_x",
            "velocity_y",
            "velocity_z",
            "vorticity",
            "vorticity_x",
            "vorticity_y",
            "vorticity_z",
            "divergence",
            "q_criterion",
            "helicity",
        ),
        "a velocity (u, v, w or velocity_x, ... or rho with rhou, ...)",
    ),
    "pressure": "a field p, or rho, rhou, ... and E",
    "mach": "a velocity, rho, and p or E",
    "schlieren": "rho",
}


def quantities(fields: Sequence[str], dimension: int, gamma: float) -> dict[str, Made]:
    """By name, all that the fields suffice for."""
    density, pressure = _one(fields, _DENSITIES), _one(fields, _PRESSURES)
    momentum, energy = _components(fields, _MOMENTA, dimension), _one(fields, _ENERGIES)
    velocity = _components(fields, _VELOCITIES, dimension)
    if velocity is None and momentum and density:
        velocity = [call("/", part, density) for part in momentum]
    if pressure is None and energy and momentum and density:
        pressure = _pressure(density, momentum, energy, gamma)

    found: dict[str, Made] = _of_velocity(velocity) if velocity else {}
    for axis, part in zip("xyz", velocity or (), strict=False):
        found[f"velocity_{axis}"] = partial(_itself, part)
    if pressure:
        found["pressure"] = partial(_itself, pressure)
    if velocity and pressure and density:
        found["mach"] = partial(_mach, velocity, density, pressure, gamma)
    if density:
        found["schlieren"] = partial(gradient, density, dimension)
    return {name: made for name, made in found.items() if name not in fields}


def gradient(of: Node, dimension: int) -> Node:
    """The length of the gradient."""
    return _length([world_derivative(of, axis) for axis in range(dimension)])


def laplacian(of: Node, dimension: int) -> Node:
    """The divergence of the gradient."""
    return _total([world_derivative(world_derivative(of, axis), axis) for axis in range(dimension)])


def _of_velocity(velocity: Sequence[Node]) -> dict[str, Made]:
    found: dict[str, Made] = {
        "speed": partial(_length, velocity),
        "divergence": lambda: _total([world_derivative(part, axis) for axis, part in enumerate(velocity)]),
        "q_criterion": partial(_q_criterion, velocity),
    }
    if len(velocity) == 2:
        found["vorticity"] = found["vorticity_z"] = partial(_turning, velocity, 2)
    if len(velocity) == 3:
        found |= {f"vorticity_{name}": partial(_turning, velocity, axis) for axis, name in enumerate("xyz")}
        found["vorticity"] = lambda: _length([_turning(velocity, axis) for axis in range(3)])
        found["helicity"] = lambda: _total([call("*", velocity[axis], _turning(velocity, axis)) for axis in range(3)])
    return found


def _turning(velocity: Sequence[Node], axis: int) -> Node:
    """One component of the rotation."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    return call("-", world_derivative(velocity[j], i), world_derivative(velocity[i], j))


def _q_criterion(velocity: Sequence[Node]) -> Node:
    axes = range(len(velocity))
    gradients = [[world_derivative(part, axis) for axis in axes] for part in velocity]
    return call("*", number(-0.5), _total([call("*", gradients[i][j], gradients[j][i]) for i in axes for j in axes]))


def _pressure(density: Node, momentum: Sequence[Node], energy: Node, gamma: float) -> Node:
    squares = _total([call("*", part, part) for part in momentum])
    kinetic = call("/", call("*", number(0.5), squares), density)
    return call("*", number(gamma - 1), call("-", energy, kinetic))


def _mach(velocity: Sequence[Node], density: Node, pressure: Node, gamma: float) -> Node:
    sound = call("sqrt", call("/", call("*", number(gamma), pressure), density))
    return call("/", _length(velocity), sound)


def _itself(node: Node) -> Node:
    return node


def _total(terms: Sequence[Node]) -> Node:
    return reduce(partial(call, "+"), terms)


def _length(parts: Sequence[Node]) -> Node:
    return call("sqrt", _total([call("*", part, part) for part in parts]))


def _one(fields: Sequence[str], names: Sequence[str]) -> Node | None:
    return next((field(name) for name in names if name in fields), None)


def _components(fields: Sequence[str], names: Sequence[Sequence[str]], dimension: int) -> list[Node] | None:
    """The fields of the first family of names that is there whole."""
    whole = (family[:dimension] for family in names if set(family[:dimension]) <= set(fields))
    return next(([field(name) for name in family] for family in whole), None)
