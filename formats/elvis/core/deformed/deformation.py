"""User settings of a deformation, shared by options, scene keys and Python arguments."""

from __future__ import annotations

from dataclasses import dataclass
from math import isfinite

from elvis.core.base.errors import ElvisError
from elvis.core.base.hints import perhaps

#: where derivatives of quantities are taken; the first is the default
GRADIENTS = ("undeformed", "deformed")

#: the sentences of options and keys
DISPLACEMENT_HELP = (
    "Draw and measure on the deformed geometry x + S d(x). The displacement d is given by its components (fields or "
    "polynomials of fields, separated by commas) or by the name of a vector field without its suffixes."
)
HEIGHT_HELP = "Draw and measure 2D data on the surface z = S u(x, y): a field u, or a polynomial of fields."
SCALE_HELP = "Factor S of the displacement."
GRADIENTS_HELP = "Configuration in which derivatives of quantities are taken on a deformed geometry."


@dataclass(frozen=True)
class Deformation:
    """A displacement, or the height of a surface over 2D data, its factor, and where derivatives are taken."""

    displacement: str = ""
    scale: float = 1.0
    gradients: str = GRADIENTS[0]
    height: str = ""

    def __post_init__(self) -> None:
        if self.displacement.strip() and self.height.strip():
            raise ElvisError("expected one of --deform and --height, found both")
        if not (self.displacement.strip() or self.height.strip()):
            raise ElvisError("--deform: expected the components of a displacement, such as u,v,w, found none")
        if not isfinite(self.scale):
            raise ElvisError(f"--scale: expected a finite number, found {self.scale:g}")
        if self.gradients not in GRADIENTS:
            known = f"{' or '.join(GRADIENTS)}, found {self.gradients!r}{perhaps(self.gradients, GRADIENTS)}"
            raise ElvisError(f"--gradients: expected {known}")
