"""Steps of a series, read in parts by several ranks."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from elvis.core.data.dataset import Dataset
from elvis.core.portions.portion import Portion
from elvis.core.quantities.needed import needed_fields
from elvis.formats.reading import StatesByPart
from elvis.plugins.series.finding import Found, Step

if TYPE_CHECKING:
    from elvis.plugins.data.data import Reading


#: the number of a step at the end of a name
_STEP_NUMBER = re.compile(r"[._-]*\d+$")


def reading_of(step: Step, reading: Reading) -> Reading:
    """How a step of files that are converted is read: one of several in a file by its number."""
    if step.option is None:
        return reading
    return replace(reading, options={**reading.options, "step": str(step.option)})


def with_common_names(dataset: Dataset, step: Step) -> Dataset:
    """The dataset of a step under the names that its fields have in all steps."""
    names = _common_names([field.name for field in dataset.fields], step)
    return replace(dataset, fields=tuple(replace(field, name=names[field.name]) for field in dataset.fields))


def _common_names(names: Sequence[str], step: Step) -> dict[str, str]:
    """Names without the number of a step, if they begin like its files: the name of u in u_0003.gf.

    Names that another field has remain unchanged.
    """
    found = {name: name for name in names}
    for path in step.files:
        stem = path.name.removesuffix(path.suffix)
        short = _STEP_NUMBER.sub("", stem)
        for name in names:
            common = short + name.removeprefix(stem)
            if short and name.startswith(stem) and common not in found.values():
                found[name] = common
    return found


class StepsByPart:
    """The part that a rank has of one step after another; the mesh of native files is read once.

    reading  says who the ranks are, and which quantities are requested
    """

    def __init__(self, found: Found, reading: Reading) -> None:
        self.reading, self._found = reading, found
        ranks = reading.ranks
        self._native = StatesByPart(ranks.rank, ranks.size, *found.common) if found.is_native else None
        self._last: dict[Step, Portion] = {}

    def on_the_same_mesh(self, reading: Reading) -> StepsByPart:
        """The same of other quantities, without reading the mesh again."""
        other = StepsByPart(self._found, reading)
        other._native = self._native
        return other

    def read(self, step: Step) -> tuple[Dataset, int]:
        """The part of a step, and how many elements of its fields the mesh lacks; FormatError if it can't be read.

        Called by each rank.
        """
        from elvis.plugins.data.data import part_of_state

        lacking = 0
        if self._native is not None:
            portion, lacking = self._native.read(*step.files, choose=self.reading.choice())
        else:
            portion = part_of_state((*self._found.common, *step.files), reading_of(step, self.reading))
            names = _common_names(list(portion.blocks), step)
            blocks = {names[name]: own for name, own in portion.blocks.items()}
            portion = replace(portion, dataset=with_common_names(portion.dataset, step), blocks=blocks)
        # only numbers in the whole: arrays go with the dataset
        self._last[step] = replace(portion, dataset=replace(portion.dataset, fields=()))
        return portion.dataset, lacking

    def lacking(self, step: Step) -> int:
        """How many elements of the fields of a step the mesh lacks; FormatError where it can't be read."""
        assert self._native is not None
        return self._native.lacking(*step.files, choose=partial(needed_fields, texts=("",)))

    def forget(self, step: Step) -> None:
        """Drop the data of a step."""
        self._last.pop(step, None)

    def portion(self, step: Step, dataset: Dataset) -> Portion:
        """The part of a step, for a dataset made from it, which has the same fields or some of them."""
        known = self._last[step]
        blocks = {field.name: known.blocks[field.name] for field in dataset.fields}
        return replace(known, dataset=dataset, blocks=blocks)
