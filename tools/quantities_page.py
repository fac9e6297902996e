"""Writes docs/quantities.md from the table of predefined quantities; `make pages` runs it."""

from __future__ import annotations

from pathlib import Path

from elvis.core.quantities.flows import CUSTOMARY
from elvis.core.quantities.predefined import PARAMETERS, QUANTITIES, STEPS, Parameter, PredefinedQuantity

DOCS = Path(__file__).parents[1] / "docs"
HEAD = """<!-- made by tools/quantities_page.py from the table in formats/elvis/core/quantities/predefined.py -->

# Predefined quantities

These names stand for expressions wherever a [quantity](../formats/README.md#quantities) is asked for: `--field
lambda2`, `--isosurface "swirl=2"`, `--field "wall_shear(mu=1e-3)"`, in scenes and in Python. Each is read as
the formula that is shown here, and evaluated as any other expression is, from the solver's own polynomials.
`elvis info DATA --quantities` lists those of a file, and what it lacks for the others. A field comes before the
quantity of its name.
"""
FIELDS = """
## Fields

In the formulas `u`, `v`, `w`, `rho`, … are the first fields that are there of these, or what is computed from
others. In two dimensions `w` and derivatives along z are nought; in quasi-3D data z is the direction of the
Fourier series.

| in formulas | names of fields | else |
|---|---|---|
"""
NUMBERS = """
## Parameters

Numbers that belong to a flow as a whole stand in parentheses after the quantity, in any order:
`mach(gamma=1.3)`, `pressure_coefficient(p_ref=0, u_ref=1)`. They may be expressions, such as Sutherland's law
or a field: `wall_shear(mu=mu_field)`. What is not given is taken from the metadata of the data (in any case of
letters); a quantity that then lacks one says which.

| parameter | meaning | metadata | else |
|---|---|---|---|
"""
TABLE = """
## Quantities

| quantity | dimensions | meaning | formula | source |
|---|---|---|---|---|
"""
PARTS = """
## Parts of formulas

What formulas are made of in addition. These names are known in formulas alone. Where there are several, the
first that the data suffice for is taken.

| part | formula |
|---|---|
"""
NOTES = """
## Walls

`wall_shear`, `skin_friction` and `y_plus` take the outward normal `nx`, `ny`, `nz` on sides of elements, faces
or in a plane edges, and the height `face_height` of the element above them, 1 / |grad l| with l from 0 on the
side to 1 at the far end of the reference element. So they have values on sides alone and are NaN elsewhere: ask
for them where `--faces` draws, or `elvis probe` at points of walls. They are the stress that the flow exerts on
the wall, from the side of the element in which a point is found; the pressure, and what dilatation adds to the
normal stress, do not count.

`y_plus` is the height of the element that stands on the wall, in wall units. With nodes inside, the first lies
at about `y_plus/order`. In a laminar sublayer, where the stress is that of the wall,
`distance(wall)*sqrt(tau/rho)/nu` is the y+ of any point; elsewhere the stress at the nearest wall is not known
to a point.

## Accuracy

Quantities that are polynomials of the fields and of their derivatives, such as `q_criterion` and the components
of vorticity and strain, are expanded exactly on straight elements. Eigenvalues are closed forms:

- `middle_eigenvalue(xx, yy, zz, xy, xz, yz)`, of a symmetric matrix, has an error of some units in the last
  place of the matrix's greatest entry, where eigenvalues are equal or nearly so too: its discriminant is a sum
  of squares. Plane flows without divergence have two equal ones everywhere. Where eigenvalues meet it has no
  derivative, `d(lambda2, x)` is NaN.
- `imaginary_root(a, b)`, of t^3 + a t + b, has a square with an error of some units in the last place of |a| +
  |b|^(2/3). Near zero half of the digits of the root are right, and a third of them where the flow is nearly
  pure shear: there, eigenvalues of the gradient are that sensitive to the gradient itself.

Both are functions that expressions may use.
"""


def page() -> str:
    """The text of docs/quantities.md."""
    fields = [f"| `{symbol}` | {_code(names)} | {_alternatives(symbol)} |" for symbol, names in CUSTOMARY.items()]
    numbers = [
        f"| `{name}` | {own.meaning} | {_code(own.keys)} | {_default(own)} |" for name, own in PARAMETERS.items()
    ]
    rows = [_row(own) for own in QUANTITIES]
    parts = [f"| `{name}` | {_code(own)} |" for name, own in STEPS.items() if name not in CUSTOMARY]
    chapters = ((TABLE, rows), (FIELDS, fields), (NUMBERS, numbers), (PARTS, parts))
    return HEAD + "".join(title + "\n".join(lines) + "\n" for title, lines in chapters) + NOTES


def _row(own: PredefinedQuantity) -> str:
    dimensions = ", ".join(map(str, own.dimensions))
    cells = (f"`{own.name}`", dimensions, _cell(own.meaning), _code(own.formulas), own.source)
    return f"| {' | '.join(cells)} |"


def _default(own: Parameter) -> str:
    return "must be given" if own.default is None else f"{own.default:g}"


def _alternatives(symbol: str) -> str:
    return _code(STEPS[symbol]) if symbol in STEPS else "-"


def _code(texts: tuple[str, ...]) -> str:
    return ", or ".join(f"`{_cell(text)}`" for text in texts) or "-"


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


if __name__ == "__main__":
    (DOCS / "quantities.md").write_text(page(), encoding="utf-8")
