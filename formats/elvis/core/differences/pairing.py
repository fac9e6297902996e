"""Two solutions in one dataset: the other one has a name in expressions."""

from __future__ import annotations

from elvis.core.dataset import Dataset
from elvis.core.quantities.tree import Node, field, other

#: the other solution in expressions
REFERENCE = "reference"


def common_fields(first: Dataset, second: Dataset) -> list[str]:
    """The names of fields that both have, in the order of the first."""
    known = {one.name for one in second.solution}
    return [one.name for one in first.solution if one.name in known]


def paired(first: Dataset, second: Dataset) -> Dataset:
    """The first dataset, in which fields of the second may be named as `theirs` does."""
    return first.beside(**{REFERENCE: second})


def theirs(name: str, is_same_mesh: bool) -> Node:
    """A field of the second dataset in one that `paired` made."""
    return field(f"{REFERENCE}:{name}") if is_same_mesh else other(REFERENCE, f'"{name}"')
