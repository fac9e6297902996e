"""Forms of texts for seeds of streamlines, by their first word; all other texts name tables of points."""

from __future__ import annotations

from collections.abc import Mapping

#: N points at even steps of a curve
CURVES: Mapping[str, str] = {
    "polyline": "polyline:P:Q:R:N",
    "circle": "circle:CENTRE:NORMAL:RADIUS:N",
    "spline": "spline:P:Q:R:N",
    "normal": "normal:BOUNDARY:POINT:LENGTH:N",
    "section": "section:BOUNDARY:plane:POINT:NORMAL:N",
}
FORMS: Mapping[str, str] = {
    "point": "point:X,Y,Z",
    "line": "line:P:Q:N",
    "disc": "disc:CENTRE:NORMAL:RADIUS:N",
    "grid": "grid:LOW:HIGH:NX,NY,NZ",
    "plane": "plane:POINT:NORMAL:N",
    "elements": "elements",
    "boundary": "boundary:NAME:N",
    "random": "N, random:N or random:N:LOW:HIGH",
    **CURVES,
}


def names_file(text: str) -> bool:
    """Whether a text of seeds is the name of a file."""
    kind, colon, _ = text.partition(":")
    return not text.isdecimal() and kind not in FORMS and (not colon or "." in kind or len(kind) == 1)
