"""Losses of a conversion, as recorded in the metadata of converted data: errors that add to all computed results."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from math import inf, isfinite
from typing import Any

from elvis.core.base.rounded_up import rounded_up

#: key of the metadata under which the report of a conversion stands
REPORT = "ConversionReport"


@dataclass(frozen=True)
class Loss:
    """Differences of a quantity from the source: the largest ones measured.

    value     of the quantity itself
    slope     error of its derivative in space; infinite if unknown
    relative  the error of the value as a share of the range, or of the mesh's diagonal
    """

    value: float = 0.0
    slope: float = 0.0
    relative: float = 0.0


@dataclass(frozen=True)
class ConversionErrors:
    """The errors of converted data that are more than rounding.

    place   of the coordinates; its slope is the share by which lengths are wrong
    fields  by name; exact ones are not there
    """

    place: Loss = field(default_factory=Loss)
    fields: Mapping[str, Loss] = field(default_factory=dict)

    @classmethod
    def of(cls, metadata: Mapping[str, str]) -> ConversionErrors:
        """The errors recorded in the metadata of a dataset; none if the metadata record none that can be parsed."""
        return _parsed(metadata[REPORT]) if REPORT in metadata else cls()

    def __bool__(self) -> bool:
        return bool(self.fields) or self.place.value > 0

    def of_field(self, name: str) -> Loss:
        """The error of a field, exact or not."""
        return self.fields.get(name, Loss())

    def sentence(self) -> str:
        """Describe the size of the errors in words."""
        named = [("coordinates", self.place)] if self.place.value else []
        named += sorted(self.fields.items(), key=lambda item: -item[1].relative)[:1]
        told = " and ".join(f"{rounded_up(loss.relative)} in {name}" for name, loss in named)
        return f"errors of up to {told}, relative to its range"


@lru_cache(maxsize=16)
def _parsed(text: str) -> ConversionErrors:
    """The errors in a report, which anybody may have written."""
    try:
        facts = json.loads(text)
        fields = {str(name): _loss(own) for name, own in facts.get("fields", {}).items() if not own["exact"]}
        place = Loss() if facts["geometry"]["exact"] else _loss(facts["geometry"])
    except (KeyError, TypeError, ValueError, AttributeError, RecursionError):
        return ConversionErrors()
    return ConversionErrors(place, fields)


def _loss(facts: Mapping[str, Any]) -> Loss:
    value, slope, relative = (_number(facts.get(key)) for key in ("max", "slope", "relative"))
    return Loss(value, slope, relative)


def _number(value: Any) -> float:
    """A number that is not negative; infinite if missing or invalid."""
    found = inf if value is None else float(value)
    return found if isfinite(found) and found >= 0 else inf
