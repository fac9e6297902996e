"""The tables of a report."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from elvis.reference.line_study import LineStudy
from elvis.reference.report.words import count_of, size, some
from elvis.reference.study import Rival, Study
from elvis.reference.tolerances import Check
from elvis.scene import VolumeRendering

Table = dict[str, Any]
#: columns of errors that are there even where all are zero
ALWAYS = 7


def facts(study: Study, numbers: Mapping[str, Any]) -> list[tuple[str, list[tuple[str, str]]]]:
    """Descriptions of the scene and the data, in a few lines each."""
    if study.scene is None:
        return []
    return [("Scene", _scene(study)), ("Data", _data(study, numbers["data"] or {}))]


def _scene(study: Study) -> list[tuple[str, str]]:
    scene = study.scene
    assert scene is not None
    height, width = study.exact.shape
    low, high = study.ends
    shown = [_said(own, scene.field) for own in scene.every_object]
    clips = [f"{own.away} of {_said(own, scene.field)}" for own in scene.clip]
    return [
        ("field", scene.field),
        ("shown", "; ".join(shown)),
        *([("taken away", "; ".join(clips))] if clips else []),
        ("picture", f"{width} x {height} pixels, {int(study.exact.seen.sum()):,} of them show something"),
        ("colour range", f"{low:.6g} to {high:.6g}"),
        ("contours", ", ".join(f"{value:.4g}" for value in study.contours) or "none"),
    ]


def _said(shown: Any, field: str) -> str:
    """An object or a clip of a scene in words: its kind and parameters; ``field`` is the scene's field."""
    if isinstance(shown, VolumeRendering):
        return f"volume of {shown.quantity or field}"
    kind = type(shown).__name__
    inner = getattr(shown, "surface", None)
    if inner is not None:
        told = ", ".join(f"{key} {_value(value)}" for key, value in vars(inner).items())
        return f"{type(inner).__name__.lower()} ({told})"
    names = ("values", "select", "seeds", "points")
    values: Any = next((own for name in names if (own := getattr(shown, name, ()))), ())
    return f"{kind.lower()} {', '.join(map(_value, values))}"


def _value(value: Any) -> str:
    if isinstance(value, tuple):
        return " ".join(map(_value, value))
    return f"{value:g}" if isinstance(value, float) else str(value)


def _data(study: Study, data: Mapping[str, Any]) -> list[tuple[str, str]]:
    assert study.scene is not None
    elements = ", ".join(f"{count:,} {_name_of(shape, count)}" for shape, count in data["elements"].items())
    return [
        ("files", ", ".join(Path(name).name for name in study.scene.data) or "in memory"),
        ("elements", elements),
        ("degree of the field", _ends(data["degrees"])),
        ("degree of the map", _ends(data["map_degrees"])),
        ("coefficients", size(study.stored)),
    ]


def _name_of(shape: str, count: int) -> str:
    """The name of a shape, in the plural where there are several."""
    if count == 1:
        return shape
    return shape.replace("hedron", "hedra") if shape.endswith("hedron") else f"{shape}s"


def _ends(degrees: Sequence[int]) -> str:
    return " to ".join(str(degree) for degree in sorted(set(degrees))) or "unknown"


def every_table(study: Study) -> list[Table]:
    """Bars, errors, costs of the meshes, contours, isosurfaces; only tables with rows."""
    found = [_bars(study), _errors(study), _costs(study), _contours(study), _surfaces(study), _deviations(study)]
    found += [_lines(own) for own in study.lines]
    return [table for table in found if table["rows"]]


def _table(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]], words: str = "", wide: Any = ()) -> Table:
    return {"title": title, "heads": heads, "rows": rows, "words": words, "wide": wide}


def _errors(study: Study) -> Table:
    heads = [
        "picture",
        "maximum error, % of range",
        "mean, % of range",
        "pixels off, %",
        "missing pixels",
        "spurious pixels",
        "contours off by up to, pixels",
        "contours lost",
        "surface off by up to, % of size",
        "normals off by up to, °",
        "colours off by over 1 %, % of all pixels",
    ]
    rows: list[list[str]] = []
    for rival in study.rivals if any(own.errors for own in study.rivals) else ():
        found = rival.errors
        if found is None:
            rows.append([rival.name, *["–"] * (len(heads) - 1)])
            continue
        value, mean = some(100 * found.value_max), some(100 * found.value_mean)
        counts = [f"{found.missing:,}", f"{found.spurious:,}", some(found.contour_max), str(found.lost)]
        surface = [some(_visible(100 * found.position_max)), some(_visible(found.normal_max))]
        surface.append(some(found.colors_off))
        rows.append([rival.name, value, mean, some(found.off), *counts, *surface])

    # on a plane no surface can be off
    kept = [i for i in range(len(heads)) if i < ALWAYS or any(row[i] not in ("0", "–") for row in rows)]
    return _table("Errors", [heads[i] for i in kept], [[row[i] for i in kept] for row in rows])


def _visible(number: float) -> float:
    """The number, or zero if it is nothing but rounding."""
    return number if number > 1e-7 else 0.0


def _lines(study: LineStudy) -> Table:
    rows = []
    for own in (study.ours, *study.others):
        rows.append([own.name, own.skipped or some(own.maximum), some(own.median)])
    words = (
        f"{count_of(study.lines, 'line')}, the longest of length {study.length:.4g}: distances of their ends from those"
        " of lines that are followed with a tenth of the tolerance, relative to the diagonal of the box. VTK's lines "
        "come from its stream tracer, of order 4 and 5 with errors of 1e-9 of the box per step, and have the duration "
        "of the true line. In linear elements, whose corners have the exact position and velocity, the error comes "
        "from the mesh; in VTK's own cells, from the search for positions. VTK stores positions in single precision, "
        "about 1e-7."
    )
    return _table(f"Where streamlines end: {study.name}", ["elements", "maximum", "median"], rows, words)


def _costs(study: Study) -> Table:
    """Elements and memory, also of pictures that were not drawn."""
    rows = [[rival.name, *_cost(rival), rival.skipped or "drawn"] for rival in study.rivals if rival.counts]
    if study.next and rows:
        rows.append([count_of(study.next[0], "refinement"), "", "", "", size(study.next[1]), "not requested"])
    if rows:
        rows.insert(0, ["exact", "", "", size(study.stored), "", "drawn"])
    heads = ["picture", "simplices", "points", "memory of the mesh", "memory while it is made and drawn", ""]
    words = "The exact picture is drawn from the coefficients of the data themselves."
    return _table("Cost of the pictures", heads, rows, words, (5,))


def _cost(rival: Rival) -> list[str]:
    counts = rival.counts
    numbers = [f"{counts[name]:,}" if name in counts else "" for name in ("simplices", "points")]
    return [*numbers, *(size(counts[name]) if name in counts else "" for name in ("bytes", "needed"))]


def _contours(study: Study) -> Table:
    """Displacements by value, largest and mean, for each picture."""
    drawn = [rival for rival in study.rivals if rival.errors is not None]
    rows = []
    for number, value in enumerate(study.contours if drawn else ()):
        found = [rival.errors.contours[number] for rival in drawn if rival.errors]
        cells = [
            "lost or invented" if own.maximum is None else f"{some(own.maximum)} ({some(own.mean)})" for own in found
        ]
        rows.append([f"{value:.4g}", *cells])
    words = "Greatest displacement, and the mean in brackets."
    return _table("Contours, displacement in pixels", ["value", *(rival.name for rival in drawn)], rows, words)


def _surfaces(study: Study) -> Table:
    """Distances and topology of isosurfaces."""
    rows = []
    for rival in study.rivals:
        for name, own in rival.surfaces.items():
            if own is None:
                rows.append([name, rival.name, "–", "–", "lost or invented", ""])
                continue
            components, handles = (f"{first} / {other}" for first, other in (own.components, own.handles))
            rows.append([name, rival.name, some(own.hausdorff), some(own.chamfer), components, handles])
    heads = ["isosurface", "picture", "Hausdorff distance", "Chamfer distance", "components, exact / other", "handles"]
    words = "Distances between the exact isosurface and the linear one in units of the data, and their sizes."
    return _table("Isosurfaces", heads, sorted(rows, key=lambda row: row[0]), words)


def _deviations(study: Study) -> Table:
    """Distances of linear surfaces from points of the exact ones."""
    rows, points = [], dict[str, str]()
    for rival in study.rivals:
        for name, own in rival.deviations.items():
            if own is None:
                rows.append([name, rival.name, *["–"] * 5, "lost or invented"])
                continue
            points.setdefault(name, f"{name}: {own.points:,} points, {own.density:.3g} per unit of area")
            spreads = [own.away, *([] if own.back is None else [own.back])]
            cells = [some(value) for one in spreads for value in (one.mean, one.most)]
            rows.append([name, rival.name, *cells, *["–"] * (4 - len(cells)), some(own.hausdorff)])
    heads = ["surface", "picture", "mean", "95 % within", "mean back", "95 % back within", "Hausdorff distance"]
    words = (
        "Distances of exact points from the linear surface, by open3d, and back from the middles of its triangles to "
        f"the exact one, in units of the data. Exact points: {'; '.join(points.values())}."
    )
    return _table("Distances of surfaces", heads, sorted(rows, key=lambda row: row[0]), words)


def _bars(study: Study) -> Table:
    if study.validation is None:
        return _table("Exactness", (), ())
    width, height = study.validation.size
    heads = ["check", "", "at most", "found", "pixels above", "worst pixel"]
    who = "this picture" if study.scene is None else f"the same picture of {width} x {height} pixels"
    words = f"Every pixel of {who} against the reference, which computes it by other means in float64."
    if study.scene is None:
        words = f"Every pixel of {study.validation.device} against the first record."
    return _table("Exactness", heads, [_check_row(check) for check in study.validation.checks], words, (5,))


def _check_row(check: Check) -> list[str]:
    limit, found = (f"{check.limit:.0e}", some(check.found)) if check.limit else ("0", f"{check.found:.0f}")
    place = ""
    if check.worst:
        at = ", ".join(f"{x:.6g}" for x in check.worst.position)
        values = f"{check.worst.other:.10g} instead of {check.worst.exact:.10g}"
        place = f"column {check.worst.column}, row {check.worst.row}; element {check.worst.element} at ({at}): {values}"
    return [check.name, "pass" if check.passed else "FAIL", limit, found, f"{check.failed:,}", place]


def times_table(study: Study) -> dict[str, Any]:
    """Seconds by picture."""
    names = ("mesh", "cut", "draw")
    rows = [["exact", "", "", "", f"{study.seconds.get('exact', 0.0):.3g}"]]
    for rival in study.rivals:
        if rival.seconds:
            parts = [f"{rival.seconds[name]:.3g}" if name in rival.seconds else "" for name in names]
            rows.append([rival.name, *parts, f"{sum(rival.seconds.values()):.3g}"])
    words = (
        f"Seconds; the exact picture on {study.device or 'this device'}, with reading data to the device and compiling."
    )
    return {"heads": ["picture", "mesh", "cut", "draw", "all"], "rows": rows, "words": words}
