"""``elvis integrate``: forces, fluxes, areas, averages."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from elvis.core.base.ranks import ALONE, Ranks, is_idle
from elvis.core.base.rounded_up import rounded_up
from elvis.core.data.arguments import field_option, json_option, overwrite_option, times_option, top_modes_option
from elvis.plugins.command.running import shared
from elvis.renderer.commands.outputs import check_outputs
from elvis.renderer.commands.sources import Data, NativeSource, data_options, native_source, or_alone
from elvis.renderer.commands.with_copies import copies_options

if TYPE_CHECKING:
    from elvis.core.base.terminal import Progress
    from elvis.core.data.dataset import Dataset
    from elvis.core.files.columns import Columns
    from elvis.core.integrals import Integrals
    from elvis.renderer.commands.sources import Source
    from elvis.scene.model.copies import Copies

EPILOG = """\b
Examples:
  elvis integrate wing.xml wing.fld --field force --over wing
  elvis integrate wing.xml wing.fld --field "p*nx" --field area --over all --json
  elvis integrate duct.xml duct.fld --field flux --over inlet --over outlet -o flux.csv
  elvis integrate duct.xml duct.fld --field volume --field "average(p)"
  elvis integrate wing.xml wing.fld --coefficients 1.2,30,0.5,x --over wing
  elvis integrate duct.xml duct.fld --field volume --clip sphere:0.5,0.5,0.5:0.3
  elvis integrate wing.xml wing.fld --field force --over section:wing:plane:0,0.5,0:0,1,0
  elvis integrate wing.xml wing_*.chk --field force --over wing --times all --plot force.png
  elvis integrate duct.xml duct.fld --field flux --over plane:0,0,0.5:0,0,1
  elvis integrate duct.xml duct.fld --field p --field speed --histogram 64 --plot shares.png -o shares.csv
"""


@click.command("integrate", epilog=EPILOG, short_help="Integrate quantities: forces, fluxes, areas, averages.")
@field_option
@click.option(
    "--over",
    multiple=True,
    metavar="WHAT",
    default=("domain",),
    help="Where to integrate: domain, region:NAME, a boundary by name or number, all (outer faces, one row per "
    "boundary), element:ID (its faces), a plane, sphere, cylinder, isosurface QUANTITY=VALUE or curve (see elvis help "
    "geometry).  On section:BOUNDARY:plane:P:N forces, moments and coefficients are per unit of span.  Repeatable.  "
    "[default: domain]",
)
@click.option(
    "--error",
    type=float,
    default=1e-6,
    show_default=True,
    help="Requested error if no rule is exact, relative to the integral of the absolute value.",
)
@click.option(
    "--best-effort",
    is_flag=True,
    help="On Ctrl-C, stop and write the results so far, marked as unfinished; the exit status is 130.",
)
@click.option(
    "--coefficients",
    metavar="[RHO,U,AREA,]AXIS[,LENGTH[,X,Y,Z]]",
    help="Also compute drag, lift and moment coefficients of walls, from a reference density, speed and area and, for "
    "moments, a reference length and point.  AXIS is the flow axis (x), flow and lift axes (xy), or both with an angle "
    "of attack in degrees (xy:4).  With only AXIS, the values are rho_ref, u_ref, area, length, x_ref, y_ref, z_ref.",
)
@click.option(
    "--clip",
    metavar="SURFACE",
    help="Exclude from the domain or regions the inside of a plane, sphere or cylinder (see elvis help geometry), or "
    "the part where QUANTITY=VALUE is below the value; outside:SURFACE excludes the outside.",
)
@click.option(
    "--jacobian",
    type=click.Choice(["absolute", "signed"]),
    default="absolute",
    show_default=True,
    help="Weight with |J|, or with J, which is negative where elements are inverted or folded (as in MFEM and VTK).",
)
@click.option(
    "--histogram",
    "bins",
    type=click.IntRange(1, 100_000),
    metavar="BINS",
    help="Histogram of each quantity in even bins, weighted by volume at quadrature points.",
)
@top_modes_option
@times_option
@click.option(
    "--plot",
    type=click.Path(path_type=Path),
    help="Plot the values over --times, or the --histogram, as .png, .svg or .pdf; without -o no table is printed.",
)
@json_option
@click.option("-o", "--output", type=click.Path(path_type=Path), help="File to write, .csv, .npz or .parquet.")
@overwrite_option
@copies_options
@data_options
@shared
def integrate(
    data: Data,
    ranks: Ranks,
    quantities: tuple[str, ...],
    over: tuple[str, ...],
    error: float,
    best_effort: bool,
    coefficients: str | None,
    clip: str | None,
    jacobian: str,
    bins: int | None,
    without_top_modes: bool,
    times: tuple[float, float, int] | str | None,
    plot: Path | None,
    as_json: bool,
    output: Path | None,
    overwrite: bool,
    copies: Copies | None,
) -> None:
    """Integrate quantities over the domain, regions, boundaries, surfaces and curves, with the elements' own map.

    The rule is exact if a quantity is a polynomial on the elements, or becomes one with the map's derivatives, as p*nx
    does on curved faces and a divergence in curved elements. Otherwise elements are subdivided until a bound of the
    error is below --error. Each value has an error bound, or an estimate where no bound exists. nx, ny, nz are the
    normal: outward on boundaries, as given on planes, towards greater values on isosurfaces. Further quantities are
    area, volume, length, average(EXPR), and the vectors force, pressure_force, viscous_force and moment; for 2D data
    they are per unit of span.
    """
    if not quantities and coefficients is None:
        is_read = any(text.startswith("fields=") for text in data.reader)
        hint = "; --fields only chooses what is read" if is_read else ""
        raise click.UsageError(f"expected --field, the integrand, or --coefficients{hint}", click.get_current_context())
    if not 0 < error < 1:
        raise click.BadParameter(f"expected a number between 0 and 1, found {error:g}", param_hint="'--error'")
    if without_top_modes and (bins is not None or plot is not None):
        text = "--without-top-modes: expected no --histogram and no --plot"
        raise click.UsageError(text, click.get_current_context())
    if plot is not None and times is None and bins is None:
        raise click.UsageError("expected --plot with --times or --histogram", click.get_current_context())
    check_outputs(output, plot, data.inputs(), overwrite)
    if copies is not None:
        data = replace(data, is_copied=True)
        if bins is not None or without_top_modes:
            text = "--with-copies: expected no --histogram and no --without-top-modes"
            raise click.UsageError(text, click.get_current_context())
        if is_idle(ranks):
            return
        ranks = ALONE
    if bins is not None:
        if is_idle(ranks):
            return
        _check_histogram(quantities, over, coefficients, clip, times)
        _histogram(data, quantities, bins, plot, as_json, output)
        return

    def integrals(source: Source, progress: Progress | None = None) -> Integrals:
        own = ALONE if times is not None and isinstance(source, NativeSource) and source.portion is None else ranks
        work = (progress, own, reporter(), best_effort, jacobian)
        if copies is not None:
            return _over_copies(source, copies, quantities, over, error, coefficients, clip, *work)
        found = source.integrate(quantities, over, error, coefficients, clip, *work)
        if not without_top_modes:
            return found
        less = native_source(source, "--without-top-modes").without_top_modes()
        below = less.integrate(quantities, over, error, coefficients, clip, *work)
        return _of_two_orders(found, below, less.dataset)

    # surfaces, clips and coefficients may be made of other fields
    is_all = clip is None and coefficients is None and not any("=" in each for each in over)
    wanted = quantities if is_all else ()

    def is_sum(dataset: Dataset) -> bool:
        from elvis.core.integrals import comes_apart

        return comes_apart(dataset, quantities, over, coefficients, clip, ranks)

    found: _Moments | None
    if times is None:
        found = _of_one_state(lambda: data.shared(ranks, is_sum, wanted), integrals)
    else:
        found = or_alone(ranks, lambda own: _of_series(data, wanted, times, integrals, own, is_sum))
    if found is not None and not ranks.rank:
        _show(found, plot, output, as_json)
        if not _is_finished(found):
            raise SystemExit(INTERRUPTED)


def _over_copies(source: Source, copies: Copies, *asked: Any) -> Integrals:
    """Integrals over all copies of the data."""
    from elvis.core.integrals.copied_integrals import integrate_copies
    from elvis.renderer.commands.with_copies import isometries_of

    native, isometries = isometries_of(source, copies)
    quantities, over, *rest = asked
    return integrate_copies(native.dataset, quantities, over, isometries, *rest)


def _of_two_orders(whole: Integrals, less: Integrals, dataset: Dataset) -> Integrals:
    """Integrals next to those of the fields without their highest modes."""
    from elvis.core.integrals.integration import IntegralsOfTwoOrders
    from elvis.core.resolution.truncation import orders_below

    return IntegralsOfTwoOrders(whole, less, orders_below(dataset))


#: seconds after which a line reports the error reached, and between two such lines
REPORT_AFTER = 10.0


def reporter() -> Callable[[float], None]:
    """A function that receives relative errors and reports them on a terminal, the first after some seconds."""
    from time import monotonic

    from elvis.core.base.terminal import announce

    last = monotonic()

    def report(reached: float) -> None:
        nonlocal last
        if monotonic() - last >= REPORT_AFTER:
            last = monotonic()
            announce(f"error reached so far: {rounded_up(reached)} of the integral of the absolute value")

    return report


#: exit status of a shell's command that Ctrl-C ended
INTERRUPTED = 130


def _is_finished(found: _Moments) -> bool:
    """Whether no integral was interrupted."""
    return all(row.finished for _, own in found for row in own.every)


def _show(found: _Moments, plot: Path | None, output: Path | None, as_json: bool) -> None:
    """Write, plot or print integrals, with a warning for values that miss the requested error."""
    from elvis.core.base.terminal import print_json, print_table, warn
    from elvis.core.files.columns import write_columns

    for remark in dict.fromkeys(remark for _, own in found for remark in own.remarks):
        warn(remark)
    if not _is_finished(found):
        warn("interrupted: the errors are those reached so far")
    if plot is not None:
        _plot(plot, found)
    if output is not None:
        write_columns(output, _columns(found))
    elif as_json:
        print_json([{**time, **facts} for time, own in found for facts in own.facts()])
    elif plot is None:
        names = (*found[0][0], *found[0][1].headers)
        print_table(
            names, [(*(f"{t:.10g}" for t in time.values()), *row) for time, own in found for row in own.cells()]
        )


#: integrals with the time that they are of, without one where the data are one state
_Moments = list[tuple[dict[str, float], "Integrals"]]


def _check_histogram(
    quantities: Sequence[str],
    over: Sequence[str],
    coefficients: str | None,
    clip: str | None,
    times: tuple[float, float, int] | str | None,
) -> None:
    """UsageError if a histogram is requested with unsupported options."""
    if not quantities or coefficients is not None or clip is not None or times is not None or over != ("domain",):
        raise click.UsageError(
            "--histogram: expected --field, of one state and the whole domain, found also one of --over, --clip, "
            "--coefficients, --times, or no --field",
            click.get_current_context(),
        )


def _histogram(
    data: Data, quantities: Sequence[str], bins: int, plot: Path | None, as_json: bool, output: Path | None
) -> None:
    """Write, draw or print how much of the domain has values of quantities in bins."""
    import numpy as np

    from elvis.core.base.errors import ElvisError
    from elvis.core.base.terminal import note, print_json, print_table, stage
    from elvis.core.files.columns import write_columns
    from elvis.core.numbers.histogram import histogram

    source = data.source(quantities)
    dataset = source.dataset
    if dataset is None:
        raise ElvisError("--histogram: expected native or converted data, found those of a runtime plugin")
    with stage("counting"):
        found = {each.text: histogram(dataset, each, bins, _POINTS) for each in source.expressions(quantities)}
    for name, own in found.items():
        note(f"{name}: from {own.points} points on {own.elements} of {own.total} elements")
    if plot is not None:
        from elvis.scene.figure.time_plot import Bars

        Bars({name: (own.ends, own.shares) for name, own in found.items()}).save(plot)
    columns: Columns = {
        "quantity": np.repeat(list(found), bins),
        "low": np.concatenate([own.ends[:-1] for own in found.values()]),
        "high": np.concatenate([own.ends[1:] for own in found.values()]),
        "share": np.concatenate([own.shares for own in found.values()]),
    }
    rows = list(zip(*(own.tolist() for own in columns.values()), strict=True))
    if output is not None:
        write_columns(output, columns)
    elif as_json:
        print_json([dict(zip(columns, row, strict=True)) for row in rows])
    elif plot is None:
        print_table(
            tuple(columns), [(name, f"{low:.10g}", f"{high:.10g}", f"{share:.6g}") for name, low, high, share in rows]
        )


#: points that a histogram is made from, about
_POINTS = 1_000_000


def _of_one_state(opened: Callable[[], Source], integrals: Callable[[Source, Progress | None], Integrals]) -> _Moments:
    from elvis.core.base.terminal import progress

    source = opened()
    with progress("integrating") as report:
        return [({}, integrals(source, report))]


def _of_series(
    data: Data,
    wanted: Sequence[str],
    times: tuple[float, float, int] | str,
    integrals: Callable[[Source], Integrals],
    ranks: Ranks,
    is_sum: Callable[[Dataset], bool],
) -> _Moments:
    series, moments = data.moments(times, "integrating", wanted, ranks, is_sum)
    found: _Moments = []
    for time, source in moments:
        found.append(({"time": time}, integrals(source)))
        if not _is_finished(found):
            break
    data.tell_of(series, [own["time"] for own, _ in found])
    return found


def _columns(found: _Moments) -> Columns:
    """The table, with a column of times where there are several."""
    import numpy as np

    parts = [own.columns() for _, own in found]
    times = {name: np.repeat([time[name] for time, _ in found], [len(own) for _, own in found]) for name in found[0][0]}
    return {**times, **{name: np.concatenate([part[name] for part in parts]) for name in parts[0]}}


def _plot(path: Path, found: _Moments) -> None:
    """Plot a panel for each quantity, with a curve for each target."""
    import numpy as np

    from elvis.scene.figure.time_plot import Plot

    first = found[0][1]
    overs, names = (list(dict.fromkeys(getattr(row, key) for row in first)) for key in ("over", "integrand"))
    values = {name: np.array([[own.of(name, over).value for _, own in found] for over in overs]) for name in names}
    places = [f"over {over}" for over in overs]
    Plot(np.array([time["time"] for time, _ in found]), places, values).save(path)
