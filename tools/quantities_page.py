"""Write docs/quantities.md from the table of predefined quantities; `make pages` runs it."""

from __future__ import annotations

from pathlib import Path

from elvis.core.quantities.flows import CUSTOMARY
from elvis.core.quantities.predefined import PARAMETERS, QUANTITIES, STEPS, Parameter, PredefinedQuantity

DOCS = Path(__file__).parents[1] / "docs"
HEAD = """<!-- made by tools/quantities_page.py from the table in formats/elvis/core/quantities/predefined.py -->

# Predefined quantities

These names stand for expressions. You can use them wherever ElVis expects a
[quantity](expressions.md): `--field lambda2`, `--isosurface "swirl=2"`,
`--field "wall_shear(mu=1e-3)"`, in scenes and in Python. ElVis replaces each name by the formula on
this page and evaluates it like any other expression, from the solver's own polynomials.
`elvis info DATA --quantities` lists the quantities of a file, and what is missing for the
others. A field takes precedence over a quantity of the same name.
"""
FIELDS = """
## Fields

In formulas, `u`, `v`, `w`, `rho`, … mean the first field in the second column that your data
contain. If they contain none, ElVis uses the formula in the last column. In two dimensions `w` and
derivatives along z are zero. In quasi-3D data z is the direction of the Fourier series.

| in formulas | names of fields | otherwise |
|---|---|---|
"""
NUMBERS = """
## Parameters

Write parameters of the flow in parentheses after the quantity, in any order: `mach(gamma=1.3)`,
`pressure_coefficient(p_ref=0, u_ref=1)`. A parameter may be an expression, such as Sutherland's
law, or a field: `wall_shear(mu=mu_field)`. For parameters that you omit, ElVis tries the [reference
values](howto/numbers.md#reference-values), then the metadata of the data (upper and lower case are
the same), then the default. If it finds none, an error names the parameter.

| parameter | meaning | metadata | default |
|---|---|---|---|
"""
TABLE = """
## Quantities

| quantity | dimensions | meaning | formula | source |
|---|---|---|---|---|
"""
PARTS = """
## Parts of formulas

These names exist only inside the formulas above; in your own expressions write `d(u,x)` instead of
`ux`. If a name has several formulas, ElVis uses the first one whose fields the data contain.

| part | formula |
|---|---|
"""
NOTES = """
## Walls

`wall_shear`, `skin_friction` and `y_plus` use two properties of the sides of elements (faces, or
edges in a plane):

- the outward normal `nx`, `ny`, `nz`,
- the height `face_height` of the element normal to the side: 1 / |grad l|, where l rises from 0 on
  the side to 1 at the opposite side or corner of the reference element.

These quantities therefore have values only on sides and are NaN elsewhere. Use them where `--faces`
draws, or with `elvis probe` at points of walls. The wall shear is the stress that the flow exerts
on the wall, evaluated in the element in which a point is found. The pressure, and the part of the
normal stress that comes from dilatation, are not included.

`y_plus` is the height of the element at the wall, in wall units. In an element with interior nodes,
the first node lies at about `y_plus/order`. Within the viscous sublayer, the stress equals the
stress at the wall, so `distance(wall)*sqrt(tau/rho)/nu` is y+ there, with `tau` an expression of
the local shear stress. Beyond it ElVis cannot compute y+, because it does not evaluate the stress
at the nearest point of the wall.

## Accuracy

On straight elements, quantities that are polynomials of fields and derivatives, such as
`q_criterion`, the vorticity and the strain rate, become exact polynomials. All others are evaluated
at each point, to rounding. Eigenvalues are computed in closed form:

- `middle_eigenvalue(xx, yy, zz, xy, xz, yz)` is the middle eigenvalue of a symmetric matrix. Its
  error is a few units in the last place of the largest matrix entry. This also holds if eigenvalues
  are equal or nearly equal, as the discriminant is computed as a sum of squares. Plane flows
  without divergence have two equal eigenvalues everywhere. The function has no derivative at points
  where eigenvalues coincide: `d(lambda2, x)` is NaN there.
- `imaginary_root(a, b)` is the imaginary part of the complex roots of t^3 + a t + b. The error of
  its square is a few units in the last place of |a| + |b|^(2/3). Near zero, only half of the digits
  of the root are correct, and only a third if the flow is nearly pure shear. This sensitivity is
  inherent in the eigenvalues of the gradient.

Both functions can be used in expressions.
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
