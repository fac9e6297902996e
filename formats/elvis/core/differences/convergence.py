"""The order at which a family of solutions comes near the last one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.differences.difference import ERROR, Differences, diff
from elvis.core.files.columns import Columns

#: norms for which orders are reported
NORMS = ("l1", "l2", "h1", "linf")
#: headers of the columns of a table
HEADERS = ("field", "data", "elements", "h", "L1", "L2", "H1", "Linf", "order of L2")


@dataclass(frozen=True, eq=False)
class Family:
    """Differences of several datasets to one, from coarse to fine in the given order.

    names    of the datasets
    members  their differences
    """

    names: tuple[str, ...]
    members: tuple[Differences, ...]

    @property
    def fields(self) -> list[str]:
        """The names of the fields that all have."""
        first, *others = ({row.field for row in member} for member in self.members)
        return [row.field for row in self.members[0] if row.field in first.intersection(*others)]

    def orders(self, field: str, norm: str = "l2") -> list[float]:
        """For each member the order from the one before, log(e1/e2) / log(h1/h2).

        NaN for the first, where sizes are the same, and where nothing differs.
        """
        errors = [getattr(member.of(field), norm) for member in self.members]
        sizes = [member.size for member in self.members]
        found = [np.nan]
        for k in range(1, len(errors)):
            ratio = np.log(sizes[k - 1] / sizes[k])
            is_known = abs(ratio) > 1e-3 and errors[k] > 0 and errors[k - 1] > 0
            found.append(float(np.log(errors[k - 1] / errors[k]) / ratio) if is_known else np.nan)
        return found

    def cells(self) -> list[tuple[str, ...]]:
        """The cells of a table, under `HEADERS`."""
        return [
            (
                field,
                self.names[k],
                str(member.elements),
                f"{member.size:.4g}",
                *(f"{getattr(member.of(field), norm):.6g}" for norm in NORMS),
                *(f"{order:.3f}" if np.isfinite(order) else "-" for order in (self.orders(field)[k],)),
            )
            for field in self.fields
            for k, member in enumerate(self.members)
        ]

    def columns(self) -> Columns:
        """Rows by field, then by member: dataset, field, elements, size, norms and their orders."""
        rows = [(field, k) for field in self.fields for k in range(len(self.members))]
        found: dict[str, list[object]] = {
            "data": [self.names[k] for _, k in rows],
            "field": [field for field, _ in rows],
            "elements": [self.members[k].elements for _, k in rows],
            "size": [self.members[k].size for _, k in rows],
        }
        for norm in NORMS:
            name = norm.capitalize()
            found[name] = [getattr(self.members[k].of(field), norm) for field, k in rows]
            found[f"{name}_order"] = [self.orders(field, norm)[k] for field, k in rows]
        return {name: np.array(column) for name, column in found.items()}


def family(
    members: Sequence[Dataset],
    reference: Dataset,
    names: Sequence[str] = (),
    fields: Sequence[str] | None = None,
    error: float = ERROR,
) -> Family:
    """The differences of some datasets to a reference; raises ElvisError as `diff`, and for no member."""
    if not members:
        raise ElvisError("expected a dataset and the one that it is compared with, found one")
    given = tuple(names) or tuple(str(k + 1) for k in range(len(members)))
    return Family(given, tuple(diff(member, reference, fields, error) for member in members))
