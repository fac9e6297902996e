"""Models of sub-elements: the terms of low degree of their series, with bounds of all that they leave out."""

import numpy as np
import pytest
from kernel_functions import parted, rows_of, width_of
from numpy.polynomial import chebyshev
from sub_elements import COUNT, LEBESGUE, ORDER, SUMMED, UNIT, SubElements, outside_of, terms_at

FOUND = {
    "series": 4,
    "beyond": 4,
    "moved": 1,
    "error": 1,
    "derivative_error": 1,
    "degree": 1,
    "terms": 1,
    "value": 4,
    "x": 4,
    "y": 4,
    "z": 4,
    "position": 3,
    "dx": 3,
    "dz": 3,
}
#: logarithms are in single precision
SINGLE = 1e-6
#: largest error of models, and of models of the highest degree in multiples of that: some cases have none
MODEL_OFF, COARSE = 0.02, 100


class Models(SubElements):
    """Sub-elements with points where their models are evaluated."""

    def __init__(self, rng):
        super().__init__(rng, np.geomspace(1e-3, 1, COUNT)[:, None, None])
        self.steepest, self.stretch, self.half_hessian = rng.uniform(1, 2, (3, COUNT))
        self.s = rng.uniform(-1, 1, (COUNT, 3))
        self.steps = self.inverse.swapaxes(1, 2)

    def rows(self):
        columns = [
            *[self.centre, self.half, self.own, self.across, self.misplaced, self.perspective, self.grid_values],
            *[
                self.grid_places,
                self.steps,
                self.steepest,
                self.stretch,
                self.half_hessian,
                self.c,
                self.s,
                self.series,
            ],
        ]
        return rows_of(COUNT, columns)


@pytest.fixture(scope="module")
def models():
    return Models(np.random.default_rng(16))


@pytest.fixture(scope="module")
def found(functions, models):
    kernel = functions("iso_truncate")
    given = {"model_off": np.array([MODEL_OFF]), "models": np.zeros(4 * 64 * COUNT)}
    (found,) = parted(kernel(models.rows(), width_of([FOUND]), **given), [FOUND])
    return found


def test_models_have_the_terms_up_to_their_degree(models, found):
    low = np.where((ORDER <= 2)[:, None], models.series, 0).reshape(COUNT, 3, 3, 3, 4).transpose(3, 2, 1, 0, 4)
    for name, axes in {"value": (), "x": (0,), "y": (1,), "z": (2,)}.items():
        own = low
        for axis in axes:
            own = chebyshev.chebder(own, axis=axis)
        values = [[chebyshev.chebval3d(*models.s[n], own[..., n, k]) for k in range(4)] for n in range(COUNT)]
        assert found[name] == pytest.approx(np.array(values), rel=1e-9, abs=1e-12)
    # lines x^0, x^1 and x^2 of 2, 2 and 4 numbers
    assert (found["terms"] == 3 * 2 + 2 * 2 + 4).all()

    weight = np.where(models.perspective > 0, found["value"][:, 2] + 5, 1)
    aside = models.s[:, :2]
    position = np.column_stack([found["value"][:, :2] - aside * weight[:, None], found["value"][:, 2] + 5])
    assert found["position"] == pytest.approx(position, rel=1e-9, abs=0)
    for name, slope in (("dx", found["x"]), ("dz", found["z"])):
        sheared = slope[:, :2] - (models.perspective[:, None] * aside) * slope[:, 2:3]
        assert found[name] == pytest.approx(np.column_stack([sheared, slope[:, 2]]), rel=1e-9, abs=1e-12)


def test_errors_of_models_have_left_terms_rounding_and_those_of_the_series(models, found):
    px, py = models.grid_places.T
    vx, vy = models.grid_values.T
    amplification = LEBESGUE * outside_of(models, np.ones(COUNT))
    places = amplification * np.maximum(models.misplaced, py) + px
    levels = np.stack([2 * models.across, 2 * models.across, np.ones(COUNT)], axis=1)
    of_series = np.column_stack([places[:, None] * levels, amplification * np.maximum(models.own, vy) + vx])
    assert found["series"] == pytest.approx(of_series, rel=SINGLE)

    sizes = terms_at(models.c, (0, 0, 0))[..., None] * np.abs(models.series)
    whole, left = sizes.sum(axis=1), sizes[:, ORDER > 2].sum(axis=1)
    rounded = 15 * 3 * UNIT * (models.c + np.sqrt(models.c**2 + 1)) ** 2
    growth = chebyshev.chebval(models.c, [0, 0, 1]) ** 3
    beyond = left + rounded[:, None] * whole + growth[:, None] * (of_series + SUMMED * whole)
    assert found["beyond"] == pytest.approx(beyond, rel=SINGLE)

    # errors of distances move points by twice as many steps, and those of pixels away from the middle by more
    aside = np.where(models.perspective[:, None] > 0, [[9.0, 19.0]], 0)
    off = np.column_stack([beyond[:, :2] + aside * beyond[:, 2:3], beyond[:, 2]])
    moved = 2 * np.einsum("nij,ni->nj", np.abs(models.steps), off).max(axis=1)
    error = beyond[:, 3] + models.steepest * moved
    turned = 3 * 4 * error + 4 * models.half_hessian * moved
    assert found["moved"] == pytest.approx(moved, rel=SINGLE)
    assert found["error"] == pytest.approx(error, rel=SINGLE, abs=0)
    assert found["derivative_error"] == pytest.approx(turned * models.stretch, rel=SINGLE, abs=0)
    is_close = np.maximum(moved, error / models.steepest) <= COARSE * MODEL_OFF
    assert np.array_equal(found["degree"], np.where(is_close, 2, 0))
    assert 0 < is_close.sum() < COUNT
