"""The conclusion in one or two sentences, and its numbers."""

from __future__ import annotations

from collections.abc import Sequence

from elvis.reference.line_study import LineStudy
from elvis.reference.report.words import count_of, percent, size, some
from elvis.reference.study import Rival, Study
from elvis.reference.tolerances import Check

#: a linear picture is correct if no contour is displaced by more than this many pixels, and at most this percentage of
#: the pixels differs by a colour step
PIXELS, PERCENT = 1.0, 0.1
#: pixels within which contours are the same
ROUNDING = 1e-6


def is_right(rival: Rival) -> bool:
    """Whether a picture is right to within one pixel and one step of colour."""
    found = rival.errors
    if found is None:
        return False
    if not found.pixels:
        return found.colors_off <= PERCENT
    strange = 100.0 * found.spurious / max(1, found.pixels)
    moved = found.contour_max or 0.0
    return found.off <= PERCENT and strange <= PERCENT and moved <= PIXELS and not found.lost


def conclusion(study: Study) -> str:
    """The conclusion from the numbers."""
    said = [_exactness(study)] if study.validation else []
    levels = [rival for rival in study.rivals if rival.level is not None]
    if levels:
        said.append(_linear(study, levels))
    elif study.rivals and study.rivals[0].errors is not None:
        said.append(f"{_upper(how_wrong(study.rivals[0]))}.")
    said += map(_lines, study.lines)
    return " ".join(said)


def _lines(own: LineStudy) -> str:
    """Errors of the ends of streamlines, ours and the finest of VTK's."""
    if own.ours.maximum is None:
        return f"No streamline of {own.name} was compared: {own.ours.skipped}."
    said = f"Streamlines of {own.name} end within {own.ours.maximum:.0e} of the box from their true ends"
    known = [other for other in own.others if other.level is not None and other.maximum is not None]
    return f"{said}; {known[-1].name}: {known[-1].maximum:.0e}." if known else f"{said}."


def _exactness(study: Study) -> str:
    """Whether the picture is exact, or where it is not."""
    assert study.validation is not None
    width, height = study.validation.size
    failed = [check for check in study.validation.checks if not check.passed]
    if not failed:
        doubt = study.validation.ambiguous
        aside = f" but for {count_of(doubt, 'ambiguous pixel')}" if doubt else ""
        return f"Exact: all {width * height:,} pixels are within every tolerance{aside}."
    return "Not exact: " + "; ".join(map(failure, failed)) + "."


def failure(check: Check) -> str:
    """A failed check in words, with its worst pixel."""
    words = f"{check.name} fails at {count_of(check.failed, 'pixel')}"
    if check.limit:
        words += f", off by up to {check.found:.2g} (tolerance {check.limit:.0e})"
    if check.worst is None:
        return words
    at = ", ".join(f"{x:.6g}" for x in check.worst.position)
    return (
        f"{words}, worst at column {check.worst.column}, row {check.worst.row}: element {check.worst.element}, ({at})"
    )


def _linear(study: Study, levels: Sequence[Rival]) -> str:
    """The refinement at which linear pictures are right, or the errors of the finest one and the cost of the next."""
    drawn = [rival for rival in levels if rival.errors is not None]
    first = next((rival for rival in drawn if is_right(rival)), None)
    skipped = [rival for rival in levels if rival.skipped]
    if first is not None:
        before = [rival for rival in drawn if (rival.level or 0) < (first.level or 0)]
        said = f"Linear elements are right to within one pixel after {first.name}"
        return f"{said}; after {before[-1].name} {how_wrong(before[-1])}." if before else f"{said}."
    if not drawn:
        fits = "is drawn" if "needed" not in skipped[0].counts else "fits into memory"
        return f"No linear picture {fits}: {_cost(skipped[0])}."
    said = f"Linear elements after {drawn[-1].name}: {how_wrong(drawn[-1])}"
    if skipped:
        return f"{said}; {_cost(skipped[0])}."
    if study.next is None:
        return f"{said}."
    return f"{said}; {count_of(study.next[0], 'refinement')} would need {size(study.next[1])}."


def _cost(rival: Rival) -> str:
    """Requirements of a skipped picture, or another reason for skipping it."""
    if "needed" not in rival.counts:
        return f"{rival.name} is skipped: {rival.skipped}"
    return f"{rival.name} would need {size(rival.counts['needed'])}"


def how_wrong(rival: Rival) -> str:
    """The errors of a picture in words."""
    found = rival.errors
    assert found is not None
    if not found.pixels:
        return f"{percent(found.colors_off)} of the pixels have colours off by more than {percent(1.0)}"
    said = []
    if found.lost:
        said.append(f"{count_of(found.lost, 'contour')} lost or invented")
    if found.contour_max and found.contour_max > ROUNDING:
        far = some(found.contour_max)
        said.append(f"contours off by up to {far} pixel{'s' * (far != '1')}")
    if found.off:
        said.append(f"{percent(found.off)} of the pixels off by more than one colour step")
    if found.missing + found.spurious:
        said.append(f"{count_of(found.missing + found.spurious, 'pixel')} missing or spurious")
    return ", ".join(said) or "the pictures are the same"


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]
