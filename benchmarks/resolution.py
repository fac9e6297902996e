"""Estimates of resolution against the truth: python benchmarks/resolution.py [--quick].

Twelve fields in closed form (manufactured.py) on all shapes: decay rates against theory, the worst elements and errors
of gradients against true errors, planted aliasing, the order of recovered derivatives, and seconds for Nek5000 files.
"""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any

import numpy as np
from manufactured import PROFILES, Manufactured, Profile, approximated, plane, true_errors, twelve
from tables import Table, seconds

from elvis import Dataset, Shape, read
from elvis.core.base.arrays import Bools, Floats, Ints
from elvis.core.data.dataset import Block, Field
from elvis.core.mapping.geometry import geometry
from elvis.core.mapping.orientation import local_vertices
from elvis.core.mapping.projections import rule
from elvis.core.numbers.norms import quantity_norms
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.quantities import Expression
from elvis.core.resolution.decay_rates import decay_rates
from elvis.core.resolution.element_resolution import element_resolution
from elvis.core.resolution.facts import resolution_facts
from elvis.core.resolution.gradient_errors import gradient_errors
from elvis.core.resolution.low_order_errors import with_neighbours
from elvis.core.resolution.modal_bases import modal_basis
from elvis.core.testing import grid

#: makes Nek5000 files with n^3 curved hexahedra of order 7
GENERATOR = Path(__file__).resolve().parents[2] / "shared" / "tools" / "gennek"
#: cells along a side of the grids, by dimension: for decay rates, for the worst elements, for errors of gradients
DECAY_CELLS = {1: 3, 2: 3, 3: 2}
WORST_CELLS = {1: 400, 2: 24, 3: 6}
GRADIENT_CELLS = {1: 60, 2: 10, 3: 5}
#: orders of the fields, for the same
DECAY_ORDERS = (5, 7, 9)
HIGHEST = {1: 9, 2: 9, 3: 7}
WORST_ORDERS = (2, 4, 6)
GRADIENT_ORDERS = (1, 2, 3)
#: levels that a rate is fitted to
FITTED = 6
#: places of layers and shocks in an element
PLACES = np.linspace(-0.46, 0.46, 12)
#: points in each direction for projections of shocks beyond those for polynomials, by dimension
SHOCK_POINTS = {1: 40, 2: 40, 3: 32}
#: points in each direction for exact spectra of smooth fields, and of shocks, in the plane and in space
EXACT_POINTS = (24, 40)
#: share of the elements that are the worst
SHARE = 0.05
#: part of the least of the truly worst errors from which an element counts as one of the worst
NEARLY = 0.9
#: rounding, relative to the largest error, below which elements do not differ
ROUNDING = 1e-9
#: rounding of coefficients, relative to the largest
EXACT = 1e-13
#: factor by which the error of the gradient must fall with each of the last orders, two at most, on smooth elements
SMOOTH = 4.0
#: singularities nearest to the real axis, and the exponent of k in the law of their modes
POLES: dict[str, tuple[complex, float]] = {
    "pole": (2j, 0.0),
    "tanh": (0.3j * np.pi, 0.0),
    "arctan": (0.6j, 1.0),
}


def measure(quick: bool = False) -> dict[str, Any]:
    """All numbers; a few shapes and sizes where it is to be quick."""
    shapes = [Shape.SEGMENT, Shape.TRIANGLE] if quick else list(Shape)
    cells = 2 if quick else 32
    return {
        "decay": {order: by_field(shapes, decay, [order]) for order in DECAY_ORDERS[: 1 if quick else None]},
        "worst": {order: by_field(shapes, worst, [order]) for order in WORST_ORDERS[: 1 if quick else None]},
        "gradient": by_field(shapes, gradient, GRADIENT_ORDERS[:1] if quick else GRADIENT_ORDERS),
        "aliasing": {shape.label: aliasing(shape, 4 if quick else 20) for shape in shapes},
        "order": {shape.label: orders(shape, quick) for shape in shapes},
        "seconds": {str(count**3): cpu_seconds(count) for count in dict.fromkeys((min(8, cells), cells))},
    }


Measured = Callable[[Shape, int, Sequence[int]], float]


def by_field(shapes: Sequence[Shape], measured: Measured, orders: Sequence[int]) -> dict[str, dict[str, float]]:
    """A number for each field and shape."""
    return {
        profile.name: {shape.label: measured(shape, number, orders) for shape in shapes}
        for number, profile in enumerate(PROFILES)
    }


# decay rates


def decay(shape: Shape, number: int, orders: Sequence[int]) -> float:
    """Median of the quotients of decay rates and theory, at the order at which it is farthest from 1.

    The field depends on x.  Layers and shocks are measured on the elements that contain them, at several places;
    corners on those that touch the plane x = 0.  The law of a shock is that of the mean spectrum over its places in the
    element, so that its rate is that of this mean.  NaN for orders that take too long in space.
    """
    if max(orders) > HIGHEST[shape.dimension]:
        return np.nan
    profile, cells = PROFILES[number], DECAY_CELLS[shape.dimension]
    dataset = Dataset(grid(shape, cells))
    measured = _quotients_of_means if profile.kind == "shock" else _quotients
    medians = [float(np.median(measured(dataset, profile, cells, order))) for order in orders]
    return max(medians, key=lambda median: abs(median - 1))


def _quotients(dataset: Dataset, profile: Profile, cells: int, order: int) -> Floats:
    """Quotients (n,) of decay rates and theory."""
    axis = np.array([1.0, 0.0, 0.0])
    at_corner = profile.exponent is not None
    spectra = _Spectra(dataset, order, EXACT_POINTS[0])
    rates, energies, held = [], [], []
    for place in [-cells / 2] if at_corner else PLACES:
        made = plane(profile, axis, cells, float(place))
        rates.append(element_resolution(approximated(dataset, made.value, order), "u").decay)
        energies.append(spectra.energies(made))
        low, high = spectra.ends(cells, float(place))
        is_in = np.abs(low) < ROUNDING if at_corner else (low < 0) & (high > 0)
        held.append(is_in if profile.kind in ("corner", "layer", "shock") else np.ones(len(low), bool))
    own, is_used = np.array(rates), np.array(held)
    if profile.name in POLES:
        places = [spectra.ends(cells, float(place)) for place in PLACES]
        theory = np.array([_pole_rates(low, high, order, *POLES[profile.name]) for low, high in places])
    else:
        theory = np.broadcast_to(spectra.slopes(np.array(energies), is_used), own.shape)
    return np.asarray(own[is_used] / theory[is_used])


def _quotients_of_means(dataset: Dataset, profile: Profile, cells: int, order: int) -> Floats:
    """Quotients (n,) of decay rates and theory, of mean spectra over places and elements of one form."""
    axis, spectra = np.array([1.0, 0.0, 0.0]), _Spectra(dataset, order, EXACT_POINTS[1])
    found, exact, held = [], [], []
    for place in PLACES:
        made = plane(profile, axis, cells, float(place))
        own = approximated(dataset, made.value, order, SHOCK_POINTS[dataset.mesh.dimension])
        found.append(_along_x(own))
        exact.append(spectra.energies(made))
        low, high = spectra.ends(cells, float(place))
        held.append((low < 0) & (high > 0))
    energies, is_used = np.array(found), np.array(held)
    theory = spectra.slopes(np.array(exact), is_used)
    quotients = []
    for members in spectra.forms:
        chosen = energies[is_used & members]
        if len(chosen):
            mean = (chosen / chosen.sum(axis=1, keepdims=True)).mean(axis=0)
            quotients.append(decay_rates(mean[None], EXACT)[0] / theory[members][0])
    return np.array(quotients)


def _along_x(dataset: Dataset) -> Floats:
    """(n, p + 1) energies of the levels of the factor of the basis that has the first direction."""
    (block,) = dataset.field("u").blocks
    basis = modal_basis(block.expansion)
    squares = basis.modal(block.coefficients) ** 2
    (axis,) = (number for number, own in enumerate(basis.factors, 1) if 0 in own.directions)
    others = tuple(number for number in range(1, squares.ndim) if number != axis)
    levels = basis.factors[axis - 1].levels
    return np.asarray(squares.sum(axis=others) @ (levels[:, None] == np.arange(levels.max() + 1)))


def _pole_rates(low: Floats, high: Floats, order: int, pole: complex, exponent: float) -> Floats:
    """(n,) rates on intervals: modes fall like k^-exponent rho^-k, rho the sum of the half axes of an ellipse.

    The foci of the ellipse are the ends of the interval, and it runs through the pole (Trefethen 2013, Approximation
    Theory and Approximation Practice, chapter 8).
    """
    z = (pole - (low + high) / 2) / ((high - low) / 2)
    outer = np.abs(z + np.sqrt(z - 1) * np.sqrt(z + 1))
    levels = np.arange(max(1, order - FITTED + 1), order + 1)
    return np.asarray(np.abs(np.log(outer)) - np.polyfit(levels, -exponent * np.log(levels + 0.5), 1)[0])


class _Spectra:
    """Exact spectra of functions of x on elements: in polynomials of x that are orthogonal on the element."""

    def __init__(self, dataset: Dataset, order: int, points: int) -> None:
        (own,) = geometry(dataset)
        self._points, weights = rule(own.expansion.shape, points if own.expansion.shape.dimension > 1 else 2 * points)
        world = evaluate(own.expansion, own.coefficients, self._points)
        self._places = np.swapaxes(world, 1, 2)
        self._roots, self._order = np.sqrt(weights / weights.sum()), order
        corners = evaluate(own.expansion, own.coefficients, own.expansion.shape.vertices)[:, 0]
        self._low, self._high = corners.min(axis=1), corners.max(axis=1)
        relative = np.sort(corners - self._low[:, None], axis=1)
        _, self._group = np.unique(np.round(relative, 9), axis=0, return_inverse=True)

    @property
    def forms(self) -> list[Bools]:
        """For each form of elements, (n,) which elements have it."""
        return [self._group == group for group in np.unique(self._group)]

    def ends(self, cells: int, place: float) -> tuple[Floats, Floats]:
        """Values (n,) of t at the ends of the elements."""
        middle = 0.5 + place / cells
        return cells * (self._low - middle), cells * (self._high - middle)

    def energies(self, made: Manufactured) -> Floats:
        """(n, p + 1) energies of the levels."""
        found = made.value(self._places.reshape(-1, 3)).reshape(self._places.shape[:2]) * self._roots
        local = 2 * (self._places[..., 0] - self._low[:, None]) / (self._high - self._low)[:, None] - 1
        tables = np.polynomial.legendre.legvander(local, self._order) * self._roots[:, None]
        return np.asarray(np.einsum("nqk,nq->nk", np.linalg.qr(tables)[0], found) ** 2)

    def slopes(self, energies: Floats, is_used: Ints) -> Floats:
        """(n,) rates of the mean energies (places, n, p + 1) over places and elements of one form."""
        levels = np.arange(max(1, self._order - FITTED + 1), self._order + 1)
        found = np.full(len(self._low), np.nan)
        for members in self.forms:
            own = energies[is_used & members]
            if len(own):
                mean = (own / own.sum(axis=1, keepdims=True)).mean(axis=0)
                found[members] = -np.polyfit(levels, 0.5 * np.log(mean[levels]), 1)[0]
        return found


# the worst elements


def worst(shape: Shape, number: int, orders: Sequence[int]) -> float:
    """Least share, over orders, of the elements with the largest estimated errors that are truly among the worst."""
    cells = WORST_CELLS[shape.dimension]
    dataset, made = Dataset(grid(shape, cells)), twelve(shape.dimension, cells)[number]
    return min(_overlap(dataset, made, order) for order in orders)


def _overlap(dataset: Dataset, made: Manufactured, order: int) -> float:
    """Share of the worst elements by estimate that are truly worst."""
    own = approximated(dataset, made.value, order)
    true, estimated = true_errors(own, made, order)[0], with_neighbours(own, "u", element_resolution(own, "u")).error
    count = int(np.ceil(SHARE * len(true)))
    is_chosen = np.zeros(len(true), bool)
    is_chosen[np.argsort(-estimated)[:count]] = True
    largest = max(np.abs(block.coefficients).max() for block in own.field("u").blocks)
    is_worst = true >= max(NEARLY * np.sort(true)[-count], ROUNDING * true.max(), EXACT * largest)
    most = min(count, np.count_nonzero(is_worst))
    return float(np.count_nonzero(is_worst & is_chosen) / most) if most else np.nan


# errors of gradients


def gradient(shape: Shape, number: int, orders: Sequence[int]) -> float:
    """Share of the smooth elements, of all orders, whose recovered error is half to twice the true one."""
    cells = GRADIENT_CELLS[shape.dimension]
    dataset, made = Dataset(grid(shape, cells)), twelve(shape.dimension, cells)[number]
    quotients = np.concatenate([_effectivity(dataset, made, order) for order in orders])
    return float(np.mean((quotients >= 0.5) & (quotients <= 2))) if len(quotients) else np.nan


def _effectivity(dataset: Dataset, made: Manufactured, order: int) -> Floats:
    """(n,) quotients of estimated and true errors of the gradient on smooth elements.

    An element is smooth if the true error falls at least 16-fold with the last two orders, there and on all elements
    that share a vertex with it.  A single order would depend on the phase of the field in the element.  For order 1,
    where there is only one, it must fall 4-fold.
    """
    own = approximated(dataset, made.value, order)
    true = true_errors(own, made, order)[1]
    fewer = max(order - 2, 0)
    # constants have no gradient: those that any field of order 1 has then are errors
    below = approximated(dataset, made.value if fewer else _zero, max(fewer, 1))
    lower = true_errors(below, made, fewer)[1] / SMOOTH ** (order - fewer)
    ids, found = gradient_errors(own, "u")
    (block,) = geometry(dataset)
    mesh, shape = dataset.mesh, block.expansion.shape
    vertices = local_vertices(mesh, shape)[mesh.of(shape).rows_of(ids)]
    is_rough = np.zeros(len(mesh.vertices), bool)
    is_rough[vertices[true > lower]] = True
    is_smooth = ~is_rough[vertices].any(axis=1) & (true > ROUNDING * lower.max())
    return np.asarray(found[is_smooth] / true[is_smooth])


def _zero(points: Floats) -> Floats:
    return np.zeros(len(points))


# aliasing


def aliasing(shape: Shape, trials: int, order: int = 5) -> dict[str, int]:
    """Aliasing planted in one of about 1,000 elements: energy that grows at the highest mode.

    A mode of the highest level is added.  The mode, its sign and the element are random, as is its energy: 2 to 10,000
    times that with which a mode of the highest level has more energy in the mean than one of the two levels below.
    """
    cells = {Shape.TRIANGLE: 23, Shape.QUADRILATERAL: 32, Shape.PRISM: 8, Shape.HEXAHEDRON: 10}.get(shape)
    cells = cells or (1000 if shape is Shape.SEGMENT else 6)
    smooth = twelve(shape.dimension, cells)[1]
    own = approximated(Dataset(grid(shape, cells)), smooth.value, order)
    (block,) = own.field("u").blocks
    alarms = int(element_resolution(own, "u").grows.sum())

    # coefficients of the orthonormal modes
    basis, rng, found = modal_basis(block.expansion), np.random.default_rng(51), 0
    top, size = np.flatnonzero(basis.is_top()), block.coefficients.shape[1]
    modes = np.linalg.inv(basis.modal(np.eye(size)).reshape(size, size))
    levels = np.zeros(1, np.int64)
    for factor in basis.factors:
        levels = np.maximum(levels[:, None], factor.levels).reshape(-1)
    energies = basis.modal(block.coefficients).reshape(-1, size) ** 2
    below = np.maximum(energies @ (levels == order - 1), energies @ (levels == order - 2))
    count = max(np.count_nonzero(factor.levels == order) for factor in basis.factors)
    for _ in range(trials):
        row, mode = int(rng.integers(len(block))), int(rng.choice(top))
        coefficients = block.coefficients.copy()
        amplitude = np.sqrt(10 ** rng.uniform(np.log10(2), 4) * count * below[row])
        coefficients[row] += amplitude * modes[mode] * rng.choice([-1, 1])
        planted = Field("u", (Block(block.expansion, block.element_ids, coefficients),))
        grows = element_resolution(Dataset(own.mesh, (planted,)), "u")
        found += grows.element_ids[grows.grows].tolist() == [int(block.element_ids[row])]
    return {"elements": len(block), "trials": trials, "found": found, "false_alarms": alarms}


# recovered derivatives


def orders(shape: Shape, quick: bool) -> dict[str, float]:
    """Order of convergence of recovered derivatives in x and of raw ones, by order of the field."""
    found = {}
    for order in (2,) if quick else (1, 2, 3, 4):
        cells = (6, 12) if shape.dimension < 3 else (3, 6)
        both = [_derivative_errors(shape, order, count) for count in cells]
        found[str(order)], found[f"raw {order}"] = (float(np.log2(both[0][i] / both[1][i])) for i in range(2))
    return found


def _derivative_errors(shape: Shape, order: int, cells: int) -> tuple[float, float]:
    """L2 errors of the recovered derivative in x and of the raw one."""

    def value(points: Floats) -> Floats:
        x, y, z = points.T
        height = np.cos(z + 0.2) if shape.dimension == 3 else 1.0
        return np.asarray(np.sin(2 * x + 0.3) * np.cos(1.5 * y) * height)

    own = approximated(Dataset(grid(shape, cells)), value, order)
    others = ("cos(1.5*y)", "cos(z + 0.2)")[: shape.dimension - 1]
    truth = "(" + "*".join(["2*cos(2*x + 0.3)", *others]) + ")"
    texts = [f"recovered(d(u,x)) - {truth}", f"d(u,x) - {truth}"]
    norms = [quantity_norms(own, [Expression.of(own, text)])[text].l2 for text in texts]
    return norms[0], norms[1]


# seconds


def cpu_seconds(count: int) -> dict[str, float]:
    """CPU seconds of `resolution_facts` for the four fields of n^3 curved hexahedra of order 7, and of reading them."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "box0.f00000"
        subprocess.run([sys.executable, GENERATOR, str(count), path], check=True)
        start = process_time()
        dataset = read(path)
        names = [field.name for field in dataset.solution]
        fields = [dataset.field(name).blocks for name in names]
        middle = process_time()
        resolution_facts(dataset, names)
        return {"fields": len(fields), "read": middle - start, "facts": process_time() - middle}


def tables(numbers: dict[str, Any]) -> list[Table]:
    """The tables of all numbers."""
    return [
        *_by_order(numbers["decay"], "Decay rates, relative to theory", "Limit: 0.9 to 1.1."),
        *_by_order(numbers["worst"], "Worst 5 % of the elements: share that is truly worst", "Limit: at least 0.8."),
        _by_field(numbers["gradient"], "Smooth elements with an effectivity of 0.5 to 2", "Limit: at least 0.9."),
        _aliasing_table(numbers["aliasing"]),
        _order_table(numbers["order"]),
        _seconds_table(numbers["seconds"]),
    ]


def _by_order(numbers: dict[int, dict[str, dict[str, float]]], title: str, limit: str) -> list[Table]:
    """A table for each order."""
    return [_by_field(found, f"{title}, order {order}", limit) for order, found in numbers.items()]


def _by_field(numbers: dict[str, dict[str, float]], title: str, limit: str) -> Table:
    """A row for each field."""
    kinds = {profile.name: profile.kind for profile in PROFILES}
    table = Table(title, ["field", *next(iter(numbers.values()))], notes=[limit])
    for name, row in numbers.items():
        cells = ["-" if np.isnan(value) else f"{value:.2f}" for value in row.values()]
        table.rows.append([f"{kinds[name]}: {name}", *cells])
    return table


def _aliasing_table(numbers: dict[str, dict[str, int]]) -> Table:
    """A row for each shape."""
    table = Table("Planted aliasing", ["shape", "elements", "trials", "found", "false alarms"])
    table.rows += [[shape, *(str(value) for value in row.values())] for shape, row in numbers.items()]
    table.notes.append("Limit: all found, no false alarm.")
    return table


def _order_table(numbers: dict[str, dict[str, float]]) -> Table:
    """A row for each shape."""
    columns = list(max(numbers.values(), key=len))
    table = Table("Order of convergence of recovered and raw derivatives", ["shape", *columns])
    for shape, row in numbers.items():
        table.rows.append([shape, *(f"{row[name]:.2f}" if name in row else "-" for name in columns)])
    table.notes.append("Columns: order p of the field. Limit of the recovered ones: p + 0.9.")
    return table


def _seconds_table(numbers: dict[str, dict[str, float]]) -> Table:
    """A row for each file."""
    table = Table("CPU s for hexahedra of order 7", ["elements", "fields", "read", "resolution"])
    for count, row in numbers.items():
        table.rows.append([count, str(row["fields"]), seconds(row["read"]), seconds(row["facts"])])
    table.notes.append("Limits: 0.5 CPU s for 512 elements, 20 for 32,768.")
    return table


if __name__ == "__main__":
    for each in tables(measure("--quick" in sys.argv)):
        print(each.text())
