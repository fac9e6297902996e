"""The numbers of a report as plain data: summary.json, and what the page shows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from elvis.core.data.dataset import Expansion
from elvis.reference.line_study import line_facts
from elvis.reference.report.conclusion import conclusion, is_right
from elvis.reference.study import Rival, Study
from elvis.reference.tolerances import Check
from elvis.scene.model.tables import table_of


def summary(study: Study) -> dict[str, Any]:
    """All numbers but times: the same for the same input."""
    validation = study.validation
    return {
        "conclusion": conclusion(study),
        "pixel_exact": validation.passed if validation else None,
        "scene": table_of(study.scene) if study.scene else None,
        "data": _data(study),
        "picture": {
            "size": [study.exact.shape[1], study.exact.shape[0]],
            "pixels_visible": int(study.exact.seen.sum()),
            "range": list(study.ends),
            "contours": list(study.contours),
        },
        "validation": validation
        and {
            "size": list(validation.size),
            "passed": validation.passed,
            "ambiguous": validation.ambiguous,
            "tolerances": [check_facts(check) for check in validation.checks],
        },
        "baselines": [rival_facts(rival) for rival in study.rivals],
        "lines": [line_facts(own) for own in study.lines],
        "next": study.next and {"level": study.next[0], "bytes": study.next[1]},
        "remarks": list(study.remarks),
    }


def times(study: Study) -> dict[str, Any]:
    """Seconds, and the devices that took them; these differ from run to run."""
    return {
        "device": study.device,
        "seconds": {"exact": dict(study.seconds), **{rival.key: dict(rival.seconds) for rival in study.rivals}},
    }


def check_facts(check: Check) -> dict[str, Any]:
    """The result for one tolerance."""
    return {**asdict(check), "passed": check.passed}


def rival_facts(rival: Rival) -> dict[str, Any]:
    """One picture that is held against the exact one."""
    found: dict[str, Any] = {"key": rival.key, "name": rival.name, "level": rival.level, "skipped": rival.skipped}
    found["counts"] = dict(rival.counts)
    if rival.errors is not None:
        found |= {"right": is_right(rival), **asdict(rival.errors)}
        found |= {"contour_max": rival.errors.contour_max, "contours_lost": rival.errors.lost}
    found["deviations"] = {name: own and asdict(own) for name, own in rival.deviations.items()}
    found["surfaces"] = {name: own and asdict(own) for name, own in rival.surfaces.items()}
    return found


def _data(study: Study) -> dict[str, Any] | None:
    """Elements, polynomial degrees and size of what the exact picture is drawn from."""
    if study.dataset is None:
        return None
    patches = study.patches
    return {
        "elements": {shape.label.lower(): len(own) for shape, own in study.dataset.mesh.elements.items()},
        "elements_drawn": sum(map(len, patches)),
        "degrees": _degrees(own for patch in patches for own in patch.fields if own is not None),
        "map_degrees": _degrees(patch.geometry for patch in patches),
        "bytes": study.stored,
    }


def _degrees(expansions: Iterable[Expansion]) -> list[int]:
    """Smallest and largest degree; empty without expansions."""
    found = {modes - 1 for expansion in expansions for modes in expansion.modes}
    return [min(found), max(found)] if found else []
