"""Integrals of quantities of a dataset over its domain, regions and boundaries, in one call."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any, overload

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.base.ranks import ALONE, Ranks
from elvis.core.base.rounded_up import rounded_up
from elvis.core.base.terminal import Progress, aligned
from elvis.core.data.axis_planes import needs_box
from elvis.core.data.dataset import Dataset
from elvis.core.deformed.isometries import Isometry
from elvis.core.files.columns import Columns
from elvis.core.integrals.coefficients import Coefficients, assumption
from elvis.core.integrals.conversion import ConversionTerms
from elvis.core.integrals.groups import Sums
from elvis.core.integrals.integrands import Integrand, integrands
from elvis.core.integrals.levels.of_elements import Level
from elvis.core.integrals.line_targets import LineTargets, is_line
from elvis.core.integrals.refinement import Summation
from elvis.core.integrals.targets import DOMAIN, ELEMENT, Part, Places, Targets, has_outer_boundaries, overlap
from elvis.core.quantities.evaluator import Evaluator
from elvis.core.quantities.expression import Expression
from elvis.core.quantities.moved_expressions import moved
from elvis.core.quantities.names import Names

#: default of the requested error, relative to the integral of the absolute value
ERROR = 1e-6
#: kinds of errors: rounding, a bound derived over whole elements, or an estimate
EXACT = "exact"
#: by what elements count: |J| or J
ABSOLUTE, SIGNED = JACOBIANS = ("absolute", "signed")
BOUND = "bound"
ESTIMATE = "estimate"


@dataclass(frozen=True)
class Integral:
    """One integral.

    over       the domain of integration
    integrand  the integrand
    value      NaN if the integrand is undefined somewhere
    error      bound or estimate of the error, errors of a conversion included
    measure    length, area or volume of the part of the domain where all fields exist
    exact      whether the rule is exact for the integrand, so that the error is only rounding
    kind       of the error: ``exact`` for rounding, ``bound`` if derived over whole elements, ``estimate`` if rules are
               compared
    finished   False for a refinement that was interrupted, whose error is larger than requested
    """

    over: str
    integrand: str
    value: float
    error: float
    measure: float
    exact: bool
    kind: str = ESTIMATE
    finished: bool = True

    def __float__(self) -> float:
        return self.value

    def facts(self) -> dict[str, Any]:
        """Plain data for files: ``error`` is None if only an estimate is known, which ``estimate`` is."""
        facts = asdict(self)
        is_estimate = self.kind == ESTIMATE
        place = list(facts).index("error")
        both = {"error": None if is_estimate else self.error, "estimate": self.error if is_estimate else None}
        return dict([*list(facts.items())[:place], *both.items(), *list(facts.items())[place + 1 :]])


class Integrals(Sequence[Integral]):
    """Integrals of some quantities over some targets, a row for each; ``remarks`` are sentences on them."""

    def __init__(self, rows: Sequence[Integral], remarks: Sequence[str] = ()) -> None:
        self._rows, self.remarks = tuple(rows), tuple(remarks)

    def __len__(self) -> int:
        return len(self._rows)

    @overload
    def __getitem__(self, which: int) -> Integral: ...
    @overload
    def __getitem__(self, which: slice) -> Sequence[Integral]: ...
    def __getitem__(self, which: int | slice) -> Integral | Sequence[Integral]:
        return self._rows[which]

    def of(self, integrand: str, over: str | None = None) -> Integral:
        """The integral of a quantity over a target, the last row of the quantity where none is given: the total."""
        found = [row for row in self if row.integrand == integrand and over in (None, row.over)]
        if not found:
            known = ", ".join(f"{row.integrand} over {row.over}" for row in self)
            raise KeyError(f"there is no integral of {integrand!r} over {over!r}; there are {known}")
        return found[-1]

    @property
    def value(self) -> float:
        """The value of the only quantity, over several targets their total.

        Raises
        ------
        ElvisError
            If there are several quantities, such as the components of a force: see `of`.
        """
        names = list(dict.fromkeys(row.integrand for row in self))
        if len(names) > 1:
            raise ElvisError(f"expected one quantity, found {', '.join(names)}; take one by of({names[0]!r}).value")
        return self._rows[-1].value

    def __float__(self) -> float:
        return self.value

    @property
    def every(self) -> Sequence[Integral]:
        """All integrals in the rows."""
        return self._rows

    def facts(self) -> list[dict[str, Any]]:
        """Plain data of each row."""
        return [row.facts() for row in self]

    @property
    def headers(self) -> tuple[str, ...]:
        """Headers of the cells."""
        return HEADERS

    def columns(self) -> Columns:
        """A column of each fact, for files."""
        facts = self.facts()
        numbers = [{name: np.nan if fact is None else fact for name, fact in row.items()} for row in facts]
        return {name: np.array([row[name] for row in numbers]) for name in numbers[0]}

    def cells(self) -> list[tuple[str, ...]]:
        """The cells of a table: over, integrand, value, error, measure."""
        return [(r.over, r.integrand, f"{r.value:.15g}", _error(r), f"{r.measure:.10g}") for r in self]

    def __repr__(self) -> str:
        return "\n".join(aligned([self.headers, *self.cells()], len(self.headers) * [False]))


class IntegralsOfTwoOrders(Integrals):
    """Integrals of fields, each next to the one of the fields without their highest modes.

    label  the order of the latter in words
    """

    def __init__(self, whole: Integrals, less: Integrals, label: str) -> None:
        super().__init__(whole, tuple(dict.fromkeys((*whole.remarks, *less.remarks))))
        self.less, self.label = less, label

    @property
    def every(self) -> Sequence[Integral]:
        """All integrals in the rows."""
        return (*self, *self.less)

    def facts(self) -> list[dict[str, Any]]:
        """Plain data of each row, with the value without the highest modes, its error, and the difference."""
        rows = zip(super().facts(), self, self.less, strict=True)
        return [
            {
                **facts,
                "value_without_top_modes": less.value,
                "error_without_top_modes": less.error,
                "difference": own.value - less.value,
            }
            for facts, own, less in rows
        ]

    @property
    def headers(self) -> tuple[str, ...]:
        """Headers of the cells."""
        return (*super().headers, self.label, "difference")

    def cells(self) -> list[tuple[str, ...]]:
        """Cells of a table: the row of the fields, the value without the highest modes, and the difference."""
        rows = zip(super().cells(), self, self.less, strict=True)
        return [(*cells, f"{less.value:.15g}", f"{own.value - less.value:.4g}") for cells, own, less in rows]


#: headers of the columns of a table
HEADERS = ("over", "integrand", "value", "error", "measure")


def _error(row: Integral) -> str:
    """The error, with a note unless it is a bound below the requested error."""
    words = {EXACT: ["rounding"], BOUND: [], ESTIMATE: ["estimate"]}[row.kind]
    words = words if row.finished else [*words, "unfinished"]
    return rounded_up(row.error) + (f" ({', '.join(words)})" if words else "")


def comes_apart(
    dataset: Dataset,
    field: Sequence[str],
    over: Sequence[str],
    coefficients: str | None = None,
    clip: str | None = None,
    ranks: Ranks = ALONE,
) -> bool:
    """Whether integrals are sums of integrals over the ranks' parts of a dataset.

    This is not the case for quantities that depend on elements farther away than parts borrow; for isosurfaces, which
    are moved according to jumps of fields; along curves; on planes through the middle of the data; and on boundaries
    inside the data, where one of two elements represents a side.
    dataset  data of a rank; the result covers all ranks.  All else as in `integrate`
    """
    if any(is_line(name) or name.startswith(ELEMENT) or needs_box(name) for name in (*over, clip or DOMAIN)):
        return False
    wanted = evaluated(dataset, field, coefficients)
    levels = [level for name in over if (level := Level.parse(dataset, name)) is not None]
    levels += [] if clip is None else [Level.clip(dataset, clip)]
    is_local = all(each.is_borrowed for each in wanted)
    parts = [each for own in levels for each in own.expressions]
    is_local = is_local and all(each.is_local and not each.fields for each in parts)
    return all(ranks.exchange(is_local and has_outer_boundaries(dataset, over), repr((field, over))))


def evaluated(dataset: Dataset, field: Sequence[str], coefficients: str | None = None) -> list[Expression]:
    """The integrands, except along curves; arguments as in `integrate`."""
    wanted = integrands(dataset, field)
    wanted += _coefficients(dataset, coefficients)
    return [each.expression for each in wanted]


def _coefficients(dataset: Dataset, text: str | None) -> list[Integrand]:
    """Coefficients of forces, none for None."""
    if text is None:
        return []
    names = Names.of(dataset)
    return list(Coefficients.parse(text, names).integrands(names))


def integrate(
    dataset: Dataset,
    field: str | Sequence[str],
    over: str | Sequence[str] = DOMAIN,
    error: float = ERROR,
    coefficients: str | None = None,
    clip: str | None = None,
    progress: Progress | None = None,
    ranks: Ranks = ALONE,
    reached: Callable[[float], object] | None = None,
    best_effort: bool = False,
    jacobian: str = ABSOLUTE,
    copy: Isometry | None = None,
) -> Integrals:
    """Integrals of quantities over the domain, regions and boundaries of a dataset.

    field  quantities: fields, expressions (on boundaries with the outward normal ``nx``, ``ny``, ``nz``), predefined
           ones, ``area``, ``volume``, ``length``, ``force``, ``moment``, ``average(f)``
    over   targets: ``domain``, ``region:NAME``, a boundary by name or number, ``all`` outer faces, ``element:ID`` (the
           faces of an element), ``plane:POINT:NORMAL``, ``sphere:CENTRE:RADIUS``, ``cylinder:POINT:AXIS:RADIUS``,
           ``EXPRESSION=VALUE`` (an isosurface), with normals towards larger values, and curves (see `curves`), such as
           ``line:0,0,0:1,0,0``; ``section:NAME:plane:POINT:NORMAL``, the cut of a plane with a boundary, on which
           forces, moments and coefficients are per unit of length along the plane's normal
    error  requested if no rule is exact for an integrand, relative to the integral of its absolute value
    coefficients  ``"rho,u,area,axis"``, or ``"axis"`` if reference values provide the others: adds drag, lift and
                  moment coefficients (see `Coefficients`)
    clip   one of these surfaces, whose inside is cut out of the domain or of regions; with the prefix ``outside:`` its
           outside
    progress  receives the number of points evaluated, and the number planned
    ranks  share the elements, or have parts of them for which `comes_apart` is true.  Sums then differ by rounding, and
           requested errors apply to each share; all ranks but the first return no rows
    reached  receives the largest relative error while boxes are refined
    best_effort  whether an interrupt ends the refinement and returns the current result, with ``finished`` False
    jacobian  ``absolute``: elements count with |J|; ``signed``: with J, as in MFEM and VTK, so that inverted parts are
           negative volumes, and rules are exact on elements that fold as well
    copy   of the data whose quantities are integrated
    Rows go by target, then by quantity; if a name matches several boundaries, or there are several names, the total
    comes last.  Raises ElvisError for unknown names, and if no element has the fields.

    >>> ds = elvis.read("wing.xml", "wing.fld")
    >>> force = elvis.integrate(ds, "p*nx", over="wing")
    >>> round(force[0].value, 9)
    -0.120745993
    """
    names = [over] if isinstance(over, str) else list(dict.fromkeys(over))
    lines = LineTargets.of(dataset, names)
    wanted = integrands(dataset, [field] if isinstance(field, str) else list(field), lines.end(names))
    wanted += _coefficients(dataset, coefficients)
    wanted = wanted if copy is None else _on_copy(dataset, wanted, copy)
    if not wanted or not names or not 0 < error < 1:
        raise ElvisError(f"expected a quantity, a target and an error between 0 and 1, found {field}, {over}, {error}")
    if DOMAIN in names and dataset.mesh.excerpt is None and not len(dataset.mesh.domain_ids()):
        raise ElvisError("expected elements of the domain, found none")
    others = [name for name in names if name not in lines]
    levels = {name: level for name in others if (level := Level.parse(dataset, name)) is not None}
    part = None if clip is None else Level.clip(dataset, clip)
    _check_jacobian(jacobian, bool(levels or lines or part), wanted)
    further = [
        *_span(dataset),
        *(each for level in [*levels.values(), *([part] if part else [])] for each in level.expressions),
    ]
    evaluator = Evaluator(dataset, [*(each.expression for each in wanted), *further])
    task = repr(([each.text for each in wanted], names, error, clip))
    parts = ALONE if dataset.mesh.excerpt is None else ranks
    places = Places(dataset, evaluator.patches, {}, lines.pieces(dataset, evaluator, wanted), parts)
    levels = {name: level.known(evaluator, parts, places.sides) for name, level in levels.items()}
    part = part and part.known(evaluator, parts)
    places = replace(places, levels=levels)
    expressions = [each.expression for each in wanted]
    options = (progress, reached, best_effort, jacobian == SIGNED)
    summation = Summation(dataset, evaluator, expressions, error, (), None, *options)
    targets = places.together([places.clipped(name, part) if part else places.named(name) for name in names])
    terms = ConversionTerms(dataset, evaluator, expressions)
    rows = list(_sums(targets, places, wanted, (summation, terms), ranks, task))
    is_finished = not any(ranks.exchange(summation.is_unfinished, "finished")) if best_effort else True
    found = [each for name, sums in rows for each in _rows(name, wanted, sums, is_finished)]
    notes = [*_notes(wanted), *([] if coefficients is None else assumption(coefficients, Names.of(dataset)))]
    return Integrals(found, [*notes, *_remarks(rows, wanted, error), *_lost(rows, wanted, terms)])


def moved_integrands(
    dataset: Dataset, fields: Sequence[str], coefficients: str | None, copy: Isometry
) -> list[Integrand]:
    """The integrands of a copy of the data, as those of the data."""
    return _on_copy(dataset, [*integrands(dataset, list(fields)), *_coefficients(dataset, coefficients)], copy)


def _on_copy(dataset: Dataset, wanted: Sequence[Integrand], copy: Isometry) -> list[Integrand]:
    names = Names.of(dataset)
    return [replace(each, expression=moved(each.expression, copy, names)) for each in wanted]


def _check_jacobian(jacobian: str, is_cut: bool, wanted: Sequence[Integrand]) -> None:
    """Raise ElvisError for an unknown measure, and if a signed one is used for parts of elements or averages."""
    if jacobian not in JACOBIANS:
        raise ElvisError(f"expected a Jacobian that is {' or '.join(JACOBIANS)}, found {jacobian!r}")
    if jacobian == SIGNED and is_cut:
        raise ElvisError("a signed Jacobian is for integrals over the domain or regions, without surfaces and curves")
    if jacobian == SIGNED and any(each.is_average for each in wanted):
        raise ElvisError("averages have no signed Jacobian: divide the integrals of a quantity and of volume")


def _span(dataset: Dataset) -> list[Expression]:
    """A field with homogeneous directions, if there is one: without it the elements would have none."""
    found = (one for one in dataset.solution for block in one.blocks if block.expansion.homogeneous)
    return [Expression.of(dataset, one.name) for one in found][:1]


def _sums(
    targets: Targets,
    places: Places,
    wanted: Sequence[Integrand],
    work: tuple[Summation, ConversionTerms],
    ranks: Ranks,
    task: str,
) -> Iterator[tuple[str, Sums]]:
    """Name and integrals of each row; none but at the first rank."""
    every = [*targets.rows, *([targets.total] if targets.total else [])]
    for integrand in wanted:
        for target in every:
            integrand.check(target.name, target.pieces)
    (is_own,) = places.somewhere([targets.total is not None and overlap(targets.rows, targets.total)])
    taken = every if is_own else targets.rows
    summation, terms = work
    own = [_with_terms(places.shared(target.pieces, ranks), summation, terms) for target in taken]
    parts = ranks.gather(own, task)
    if parts:
        sums = [sum(some, Sums.none(len(wanted))) for some in zip(*parts, strict=True)]
        if targets.total is not None and not is_own:
            sums.append(sum(sums, Sums.none(len(wanted))))
        yield from zip((target.name for target in every), sums, strict=True)


def _with_terms(pieces: Sequence[Part], summation: Summation, terms: ConversionTerms) -> Sums:
    """The integrals over pieces, with what a conversion may have lost of them."""
    return replace(summation.over(pieces), converted=terms.over(pieces))


def _rows(name: str, wanted: Sequence[Integrand], sums: Sums, is_finished: bool) -> Iterator[Integral]:
    for number, each in enumerate(wanted):
        value, error, measure = (float(column[number]) for column in (sums.value, sums.error, sums.measure))
        lost = float(sums.converted[number])
        error += lost if np.isfinite(lost) else 0.0
        if each.is_average:
            value, error = (value / measure, error / measure) if measure else (np.nan, np.nan)
        # errors of conversions are measured at points, so that what includes them is an estimate
        exact = bool(sums.is_exact[number]) and not lost
        kind = EXACT if exact else BOUND if sums.is_bound[number] and not lost else ESTIMATE
        yield Integral(name, each.text, value, error, measure, exact, kind, bool(sums.is_exact[number]) or is_finished)


def _notes(wanted: Sequence[Integrand]) -> Iterator[str]:
    """A message about forces with an unknown contribution."""
    forces = [each.text for each in wanted if each.text.startswith(("force_", "moment_")) and not each.expression.order]
    if forces:
        verb = "include" if len(forces) > 1 else "includes"
        yield f"no viscosity is known, so {', '.join(forces)} {verb} only the pressure; pass --set mu=…"


def _lost(rows: Sequence[tuple[str, Sums]], wanted: Sequence[Integrand], terms: ConversionTerms) -> Iterator[str]:
    """A message about integrals whose errors don't include the errors of the data's conversion."""
    numbers = [number for _, sums in rows for number in np.flatnonzero(np.isinf(sums.converted)).tolist()]
    if numbers:
        texts = ", ".join(dict.fromkeys(wanted[number].text for number in numbers))
        yield f"the errors of {texts} do not include those of the conversion: {terms.errors.sentence()}"


def _remarks(rows: Sequence[tuple[str, Sums]], wanted: Sequence[Integrand], error: float) -> Iterator[str]:
    """Messages about integrals that miss the request."""
    for name, sums in rows:
        for number, each in enumerate(wanted):
            place = sums.places.get(number)
            where = "" if place is None else ", ".join(f"{x:.6g}" for x in place)
            if sums.beyond[number] > 0:
                part = sums.beyond[number] / (sums.beyond[number] + sums.measure[number])
                yield f"{each.text} has no value on {part:.3g} of {name}, as at {where}: it is integrated over the rest"
            elif place is not None:
                yield f"{each.text} has no value in {name} at {where}, so its integral has none"
            elif sums.error[number] - sums.rounding[number] > 2 * error * sums.magnitude[number]:
                word = "is only known" if sums.is_bound[number] else "is estimated to be known only"
                yield f"{each.text} over {name} {word} {_precision(sums, number)}, {error:g} was requested"


def _precision(sums: Sums, number: int) -> str:
    """Precision of an integral: relative to the integral of the absolute value, unless that may be zero."""
    own, magnitude = sums.error[number], sums.magnitude[number]
    return f"to {rounded_up(own / magnitude)} of its size" if magnitude > own else f"within {rounded_up(own)}"
