"""Arguments that several commands share, and how they become data."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps
from elvis.core.data.complex_fields import COMPLEX_HELP, PHASE_HELP, ComplexChoice
from elvis.core.data.moments import BETWEEN
from elvis.core.deformed.deformation import (
    DISPLACEMENT_HELP,
    GRADIENTS,
    GRADIENTS_HELP,
    HEIGHT_HELP,
    SCALE_HELP,
    Deformation,
)

if TYPE_CHECKING:
    from elvis.core.data.dataset import Dataset
    from elvis.core.quantities import Expression

Triple = tuple[float, float, float]

data_argument = click.argument("data", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="DATA...")
field_option = click.option(
    "--field",
    "-f",
    "quantities",
    multiple=True,
    metavar="EXPR",
    help="Field, expression such as sqrt(u^2+v^2) or d(v,x)-d(u,y), or predefined quantity.  Repeatable.",
)


named_field_option = click.option(
    "--field",
    "-f",
    "quantities",
    multiple=True,
    metavar="[NAME=]EXPR",
    help="Field, expression such as sqrt(u^2+v^2) or Cp=2*(p-1), or predefined quantity.  Repeatable.",
)


def named_expressions(texts: Iterable[str]) -> dict[str, str]:
    """Expressions by their names: of NAME=EXPR, else the texts themselves; raises ElvisError for a name used twice."""
    found = dict[str, str]()
    for text in texts:
        name, sign, rest = (part.strip() for part in text.partition("="))
        is_named = bool(sign) and name.isidentifier()
        label = name if is_named else text
        if label in found:
            raise ElvisError(f"--field: expected each name once, found {label!r} again")
        found[label] = rest if is_named else text
    return found


def names_option(text: str) -> Callable[[Any], Any]:
    """The option for names of fields of a command that takes no expressions; ``text`` is its help."""
    return click.option("--fields", "--field", "-f", "fields", metavar="NAMES", help=text)


json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON, with all digits of the numbers.")


top_modes_option = click.option(
    "--without-top-modes",
    is_flag=True,
    help="Also compute with the fields without their highest modes (one order less), and the difference.",
)


plugin_option = click.option(
    "--plugin", metavar="NAME|FILE.py", help="Runtime plugin that opens DATA; a file may also define a converter."
)


#: storage key of the field names for the option ``reader``
_FIELDS = "elvis.fields"


def _keep_fields(context: click.Context, _: click.Parameter, names: str | None) -> None:
    context.meta[_FIELDS] = names


def with_fields(context: click.Context, _: click.Parameter, reader: tuple[str, ...]) -> tuple[str, ...]:
    """The options of a reader, including the option ``fields``."""
    names = context.meta.get(_FIELDS)
    return reader if names is None else (*reader, f"fields={names}")


#: declaration of the option for `with_fields`
FIELDS_DECLARATION: dict[str, Any] = {
    "metavar": "NAMES",
    "help": "Fields to read, separated by commas.  [default: all]",
    "is_eager": True,
    "expose_value": False,
    "callback": _keep_fields,
}

_reader_option = click.option(
    "--reader",
    multiple=True,
    metavar="NAME=VALUE",
    callback=with_fields,
    help="Option of the converter that reads DATA (see elvis convert --help), such as step=3; from=NAME chooses the "
    "converter.  Repeatable.",
)


def reader_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options ``reader`` and ``fields``, both as texts of the first."""
    return _reader_option(click.option("--fields", **FIELDS_DECLARATION)(command))


def reader_and_names_option(command: Callable[..., Any]) -> Callable[..., Any]:
    """The same of a command that takes no expressions, in which ``--field`` and ``-f`` also name fields."""
    return _reader_option(click.option("--fields", "--field", "-f", **FIELDS_DECLARATION)(command))


step_option = click.option("--step", type=int, help="Step of a series, counted from 0, or from the end if negative.")


time_option = click.option(
    "--time", type=float, help="Time in a series; for other data, the value of t in expressions."
)


between_option = click.option(
    "--between",
    type=click.Choice(BETWEEN),
    default=BETWEEN[0],
    show_default=True,
    help="Data between the steps of a series: coefficients interpolated from two steps (linear) or four (cubic), or "
    "the nearest step.",
)


other_option = click.option(
    "--other",
    "others",
    multiple=True,
    metavar="NAME=FILE,…",
    help="Another solution for use in expressions, on any mesh, of any order and format: with ref=b.xml,b.fld, "
    "p - ref:p is a quantity.  Repeatable.",
)


def _reference(context: click.Context, parameter: click.Parameter, texts: tuple[str, ...]) -> dict[str, float]:
    """Reference values by name; BadParameter for others."""
    from elvis.core.quantities.reference_values import reference_in

    try:
        return reference_in(texts)
    except ElvisError as error:
        raise click.BadParameter(str(error).removeprefix("--set: "), context, parameter) from error


set_option = click.option(
    "--set",
    "reference",
    multiple=True,
    metavar="NAME=VALUE",
    callback=_reference,
    help="Reference value of the flow for quantities, expressions and coefficients: mu, nu, density, gamma, R, Pr, "
    "conductivity, dt, rho_ref, u_ref, p_ref, x_ref, y_ref, z_ref, length, area.  Several may follow one another.  "
    "[default: from NAME.elvis.toml next to the data, else as written by the solver]",
)


def complex_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options of complex fields, which together are the parameter ``complexes``."""

    @click.option("--complex", "named", multiple=True, metavar="E=RE,IM", help=f"{COMPLEX_HELP}  Repeatable.")
    @click.option("--phase", type=float, metavar="DEGREES", help=PHASE_HELP)
    @wraps(command)
    def parsed(named: tuple[str, ...], phase: float | None, **rest: Any) -> Any:
        return command(complexes=ComplexChoice(named, phase), **rest)

    return parsed


def deform_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """The options of a deformed geometry, which together are the parameter ``deformation``."""

    @click.option("--deform", metavar="U,V,W|VECTOR", help=DISPLACEMENT_HELP)
    @click.option("--height", metavar="EXPR", help=HEIGHT_HELP)
    @click.option("--scale", type=float, help=f"{SCALE_HELP}  [default: 1]")
    @click.option("--gradients", type=click.Choice(GRADIENTS), help=f"{GRADIENTS_HELP}  [default: {GRADIENTS[0]}]")
    @wraps(command)
    def parsed(deform: str | None, height: str | None, scale: float | None, gradients: str | None, **rest: Any) -> Any:
        return command(deformation=_deformation(deform, height, scale, gradients), **rest)

    return parsed


def _deformation(
    displacement: str | None, height: str | None, scale: float | None, gradients: str | None
) -> Deformation | None:
    """Deformation by the options; UsageError if they lack a displacement."""
    if displacement is not None or height is not None:
        factor = 1.0 if scale is None else scale
        return Deformation(displacement or "", factor, gradients or GRADIENTS[0], height or "")
    if scale is not None or gradients is not None:
        given = "--scale" if scale is not None else "--gradients"
        raise click.UsageError(f"expected --deform or --height with {given}", click.get_current_context())
    return None


cache_option = click.option("--no-cache", is_flag=True, help="Convert DATA again, and don't cache the result.")


overwrite_option = click.option(
    "--overwrite",
    is_flag=True,
    help="Allow outputs to replace inputs, and files named in a scene file that ElVis did not write.",
)


workers_option = click.option(
    "--workers",
    type=click.IntRange(1, 1000),
    default=1,
    show_default=True,
    help="Number of worker processes, run in parallel with Dask.",
)


scheduler_option = click.option(
    "--scheduler",
    default="",
    metavar="ADDRESS",
    help="Use the workers of this Dask scheduler instead of processes on this machine; they must see the same files.",
)


def inputs(data: Iterable[Path], plugin: str | None = None, points: str | None = None) -> list[Path]:
    """All files that a command reads: data, the file of a plugin, a table of points."""
    found = list(data)
    if plugin is not None and plugin.endswith(".py"):
        found.append(Path(plugin))
    if points is not None and points != "-":
        found.append(Path(points))
    return found


class TextType(click.ParamType):  # type: ignore[type-arg]
    """The type of an option whose text is parsed by a function; errors of the function become usage errors."""

    def __init__(self, parse: Callable[[str], Any]) -> None:
        self.parse, self.name = parse, "text"

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """The value of the text."""
        try:
            return self.parse(value)
        except ElvisError as error:
            raise click.BadParameter(str(error), ctx, param) from error


def numbers(text: str, *counts: int) -> tuple[float, ...]:
    """``0,0.5,1``: as many finite numbers as one of ``counts`` says, any number of them where that is empty."""
    try:
        found = tuple(float(part) for part in text.split(","))
    except ValueError:
        found = ()
    if not found or (counts and len(found) not in counts) or not all(abs(number) < float("inf") for number in found):
        several = f"{' or '.join(map(str, counts))} numbers" if counts else "numbers"
        wanted = "a number" if counts == (1,) else f"{several} with commas between them"
        raise click.BadParameter(f"expected {wanted}, found {text!r}")
    return found


def evenly(text: str) -> tuple[float, float, int]:
    """``a:b:n``: n numbers from a to b."""
    first, last, count = numbers(text.replace(":", ","), 3)
    if count != int(count) or not 1 <= count <= 100_000:
        raise click.BadParameter(f"expected a whole number from 1 to 100000 after the second colon, found {count:g}")
    return first, last, int(count)


def _times(text: str) -> tuple[float, float, int] | str:
    """``all``, or ``a:b:n``: n times from a to b."""
    return text if text == "all" else evenly(text)


def times_option_for(purpose: str) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """The option ``--times`` with its help."""
    return click.option("--times", metavar="all|A:B:N", type=TextType(_times), help=purpose)


times_option = times_option_for("For a series: rows for every step, or for N times from A to B.")


def triples(text: str, count: int) -> tuple[Triple, ...]:
    """``0,0,0:1,0``: ``count`` triples; a third coordinate left out is zero."""
    parts = text.split(":")
    if len(parts) != count:
        expected = f"{count} points with colons between them" if count > 1 else "one point such as 0.5,0,0.1"
        raise click.BadParameter(f"expected {expected}, found {text!r}")
    padded = [(*numbers(part, 2, 3), 0.0) for part in parts]
    return tuple((p[0], p[1], p[2]) for p in padded)


def field_names(dataset: Dataset, wanted: str | None) -> tuple[str, ...]:
    """The names in ``wanted`` (commas between them), or all; raises ElvisError for one that the dataset lacks."""
    known = tuple(field.name for field in dataset.solution)
    names = known if wanted is None else tuple(name.strip() for name in wanted.split(","))
    for name in names:
        if name not in known:
            fields = f"the fields are {', '.join(known)}" if known else "the data contain no fields"
            raise ElvisError(f"there is no field {name!r}{perhaps(name, known)}; {fields}")
    return names


def expressions(dataset: Dataset, texts: Sequence[str] | None) -> tuple[Expression, ...]:
    """The quantities, or all fields for None; raises ElvisError for what names no quantity of the dataset."""
    from elvis.core.quantities import Expression, Names

    names = Names.of(dataset)
    return tuple(Expression.parse(text, names) for text in (names.fields if texts is None else texts))


def texts_of(wanted: str | None) -> list[str] | None:
    """The texts in ``wanted``, with commas between them; None if nothing is requested: all fields."""
    return None if wanted is None else _split(wanted)


def _split(text: str) -> list[str]:
    """The parts between commas that stand in no parentheses and no quotes."""
    parts, depth, quote = [""], 0, ""
    for character in text:
        quote = "" if character == quote else quote or (character if character in "\"'" else "")
        depth += 0 if quote else (character == "(") - (character == ")")
        if character == "," and not quote and depth <= 0:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts]
