"""Counts of elements by type, from the text of Gmsh files of each version."""

from collections import Counter

import numpy as np
import pytest

from elvis.converters.gmsh.census import census

#: nodes of types
WIDTHS = {1: 2, 2: 3, 4: 4, 5: 8, 8: 3, 9: 6, 15: 1}
VERSIONS = ("1", "2.2", "4", "4.1")


def width_of(kind):
    """Files of another version than it seems have types that don't exist."""
    return WIDTHS.get(kind, 0)


def runs_of(rng):
    """Types and numbers of elements one after another; some runs are long."""
    return [(int(rng.choice(list(WIDTHS))), int(rng.choice([1, 2, 17, 49, 50]))) for _ in range(6)]


def numbers_of(version, runs, rng):
    """Numbers of the section of elements."""
    total = sum(count for _, count in runs)
    rows = []
    for kind, count in runs:
        tags, names = int(rng.integers(0, 4)), rng.integers(1, 9, (count, WIDTHS[kind] + 12))
        nodes = names[:, : WIDTHS[kind]]
        head = names[:, :1]
        if version[0] == "4":
            rows += [[2, 1, kind, count] if version == "4.1" else [1, 2, kind, count]]
            rows += list(np.hstack([head, nodes]))
        elif version[0] == "1":
            rows += list(np.hstack([head, np.tile([kind, 7, 7, WIDTHS[kind]], (count, 1)), nodes]))
        else:
            facts = np.hstack([np.tile([kind, tags], (count, 1)), names[:, -3:][:, :tags]])
            rows += list(np.hstack([head, facts, nodes]))
    first = {"1": [total], "2": [total], "4": [len(runs), total]}[version[0]]
    return [*first, *([1, total] if version == "4.1" else []), *(number for row in rows for number in row)]


def text_of(version, numbers):
    section = " ".join(map(str, numbers))
    if version == "1":
        return f"$NOD\n$ENDNOD\n$ELM\n{section}\n$ENDELM\n".encode()
    return f"$MeshFormat\n{version} 0 8\n$EndMeshFormat\n$Elements\n{section}\n$EndElements\n".encode()


@pytest.mark.parametrize("version", VERSIONS)
def test_elements_are_counted_by_type(version):
    for seed in range(20):
        rng = np.random.default_rng(seed)
        runs = runs_of(rng)
        expected = Counter()
        for kind, count in runs:
            expected[kind] += count
        numbers = numbers_of(version, runs, rng)
        assert census(text_of(version, numbers), width_of) == expected


@pytest.mark.parametrize("version", VERSIONS)
def test_sections_whose_numbers_do_not_fit_have_no_count(version):
    rng = np.random.default_rng(7)
    numbers = numbers_of(version, [(9, 20), (2, 3)], rng)
    total = 1 if version[0] == "4" else 0
    more, fewer = list(numbers), list(numbers)
    more[total] += 1
    fewer[total] -= 1
    for damaged in (numbers[:-1], [*numbers, 1], more, fewer):
        assert census(text_of(version, damaged), width_of) is None


def test_blocks_of_version_4_are_not_taken_for_those_of_4_1():
    """From its third number on, this section reads as one of version 4.1 as well, with other elements."""
    lines = [number for own in (1, 2, 3, 4) for number in (own, 1, 1, 1, own, own, own % 4 + 1)]
    section = [5, 5, *lines, 6, 2, 3, 1, 5, 1, 2, 3, 4]
    widths = {1: 2, 2: 3, 3: 4, 4: 4, 5: 8}
    assert census(text_of("4", section), lambda kind: widths.get(kind, 0)) == Counter({1: 4, 3: 1})
