"""Of families of tests samples run: the same for a seed, with each value of each parameter that is not free."""

from dataclasses import dataclass, field
from itertools import product
from types import SimpleNamespace

import pytest


@dataclass(frozen=True)
class Case:
    """What is asked of an item of pytest."""

    shape: int
    view: int
    seed: int
    mark: object = field(compare=False)

    @property
    def callspec(self):
        return SimpleNamespace(params={"shape": self.shape, "view": self.view, "seed": self.seed})

    def get_closest_marker(self, name):
        return self.mark


@pytest.fixture
def tests(request, root):
    """The module that pytest has made of the tests' conftest.py."""
    return request.config.pluginmanager.get_plugin(str(root / "tests" / "conftest.py"))


def cases(mark):
    return [Case(*numbers, mark) for numbers in product(range(4), range(2), range(10))]


@pytest.mark.parametrize("name", ["a", "b", "c"])
def test_each_value_occurs_in_a_minimal_sample(tests, name):
    chosen = tests.sample(name, cases(SimpleNamespace(kwargs={"free": ("seed",)})))
    assert {case.shape for case in chosen} == set(range(4))
    assert {case.view for case in chosen} == {0, 1}
    assert len(chosen) == 4
    assert len({case.seed for case in tests.sample(name, cases(SimpleNamespace(kwargs={})))}) == 10


def test_a_larger_sample_is_chosen_on_request(tests):
    chosen = tests.sample("a", cases(SimpleNamespace(kwargs={"least": 7, "free": ("seed",)})))
    assert len(chosen) == len(set(chosen)) == 7


def test_each_seed_has_its_sample(tests, monkeypatch):
    family = cases(SimpleNamespace(kwargs={"free": ("seed",)}))
    first, again = tests.sample("a", family), tests.sample("a", family)
    assert first == again
    assert first != tests.sample("b", family)
    monkeypatch.setattr(tests, "SEED", "another")
    assert first != tests.sample("a", family)


def test_families_without_the_marker_are_whole(tests):
    assert tests.sample("a", cases(None)) == cases(None)


@pytest.mark.sampled
@pytest.mark.parametrize("shape", range(3))
@pytest.mark.parametrize("view", range(3))
def test_pytest_formats_values_like_these_cases(request, shape, view):
    """This family itself is sampled, unless it is named or all run."""
    assert request.node.callspec.params == {"shape": shape, "view": view}
    cases = [item for item in request.session.items if item.originalname == request.node.originalname]
    assert len(cases) in (3, 9) or "::" in " ".join(request.config.args)
