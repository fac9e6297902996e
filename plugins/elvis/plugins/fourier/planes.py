"""Fourier directions of quasi-3D data: means along them, planes across them, and the same functions in other waves."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import starmap

import numpy as np

from elvis.core.base.arrays import Floats, frozen_floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Block, Dataset, Field, Homogeneous
from elvis.core.data.mesh import Composite
from elvis.core.integrals import integrate
from elvis.core.mapping.patch import Patch, patches
from elvis.core.polynomials.bases import Basis
from elvis.core.polynomials.evaluation import evaluate
from elvis.core.polynomials.expansion import wave_values


def fourier_mean(dataset: Dataset, axis: str, option: str = "") -> Dataset:
    """The mean of all fields along a Fourier direction.

    Parameters
    ----------
    dataset : Dataset
        Fields with one Fourier direction, z of plane elements, y of lines.
    axis : str
        ``x``, ``y`` or ``z``.
    option : str
        The option that errors name; by default ``--direction``.

    Returns
    -------
    Dataset
        The same mesh with fields without this direction: the coefficients of wave number 0, exact, as all other modes
        have the mean zero.

    Raises
    ------
    ElvisError
        If the data have no Fourier direction along the axis, or two.
    """
    _check(dataset, axis, option or f"--direction {axis}")
    return _combined(dataset, _is_constant)


def fourier_coefficients(dataset: Dataset, number: int) -> Dataset:
    """The coefficients of one Fourier plane as plane data: 0 the mean, 2k of cos(2 pi k z/L), 2k + 1 of -sin(…).

    Raises ElvisError for data without one Fourier direction, and without this plane.
    """
    _check_plane(dataset, f"--plane {number}", number)
    return _plane(dataset, number)


def stacked_planes(planes: Sequence[Sequence[Block]], waves: Homogeneous) -> tuple[Block, ...]:
    """The blocks of a field in waves from those of its planes of coefficients, as `fourier_coefficients` gives them."""

    def stacked(*own: Block) -> Block:
        expansion = replace(own[0].expansion, homogeneous=waves)
        return Block(expansion, own[0].element_ids, frozen_floats(np.hstack([block.coefficients for block in own])))

    return tuple(starmap(stacked, zip(*planes, strict=True)))


@dataclass(frozen=True)
class WaveEnergies:
    """The energy of fields by Fourier waves: mean squares, which add up to those of the fields.

    waves      wave numbers k, of functions with the wavelength ``period`` / k
    period     of the Fourier direction
    by_field   for each field a mean square for each wave, over the plane and the period
    """

    waves: tuple[int, ...]
    period: float
    by_field: Mapping[str, tuple[float, ...]]


def wave_energies(dataset: Dataset, box: tuple[float, ...] = ()) -> WaveEnergies:
    """The exact mean square of each field in each Fourier wave: of the mean for k = 0, else half of both squares.

    box  x0, x1, y0, y1: only the elements whose corners have their mean in this box
    Single and half modes count as wave 1.  Raises ElvisError for data without one Fourier direction, and for a box
    without elements.
    """
    _check_one(dataset, "--waves")
    dataset, over = _with_box(dataset, box) if box else (dataset, "domain")
    whole = in_full_waves(dataset)
    period = _waves_of(whole)[0].lengths[0]
    count = 1 + max(own for waves in _waves_of(whole) for own in waves.z_ids) // 2
    names = [field.name for field in whole.solution]
    found = {name: [0.0] * count for name in names}
    for wave in range(count):
        for number in (2 * wave, 2 * wave + 1)[: 2 if wave else 1]:
            plane = _plane(whole, number)
            for name in names:
                squared = integrate(plane, f"average(({name})^2)", over).value
                found[name][wave] += squared / 2 if wave else squared
    return WaveEnergies(tuple(range(count)), period, {name: tuple(own) for name, own in found.items()})


def _with_box(dataset: Dataset, box: tuple[float, ...]) -> tuple[Dataset, str]:
    """The data with a composite of the elements in a box, and its name as a target of integrals."""
    mesh = dataset.mesh
    low, high = np.array(box).reshape(2, 2).T
    parts = []
    for patch in patches(dataset, ()):
        corners = evaluate(patch.geometry, patch.geometry_coefficients, patch.shape.vertices)
        middles = corners.mean(axis=2)[:, :2]
        is_inside = ((middles >= low) & (middles <= high)).all(axis=1)
        parts += [(patch.shape.tag, patch.element_ids[is_inside])] if is_inside.any() else []
    if not parts:
        raise ElvisError(f"--box: expected elements in {','.join(f'{own:g}' for own in box)}, found none")
    number = 1 + max(own.id for own in mesh.composites)
    composites = (*mesh.composites, Composite(number, tuple(parts)))
    return replace(dataset, mesh=replace(mesh, composites=composites)), f"region:{number}"


def without_plane(dataset: Dataset, number: int) -> Dataset:
    """All fields with the coefficients of one Fourier plane set to zero; ElvisError as `fourier_coefficients`."""
    _check_plane(dataset, f"--zero-plane {number}", number)
    found = _rewritten(dataset, lambda waves: (waves, np.diag((np.array(waves.z_ids) != number).astype(np.float64))))
    return replace(found, expansions=())


def has_waves(dataset: Dataset) -> bool:
    """Whether fields have Fourier directions."""
    return any(block.expansion.homogeneous for own in dataset.solution for block in own.blocks)


def only_waves(parts: Sequence[Patch], what: str) -> Homogeneous:
    """The only Fourier direction of patches; ElvisError for others."""
    waves = {own.homogeneous for own in parts}
    first = next(iter(waves), None)
    if len(waves) != 1 or first is None or len(first.lengths) != 1:
        raise ElvisError(f"{what}: expected fields with one Fourier direction, found none or several")
    return first


def common_waves(dataset: Dataset, what: str) -> Homogeneous:
    """The Fourier direction of all fields; ElvisError if there is none, or if fields have several."""
    _check_one(dataset, what)
    found = set(_waves_of(dataset))
    if len(found) > 1:
        raise ElvisError(f"{what}: expected the same Fourier planes for all fields, found {len(found)} sets")
    return found.pop()


def in_full_waves(dataset: Dataset, periods: int = 1, sines: Sequence[str] = ()) -> Dataset:
    """The same functions in all Fourier modes of ``periods`` periods, also those of single and half modes.

    sines  fields with half modes whose coefficients are those of the sine, a quarter of a period behind the cosine
    The session of the data is left out, as it describes another expansion.
    ElvisError for data without one Fourier direction, and for other names of fields.
    """
    _check_one(dataset, "--full" if periods == 1 else f"--stretch {periods}")
    known = [field.name for field in dataset.fields]
    if not set(sines) <= set(known):
        raise ElvisError(f"--sine: expected some of the fields {', '.join(known)}; found {', '.join(sines)}")

    def changed(waves: Homogeneous, is_sine: bool) -> tuple[Homogeneous, Floats]:
        if is_sine and waves.bases[0] is not Basis.FOURIER_HALF_MODE_RE:
            raise ElvisError("--sine: expected fields with cosines of half modes, found others")
        highest = max(waves.z_ids) // 2 if waves.bases[0] is Basis.FOURIER else 1
        numbers = tuple(range(2 * (periods * highest + 1)))
        target = Homogeneous((Basis.FOURIER,), (periods * waves.lengths[0],), numbers)

        # factors of old functions in terms of new ones, which are whole numbers: fitted to values over all periods
        places = periods * (np.arange(2 * len(numbers)) + 0.5) / (2 * len(numbers))
        old = wave_values(waves, 2 * (places % 1)[:, None] - 1)
        if is_sine:
            old = wave_values(waves, 2 * ((places - 0.25) % 1)[:, None] - 1)
        new = wave_values(target, 2 * places[:, None] / periods - 1)
        return target, np.rint(np.linalg.lstsq(new, old, rcond=None)[0])

    fields = list[Field]()
    for field in dataset.fields:
        alone = replace(dataset, fields=(field,))
        fields += _rewritten(alone, partial(changed, is_sine=field.name in sines)).fields
    return replace(dataset, fields=tuple(fields), session={}, expansions=())


def _is_constant(waves: Homogeneous) -> Floats:
    """(planes,) 1 for the plane whose function is 1, 0 for those with the mean zero."""
    is_first = np.array(waves.z_ids) == 0
    return np.asarray(is_first & (waves.bases[0] is Basis.FOURIER), np.float64)


def fourier_plane(dataset: Dataset, axis: str, place: float) -> Dataset:
    """All fields on a plane across a Fourier direction, exact; ElvisError as `fourier_mean`.

    place  coordinate of the plane, of any period
    """
    _check(dataset, axis, f"a plane at {axis} = {place:g}")

    def factors(waves: Homogeneous) -> Floats:
        zeta = 2 * (place / waves.lengths[0]) - 1
        return np.asarray(wave_values(waves, np.array([[zeta]]))[0])

    return _combined(dataset, factors)


def _check(dataset: Dataset, axis: str, what: str) -> None:
    """ElvisError for data without one Fourier direction along an axis."""
    along = "xyz"[dataset.mesh.dimension] if dataset.mesh.dimension < 3 else ""
    if _waves_of(dataset) and axis != along:
        raise ElvisError(f"{what}: expected data with a Fourier direction along {axis}, found one along {along}")
    _check_one(dataset, what)


def _check_one(dataset: Dataset, what: str) -> None:
    """ElvisError for data without one Fourier direction."""
    found = {len(own.lengths) for own in _waves_of(dataset)}
    if not found:
        raise ElvisError(f"{what}: expected data with a Fourier direction, found none")
    if found != {1}:
        raise ElvisError(f"{what}: expected one Fourier direction, found {max(found)}")


def _check_plane(dataset: Dataset, what: str, number: int) -> None:
    """ElvisError for data without one Fourier direction, and without a plane of it."""
    _check_one(dataset, what)
    known = sorted({own for waves in _waves_of(dataset) for own in waves.z_ids})
    if number not in known:
        raise ElvisError(f"{what}: expected one of the planes {', '.join(map(str, known))}")


def _waves_of(dataset: Dataset) -> list[Homogeneous]:
    """The Fourier directions of all blocks that have some."""
    waves = (block.expansion.homogeneous for own in dataset.fields for block in own.blocks)
    return [own for own in waves if own is not None]


def _rewritten(dataset: Dataset, change: Callable[[Homogeneous], tuple[Homogeneous | None, Floats]]) -> Dataset:
    """Fields in other waves, or in none: ``change`` gives these, and factors (new planes, planes) of coefficients."""

    def block_of(block: Block) -> Block:
        waves = block.expansion.homogeneous
        if waves is None:
            return block
        target, factors = change(waves)
        planes = block.coefficients.reshape(len(block), len(waves.z_ids), -1)
        found = np.einsum("kp,npm->nkm", factors, planes).reshape(len(block), -1)
        expansion = replace(block.expansion, homogeneous=target)
        return Block(expansion, block.element_ids, frozen_floats(found))

    fields = (replace(own, blocks=tuple(map(block_of, own.blocks))) for own in dataset.fields)
    return replace(dataset, fields=tuple(fields))


def _plane(dataset: Dataset, number: int) -> Dataset:
    """The coefficients of one plane."""
    return _combined(dataset, lambda waves: (np.array(waves.z_ids) == number).astype(np.float64))


def _combined(dataset: Dataset, weights: Callable[[Homogeneous], Floats]) -> Dataset:
    """Plane data: fields whose planes of coefficients are added up with weights (planes,)."""
    return _rewritten(dataset, lambda waves: (None, weights(waves)[None]))
