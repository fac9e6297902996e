"""Velocities in elements' own coordinates, and what models of them leave out."""

import numpy as np
import pytest
from kernel_functions import rows_of

COUNT, DEGREE = 64, 7


def test_rates_solve_for_the_velocity_and_models_state_what_they_drop(functions):
    """A term of degree n + 1 that the map lacks changes its derivatives by (n + 1)^2 / half (Markov)."""
    rng = np.random.default_rng(9)
    frames, velocity = rng.uniform(-1, 1, (COUNT, 3, 3)), rng.uniform(-1, 1, (COUNT, 3))
    sign, step = rng.choice([-1, 1], COUNT), rng.uniform(-1, 1, (COUNT, 3))
    middle, half = rng.uniform(-0.5, 0.5, (COUNT, 3)), rng.uniform(0.1, 0.5, COUNT)
    of_map, of_field = rng.uniform(0, 1e-3, (COUNT, 3)), rng.uniform(0, 0.1, (COUNT, 3))
    part = rng.choice([0.5, 1.0], COUNT)
    away = rng.uniform(-1, 1, (COUNT, 3))
    away *= (part * half * rng.choice([0.99, 1.01], COUNT) / np.abs(away).max(axis=1))[:, None]
    columns = [frames, velocity, sign, step, middle, half, of_map, of_field, middle + away, part]
    found = functions("trace_motion")(rows_of(COUNT, columns), 11)

    rate = sign[:, None] * np.linalg.solve(frames.swapaxes(1, 2), velocity[..., None])[..., 0]
    assert found[:, :3] == pytest.approx(rate, rel=1e-9)
    assert found[:, 3] == pytest.approx(np.linalg.norm(velocity, axis=1), rel=1e-12)
    assert found[:, 4:7] == pytest.approx(np.einsum("ni,nij->nj", step, frames), rel=1e-12, abs=1e-14)
    assert np.array_equal(found[:, 7], np.sign(np.linalg.det(frames)))
    steepest = (DEGREE + 1) ** 2 / half * np.abs(rate).sum(axis=1)
    dropped = np.linalg.norm(of_field + steepest[:, None] * of_map, axis=1)
    assert found[:, 8] == pytest.approx(dropped, rel=1e-9)
    assert np.array_equal(found[:, 9], np.abs(away).max(axis=1) <= part * half)
    assert not found[:, 10].any()
