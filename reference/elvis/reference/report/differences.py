"""The report of a difference of solutions, with the same page and folder structure as the accuracy report."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from elvis.core.base.rounded_up import rounded_up
from elvis.core.differences import Family
from elvis.core.differences.convergence import HEADERS as ORDERS
from elvis.core.differences.difference import HEADERS
from elvis.reference.report.difference_maps import Maps
from elvis.reference.report.page import filled
from elvis.reference.report.plots import plot
from elvis.reference.report.writing import json_text, plain, put, report_folder

_MEANING = (
    "L1, L2 and H1 are integrals over the part of the first data that the reference covers: of the magnitude of the "
    "difference, the root of that of its square, and the same with the square of its gradient added.",
    "Linf is the largest magnitude of the difference that was found. The difference never exceeds the proved bound, "
    "if there is one.",
    "Relative is L2 divided by the L2 norm of the reference.",
    "Covered is the part of the volume (area, length) of the first data where the reference has elements.",
    "The order is log(e1/e2) / log(h1/h2) of two data in turn, with h the mean size of an element.",
)
_COLORS = ("#253494", "#bd0026", "#238b45", "#fd8d3c", "#6a51a3", "#252525")


def write_difference_report(
    found: Family,
    reference: str,
    folder: Path,
    inputs: Iterable[Path] = (),
    overwrite: bool = False,
    maps: Sequence[Maps] = (),
    remarks: Sequence[str] = (),
) -> None:
    """Write the report of a family, or of one member; an earlier report in its place is replaced.

    maps     pictures of fields of the last member
    remarks  sentences on them
    """
    with report_folder(folder, inputs, overwrite) as temporary:
        files: dict[str, Any] = {"plots/order.svg": _orders(found)} if len(found.members) > 1 else {}
        told = _told(found, reference, list(files))
        told["numbers"]["remarks"] += remarks
        told["maps"] = [_map(number, own, files) for number, own in enumerate(maps)]
        put(temporary / "index.html", filled(told))
        for name, content in files.items():
            put(temporary / name, content)
        put(temporary / "summary.json", json_text(_numbers(found, reference)))


def _map(number: int, maps: Maps, files: dict[str, Any]) -> dict[str, Any]:
    """The pictures of one field, which become files."""
    pictures = []
    for k, (name, image) in enumerate(maps.pictures.items()):
        file = f"pictures/{number}-{k}.png"
        files[file] = image
        pictures.append({"file": file, "name": name, "words": maps.words[k]})
    words = "The field of both data in one range of colours, and the exact difference at every pixel."
    return {"title": f"Maps of {maps.field}", "words": words, "legend": [], "pictures": pictures}


def _numbers(found: Family, reference: str) -> dict[str, Any]:
    members = zip(found.names, found.members, strict=True)
    return {
        "reference": reference,
        "members": [
            {"data": name, "elements": own.elements, "size": own.size, "fields": plain(own.facts())}
            for name, own in members
        ],
        "orders": {field: plain(found.orders(field)) for field in found.fields},
    }


def _told(found: Family, reference: str, files: list[str]) -> dict[str, Any]:
    """The variables for the template of pages."""
    several = len(found.members) > 1
    told = [(name, remark) for name, own in zip(found.names, found.members, strict=True) for remark in own.remarks]
    remarks = [f"{name}: {remark}" if several else remark for name, remark in told]
    return {
        "title": f"Difference of {', '.join(found.names)} and {reference}",
        "numbers": {"conclusion": _verdict(found), "remarks": remarks},
        "mood": "",
        "facts": [],
        "width": 640,
        "pictures": [],
        "bar": None,
        "maps": [],
        "tables": _tables(found),
        "plots": [{"file": name, "name": "difference against the size of elements"} for name in files],
        "plots_title": "Difference against the size of elements",
        "meaning": _MEANING,
        "scene_text": "",
        "times": None,
    }


def _verdict(found: Family) -> str:
    """The largest relative difference of the last member."""
    last = found.members[-1]
    worst = max(last, key=lambda row: row.relative if np.isfinite(row.relative) else -1.0)
    how = "by coefficients, exactly" if last.is_same_mesh else "by quadrature on two meshes"
    share = "" if np.isnan(worst.relative) else f"by {worst.relative:.3g} of its L2 norm, and "
    return f"{found.names[-1]} differs most in {worst.field}: {share}by up to {worst.linf:.6g} ({how})."


def _tables(found: Family) -> list[dict[str, Any]]:
    tables = [] if len(found.members) == 1 else [_table("Order of convergence", ORDERS, found.cells())]
    for name, own in zip(found.names, found.members, strict=True):
        tables.append(_table(f"Norms of the difference: {name}", HEADERS, own.cells()))
        rows = [(row.field, *map(rounded_up, (row.l1_error, row.l2_error, row.h1_error))) for row in own]
        tables.append(_table("Error bound of these norms", ("field", "L1", "L2", "H1"), rows))
    return tables


def _table(title: str, heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> dict[str, Any]:
    return {"title": title, "words": "", "heads": heads, "rows": rows, "wide": ()}


def _orders(found: Family) -> str:
    """L2 norms against the size of elements, as SVG."""

    def draw(axes: Any) -> None:
        sizes = [own.size for own in found.members]
        for number, field in enumerate(found.fields):
            values = [own.of(field).l2 for own in found.members]
            order = found.orders(field)[-1]
            label = f"{field}, order {order:.2f}" if np.isfinite(order) else field
            axes.plot(sizes, values, marker="o", markersize=5, color=_COLORS[number % len(_COLORS)], label=label)
        axes.set_xscale("log")
        axes.set_yscale("log")
        axes.set_xticks(sizes, [f"{size:.3g}" for size in sizes])
        axes.set_xticks([], minor=True)
        axes.set_xlabel("size of elements")
        axes.set_ylabel("L2 norm of the difference")
        axes.legend(fontsize=8)

    return plot(draw)
