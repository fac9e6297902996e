"""The page of a report, and the files that it shows."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from elvis.reference.extras import comparison_module
from elvis.reference.report import pictures as drawn
from elvis.reference.report import plots
from elvis.reference.report.conclusion import how_wrong
from elvis.reference.report.summary import summary
from elvis.reference.report.tables import every_table, facts, times_table
from elvis.reference.report.words import percent, some
from elvis.reference.study import Rival, Study

Files = dict[str, Any]
#: explanations of the numbers of a page, one sentence per line
MEANING = (
    "Errors are measured at every pixel that both pictures show, relative to the colour range.",
    "A colour step is 1/256 of it.",
    "A pixel counts as wrong if its value is off by more than a step, or if it is empty although there is an object.",
    "A contour's displacement is the maximum distance between the contours of two pictures, in pixels, in either "
    "direction (Hausdorff).",
    "A linear picture is called right if no contour is lost or off by more than a pixel, and at most 0.1 % of the "
    "pixels are wrong or spurious.",
    "Refinement n cuts every edge of every element into 2 to the power n parts; corners have the exact position and "
    "value; between them both are linear.",
)


def page(study: Study, scene_text: str = "") -> tuple[str, Files]:
    """The HTML text, and the files by name: pictures as arrays, plots as text; ``scene_text`` is shown."""
    files: Files = {}
    numbers = summary(study)
    told = {
        "title": _title(study),
        "numbers": numbers,
        "mood": _mood(study),
        "facts": facts(study, numbers),
        "width": max(study.exact.shape[1], 640),
        "pictures": _pictures(study, files),
        "bar": _bar(study, files),
        "maps": _maps(study, files),
        "tables": every_table(study),
        "plots": _plots(study, files),
        "plots_title": "Error against refinement and memory",
        "meaning": MEANING,
        "scene_text": scene_text,
        "times": _times(study, files),
    }
    return filled(told), files


def filled(told: dict[str, Any]) -> str:
    """The HTML text of a page, from the values that its template needs."""
    jinja2 = comparison_module("jinja2")
    environment = jinja2.Environment(autoescape=True, trim_blocks=True, undefined=jinja2.StrictUndefined)
    template = (Path(__file__).parent / "page.html").read_text(encoding="utf-8")

    # numbers stay with their unit
    text = str(environment.from_string(template).render(told))
    return text.replace(" %", "\N{NO-BREAK SPACE}%").replace(" pixels", "\N{NO-BREAK SPACE}pixels")


def _title(study: Study) -> str:
    if study.scene is None:
        return f"Comparison with {study.rivals[0].name}"
    names = ", ".join(Path(name).name for name in study.scene.data)
    return f"Accuracy of pictures of {study.scene.field}" + (f" in {names}" if names else "")


def _mood(study: Study) -> str:
    if study.validation is None:
        return ""
    return "good" if study.validation.passed else "bad"


def _pictures(study: Study, files: Files) -> list[dict[str, str]]:
    """The exact picture and all others."""
    exact = "exact" if study.scene is not None else "first record"
    files["pictures/exact.png"] = drawn.image_of(study.exact)
    found = [{"file": "pictures/exact.png", "name": exact, "words": ""}]
    for rival in _drawn_rivals(study):
        assert rival.record is not None
        files[f"pictures/{rival.key}.png"] = drawn.image_of(rival.record)
        found.append({"file": f"pictures/{rival.key}.png", "name": rival.name, "words": how_wrong(rival)})
    return found


def _drawn_rivals(study: Study) -> list[Rival]:
    return [rival for rival in study.rivals if rival.record is not None]


def _bar(study: Study, files: Files) -> dict[str, str] | None:
    """The colour bar of the scene's field."""
    if study.scene is None:
        return None
    files["pictures/colors.png"] = drawn.color_bar(study.scene.palette)
    low, high = (f"{end:.4g}" for end in study.ends)
    return {"file": "pictures/colors.png", "low": low, "high": high, "name": study.scene.field}


def _maps(study: Study, files: Files) -> list[dict[str, Any]]:
    """Maps of errors: values, positions where they differ, contours, and the worst places."""
    makers = (_value_maps, _position_maps, _distance_maps, _contour_maps, _worst)
    found = [make(study, files) for make in makers]
    return [own for own in found if own["pictures"]]


def _value_maps(study: Study, files: Files) -> dict[str, Any]:
    pictures: list[Any] = []
    legend: list[drawn.Legend] = []
    for rival in _drawn_rivals(study):
        assert rival.record is not None
        assert rival.errors is not None
        name = f"pictures/{rival.key}-error.png"
        files[name], legend = drawn.error_map(study.exact, rival.record, study.ends)
        words = (
            f"up to {percent(100 * rival.errors.value_max)} of the range, mean {percent(100 * rival.errors.value_mean)}"
        )
        pictures.append({"file": name, "name": rival.name, "words": words})
    words = "How far the value at each pixel is off, in steps of the colour map (1/256 of the range)."
    return {"title": "Wrong values", "words": words, "legend": legend, "pictures": pictures}


def _position_maps(study: Study, files: Files) -> dict[str, Any]:
    """Distances of surfaces from the exact ones; none on planes."""
    pictures: list[Any] = []
    legend: list[drawn.Legend] = []
    for rival in _drawn_rivals(study):
        assert rival.record is not None
        assert rival.errors is not None
        if not rival.errors.pixel_max or rival.errors.position_max < 1e-9:
            continue
        name = f"pictures/{rival.key}-position.png"
        pixel = _pixel(rival)
        files[name], legend = drawn.position_map(study.exact, rival.record, pixel)
        pictures.append({"file": name, "name": rival.name, "words": f"up to {some(rival.errors.pixel_max)} pixels"})
    words = "Distance of the point that a pixel shows from the exact one, in pixels."
    return {"title": "Misplaced surfaces", "words": words, "legend": legend, "pictures": pictures}


def _distance_maps(study: Study, files: Files) -> dict[str, Any]:
    """Distances of the exact surfaces from the linear ones, at right angles."""
    pictures: list[Any] = []
    legend: list[drawn.Legend] = []
    for rival in _drawn_rivals(study):
        if rival.apart is None:
            continue
        name = f"pictures/{rival.key}-distance.png"
        files[name], legend = drawn.distance_map(rival.apart, _pixel(rival))
        words = f"up to {some(float(np.nanmax(rival.apart, initial=0.0)))} units of the data"
        pictures.append({"file": name, "name": rival.name, "words": words})
    words = "The distance in pixels of each visible point from the nearest point of the linear surfaces."
    return {"title": "Distances between surfaces", "words": words, "legend": legend, "pictures": pictures}


def _pixel(rival: Rival) -> float:
    """The size of a pixel in world units."""
    assert rival.errors is not None
    return rival.errors.pixel or 1.0


def _contour_maps(study: Study, files: Files) -> dict[str, Any]:
    pictures = []
    for rival in _drawn_rivals(study) if study.contours else ():
        assert rival.record is not None
        assert rival.errors is not None
        name = f"pictures/{rival.key}-contours.png"
        files[name] = drawn.contour_map(study.exact, rival.record, study.contours)
        words = f"off by up to {some(rival.errors.contour_max)} pixels"
        lost = f", {rival.errors.lost} lost or invented" if rival.errors.lost else ""
        pictures.append({"file": name, "name": rival.name, "words": words + lost})
    words = "The exact contours in black, those of the other picture in red."
    return {"title": "Displaced contours", "words": words, "legend": [], "pictures": pictures}


def _worst(study: Study, files: Files) -> dict[str, Any]:
    """The neighbourhood of each picture's worst pixel, exact and other."""
    pictures = []
    for rival in _drawn_rivals(study):
        assert rival.record is not None
        if rival.errors is None or rival.errors.worst is None:
            continue
        place, names = rival.errors.worst, (f"pictures/{rival.key}-worst-exact.png", f"pictures/{rival.key}-worst.png")
        files[names[0]], files[names[1]] = drawn.around(study.exact, place), drawn.around(rival.record, place)
        at = ", ".join(f"{x:.4g}" for x in place.position)
        words = f"{place.other:.4g} instead of {place.exact:.4g} at ({at}), element {place.element}"
        pictures.append({"pair": names, "name": rival.name, "words": words})
    words = "The pixel of each picture that is most wrong, framed: the exact picture on the left."
    return {"title": "The worst pixels", "words": words, "legend": [], "pictures": pictures}


def _plots(study: Study, files: Files) -> list[dict[str, str]]:
    """Errors against refinement and memory, where there are several refinements; where streamlines end."""
    lines = []
    for number, own in enumerate(study.lines):
        if any(other.maximum for other in own.others):
            name = f"plots/lines-{number}.svg"
            files[name] = plots.of_lines(own)
            lines.append({"file": name, "name": f"where streamlines end: {own.name}"})
    if sum(rival.level is not None and rival.errors is not None for rival in study.rivals) < 2:
        return lines
    files["plots/refinement.svg"] = plots.against_refinement(study)
    files["plots/memory.svg"] = plots.against_memory(study)
    found = [{"file": f"plots/{name}.svg", "name": f"error against {name}"} for name in ("refinement", "memory")]
    if any(rival.deviations for rival in study.rivals):
        files["plots/distances.svg"] = plots.of_distances(study)
        found.append({"file": "plots/distances.svg", "name": "histogram of distances"})
    return [*found, *lines]


def _times(study: Study, files: Files) -> dict[str, Any] | None:
    """Seconds, as a table and a plot."""
    if not study.seconds:
        return None
    told = times_table(study)
    if sum(bool(rival.seconds) for rival in study.rivals) > 1:
        files["times.svg"] = plots.against_time(study)
        told["plot"] = "times.svg"
    return {"plot": None, **told}
