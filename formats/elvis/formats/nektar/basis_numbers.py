"""Numbers of bases in HDF5 fields: those of today, and those of before March 2017 (format notes 12).

The two bases that pyramids got then, 7 and 8, moved all that came after them by two.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence

from elvis.core.errors import FormatError
from elvis.core.polynomials.bases import Basis
from elvis.core.shapes import Shape
from elvis.formats.nektar.counts import check_bases

FOURIER = frozenset({Basis.FOURIER, Basis.FOURIER_SINGLE_MODE, Basis.FOURIER_HALF_MODE_RE, Basis.FOURIER_HALF_MODE_IM})

Numbering = Mapping[int, Basis]

TODAY: Numbering = {int(basis): basis for basis in Basis}
_PYRAMIDS = (Basis.ORTHO_PYR_C, Basis.MODIFIED_PYR_C)
BEFORE: Numbering = dict(enumerate(basis for basis in Basis if basis not in _PYRAMIDS))

#: the last version whose numbers are those of before
_LAST = (4, 4)


def numbering(definitions: Iterable[tuple[Sequence[object], Shape]], version: str = "") -> Numbering:
    """What the numbers of a file mean: today's, unless they make sense of before alone, or the program is that old.

    definitions  the numbers of each section and its shape; those beyond the shape's dimension are of Fourier directions
    version      of the program that wrote the file, empty where the file doesn't say
    """
    known = list(definitions)
    fit_today, fit_before = (all(_fits(codes, shape, each) for codes, shape in known) for each in (TODAY, BEFORE))
    return BEFORE if fit_before and (not fit_today or _is_before(version)) else TODAY


def _fits(codes: Sequence[object], shape: Shape, meaning: Numbering) -> bool:
    """Whether a section could have these bases."""
    if not all(isinstance(code, int) and code in meaning for code in codes):
        return False
    bases = tuple(meaning[code] for code in codes if isinstance(code, int))
    try:
        check_bases(shape, bases[: shape.dimension])
    except FormatError:
        return False
    return FOURIER.issuperset(bases[shape.dimension :])


def _is_before(version: str) -> bool:
    found = re.match(r"\s*(\d+)\.(\d+)", version)
    return found is not None and (int(found[1]), int(found[2])) <= _LAST
