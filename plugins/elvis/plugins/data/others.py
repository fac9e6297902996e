"""Other datasets that expressions about data may name, as ``--other`` gives them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.differences.common_elements import common_elements
from elvis.core.portions.portion import Portion, carriers
from elvis.core.quantities.reference_values import over
from elvis.plugins.data.reference_files import reference_beside

if TYPE_CHECKING:
    from elvis.plugins.data.data import Reading


def files_of_others(texts: Iterable[str]) -> dict[str, tuple[Path, ...]]:
    """``NAME=FILE,FILE`` texts by name; ElvisError for others."""
    found: dict[str, tuple[Path, ...]] = {}
    for text in texts:
        name, _, files = (part.strip() for part in text.partition("="))
        if not name.isidentifier() or not files or name in found:
            raise ElvisError(
                f"--other: expected NAME=FILE,FILE, such as ref=b.xml,b.fld, each name once, found {text!r}"
            )
        found[name] = tuple(Path(file) for file in files.split(","))
    return found


class Others:
    """Other datasets of a reading, read when they are first needed; each of several ranks has its part.

    paths  of the data, next to which there may be files of reference values

    Raises as `elvis.plugins.data.data.read`, and ElvisError for an invalid NAME=FILE.
    """

    def __init__(self, reading: Reading, paths: Sequence[Path] = ()) -> None:
        self._reading = reading
        self._values = {**reference_beside(paths), **reading.reference}
        self._parts: dict[str, Portion] = {}
        self._datasets: dict[str, Dataset] | None = None

    def beside(self, dataset: Dataset) -> Dataset:
        """A dataset, or a rank's part of one, in which expressions may name the others, with their remarks.

        It has the reference values of the reading and of files next to the data, and the geometry that the reading
        requests.  Called by each rank.  Elements of a part lie in the others if all parts' elements do.
        """
        if self._values:
            dataset = replace(dataset, reference=over(dataset.reference, self._values))
        if self._reading.complexes:
            from elvis.plugins.data.phases import with_complexes

            dataset = with_complexes(dataset, self._reading.complexes)
        if self._reading.deformation is not None:
            from elvis.plugins.data.deforming import with_deformation

            dataset = with_deformation(dataset, self._reading.deformation)
        if not self._reading.others:
            return dataset
        datasets = self._opened()
        remarks = [f"{name}: {remark}" for name, other in datasets.items() for remark in other.remarks]
        found = replace(dataset.with_others(**datasets), remarks=(*dataset.remarks, *remarks))
        return self._agreed(found) if self._parts else found

    def beside_part(self, part: Portion) -> Portion:
        """A rank's part of a dataset that has the others, with its parts of them."""
        if not self._parts:
            return part
        even = all(self._reading.ranks.exchange(part.is_even and self._is_even(part.dataset), "elements of other data"))
        return replace(part, others=self._parts, is_even=even)

    def _opened(self) -> Mapping[str, Dataset]:
        from elvis.plugins.data.data import Reading, dataset_of, part_of

        if self._datasets is None:
            own = self._reading
            reading = Reading(is_kept=own.is_kept, ranks=own.ranks, reference=own.reference)
            files = files_of_others(self._reading.others)
            if reading.ranks.size > 1:
                self._parts = {name: part_of(paths, reading) for name, paths in files.items()}
                self._datasets = {name: part.dataset for name, part in self._parts.items()}
            else:
                self._datasets = {name: dataset_of(paths, reading) for name, paths in files.items()}
        return self._datasets

    def _agreed(self, dataset: Dataset) -> Dataset:
        """A part that shares the elements of those others whose elements all parts share."""
        is_empty, ranks = not len(dataset.mesh.domain_ids()), self._reading.ranks
        own = set(dataset.others) if is_empty else set(dataset.shared)
        common = set.intersection(*ranks.exchange(own, f"other data: {', '.join(self._reading.others)}"))
        # parts without elements are of the same kind as the others' parts
        shared = {
            name: dataset.shared.get(name) or common_elements(dataset, other)
            for name, other in dataset.others.items()
            if name in common
        }
        return replace(dataset, shared=shared)

    def _is_even(self, dataset: Dataset) -> bool:
        """Whether all fields of others that share the elements of a part are on elements with its first field."""
        carried = carriers(dataset)
        ours = dataset.mesh.domain_ids() if carried is None else carried
        for name, common in dataset.shared.items():
            carried = carriers(dataset.others[name])
            own = common.element_ids if carried is None else common.element_ids[np.isin(common.others, carried)]
            if not self._parts[name].is_even or not np.array_equal(np.sort(own), np.sort(ours)):
                return False
        return True
