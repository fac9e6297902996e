"""Results that are retained take a bounded number of bytes, whatever their number."""

from dataclasses import dataclass

import numpy as np
import pytest

from elvis.core.base import bounded_cache
from elvis.core.polynomials import boxnets
from elvis.core.polynomials.bernstein import BernsteinSpace
from elvis.core.shapes import Shape


@dataclass(frozen=True)
class Pair:
    first: np.ndarray
    second: tuple[np.ndarray, ...]


@pytest.fixture(autouse=True)
def empty():
    bounded_cache.clear()
    yield
    bounded_cache.clear()


def test_arrays_are_counted_in_every_container():
    one = np.zeros(1000)
    assert bounded_cache.array_bytes(one) == 8000
    assert bounded_cache.array_bytes(one[:10]) == 8000  # a view keeps all of it
    assert bounded_cache.array_bytes(Pair(one, (one, [one], {"a": one}))) == 4 * 8000
    assert bounded_cache.array_bytes("a text") == 0


def test_the_least_recently_used_results_are_dropped(monkeypatch):
    monkeypatch.setattr(bounded_cache, "MAX_BYTES", 30_000)
    calls = []

    @bounded_cache.bounded_cache
    def table(number, *, power=1):
        calls.append(number)
        return np.full(1000, float(number) ** power)

    for number in (1, 2, 3, 1, 4, 1):
        assert table(number)[0] == number
    assert calls == [1, 2, 3, 4]
    table(2)
    assert calls == [1, 2, 3, 4, 2]
    assert table(2, power=2)[0] == 4
    assert sum(bounded_cache.cached_bytes().values()) <= 30_000


def test_a_result_larger_than_the_cache_stays_until_the_next(monkeypatch):
    monkeypatch.setattr(bounded_cache, "MAX_BYTES", 10)
    calls = []

    @bounded_cache.bounded_cache
    def table(number):
        calls.append(number)
        return np.zeros(number)

    for number in (5, 5, 6, 5):
        table(number)
    assert calls == [5, 6, 5]


def test_tables_of_high_degrees_do_not_pile_up():
    for degree in range(8, 17):
        boxnets._to_box(BernsteinSpace(Shape.TETRAHEDRON, (degree,)))
    held = bounded_cache.cached_bytes()
    assert "elvis.core.polynomials.boxnets._to_box" in held
    assert sum(held.values()) <= bounded_cache.MAX_BYTES
