"""Records of several items."""

from dataclasses import dataclass, field

import numpy as np

from elvis.core.base.rows import Rows


@dataclass(frozen=True, eq=False)
class Ends(Rows):
    low: np.ndarray
    high: np.ndarray


@dataclass(frozen=True, eq=False)
class Items(Rows):
    name: str
    by_name: dict[str, np.ndarray]
    ends: Ends
    values: np.ndarray
    degrees: tuple[int, ...] = (2, 3)
    notes: list[str] = field(default_factory=list)


def items(numbers):
    numbers = np.asarray(numbers)
    return Items("boxes", {"u": 3 * numbers}, Ends(numbers, numbers + 1), np.stack([numbers, -numbers], axis=1))


def contents(found):
    return found.values.tolist(), found.by_name["u"].tolist(), found.ends.low.tolist(), found.ends.high.tolist()


def test_a_part_has_the_rows_of_its_items_in_everything():
    for chosen in (np.array([3, 0]), np.array([True, False, False, True]), slice(1, 3)):
        expected = items(np.arange(4)[chosen])
        found = items(range(4)).part(chosen)
        assert contents(found) == contents(expected)
        assert len(found) == len(found.ends) == 2
        assert (found.name, found.degrees) == ("boxes", (2, 3))


def test_joined_records_have_the_items_of_each_in_their_order():
    found = Items.joined([items([4, 5]), items([]), items([1])])
    assert contents(found) == contents(items([4, 5, 1]))
    assert found.name == "boxes"
