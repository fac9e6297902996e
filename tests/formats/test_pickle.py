"""Data go to other processes, as programs with several of them send them."""

import pickle

import numpy as np
import pytest

from elvis import Dataset, Shape, sample
from elvis.core.testing import approximated, curved, mixed_volume, ripple


@pytest.mark.parametrize("shape", Shape)
def test_shapes_are_unpickled_as_the_same_objects(shape):
    assert pickle.loads(pickle.dumps(shape)) is shape


def test_a_dataset_has_the_same_values_in_another_process():
    bare = Dataset(curved(mixed_volume(seed=2), ripple(0.05), n=3))
    data = Dataset(bare.mesh, (approximated(bare, "u", lambda x: np.sin(x[:, 0] + 2 * x[:, 2]), 4),), time=0.5)
    again = pickle.loads(pickle.dumps(data))
    points = np.random.default_rng(0).uniform(0, 1, (40, 3))
    assert again.time == 0.5
    np.testing.assert_array_equal(sample(again, "u", points).values, sample(data, "u", points).values)
