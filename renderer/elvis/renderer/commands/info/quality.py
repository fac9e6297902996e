"""``elvis info --quality``: sizes and shapes of elements, as tables."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from elvis.core.numbers.mesh_quality import MeshQuality
    from elvis.renderer.commands.sources import Source

#: names of measures in the tables
_TITLES = {
    "quality": "quality",
    "scaled_jacobian": "scaled Jacobian",
    "jacobian_ratio": "Jacobian min/max",
    "edge_ratio": "edge ratio",
    "h": "h",
    "time_step": "time step",
}
_LEGEND = """
quality: mean ratio, 1 for the ideal element; Jacobian min/max: smallest determinant divided by the largest; edge ratio:
longest edge divided by the shortest; h: d-th root of the volume. Values inside elements are sampled at points."""
_TIME_STEP = "time step: that of CFL number 1, for explicit advection of the order of the fields"


def print_quality(source: Source, as_json: bool) -> None:
    """Print the range of each measure, and the worst elements."""
    from elvis.core.base.terminal import print_json, print_table, say, stage

    with stage("measuring"):
        facts = _quality(source).facts()
    if as_json:
        print_json(facts)
        return
    measures = facts["measures"]
    rows = [(_TITLES[name], *_range(own)) for name, own in measures.items()]
    print_table(("measure", "minimum", "median", "maximum", "worst element"), rows)
    say("")
    columns = ("worst element", "shape", "place", *(_TITLES[name] for name in measures))
    print_table(columns, [_row(own, list(measures)) for own in facts["worst"]])
    say(_LEGEND)
    if "time_step" in measures:
        say(_TIME_STEP)


def _quality(source: Source) -> MeshQuality:
    """The measures of native data or of data of a runtime plugin."""
    if source.dataset is not None:
        from elvis.core.numbers.mesh_quality import mesh_quality

        return mesh_quality(source.dataset)
    from elvis.plugins.runtime.host.quality import host_quality

    return host_quality(source.opened)


def _range(own: dict[str, Any]) -> tuple[object, ...]:
    """The numbers of a row of the first table."""
    return (*(f"{own[key]:.4g}" for key in ("minimum", "median", "maximum")), own["worst_element"])


def _row(own: dict[str, Any], names: list[str]) -> tuple[object, ...]:
    """A row of the table of elements."""
    place = ", ".join(f"{x:.4g}" for x in own["place"])
    return (own["element"], own["shape"], place, *(f"{own[name]:.4g}" for name in names))
