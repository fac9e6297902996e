"""Series of leaves, and sub-elements that don't take a level as far as rounding and errors of values allow."""

import numpy as np
import pytest
from numpy.polynomial.chebyshev import chebval3d
from sub_elements import COUNT, LEBESGUE, POWERS, SUMMED, UNIT, outside_of

from elvis.core.polynomials.chebyshev_nodes import series

NODES, TO_CHEBYSHEV = series(2)


class Fields:
    """Polynomials on sub-elements, as series: their first coefficient, and the sum of all others."""

    def __init__(self, rng):
        self.polynomials = rng.uniform(-1, 1, (COUNT, 5, 27))
        self.centre, self.half = rng.uniform(-0.7, 0.2, (COUNT, 3)), rng.uniform(0.1, 0.5, (COUNT, 3))
        terms = self.terms(self.centre, self.half)[:, 3]
        self.middle = terms[:, 0]
        self.rest = np.abs(terms[:, 1:]).sum(axis=1)

    def terms(self, centre, half):
        """Chebyshev coefficients (n, 5, 27) of all functions on boxes."""
        places = centre[:, None] + half[:, None] * NODES[POWERS]
        powers = np.prod(places[:, :, None] ** POWERS, axis=3)
        values = np.einsum("nfk,npk->nfp", self.polynomials, powers)
        matrix = np.prod([TO_CHEBYSHEV[POWERS[:, None, k], POWERS[:, k]] for k in range(3)], axis=0)
        return values @ matrix.T


@pytest.fixture(scope="module")
def fields():
    return Fields(np.random.default_rng(19))


@pytest.fixture(scope="module")
def kernel(functions):
    return functions("iso_sift")


@pytest.mark.parametrize(("part", "avoids"), [(0.9, False), (1.1, True)])
def test_levels_are_avoided_beyond_all_terms_and_errors(kernel, fields, part, avoids):
    """The first coefficient exceeds the others, their rounding or the errors of values, to either side."""
    error, side = np.resize([0.0, 1e-3], COUNT), np.resize([-1, -1, 1, 1], COUNT)
    rounding = np.where(error == 0, SUMMED * 2 * fields.rest, LEBESGUE * outside_of(fields, np.ones(COUNT)) * error)
    apart = side * (fields.rest + part * rounding)
    given = {"polynomials": fields.polynomials, "nodes": NODES, "transform": TO_CHEBYSHEV}
    rows = np.column_stack([fields.centre, fields.half, error, fields.middle - apart])
    assert (kernel(rows, 1, **given)[:, 0] == avoids).all()


#: half sides of the boxes of series, and of those on which their bounds hold, relative to those of boxes
BOX_ROOM, BOX_REACH = 1.25, 1.12


@pytest.fixture(scope="module")
def boxes(functions, fields):
    """The kernel, boxes around sub-elements, some of which end inside of them, and the series on both (n, 27)."""
    kernel = functions(
        "iso_sift", "export static const bool in_boxes = true; export static const bool analytic = true;"
    )
    models = kernel.records("box_models", COUNT)
    models["centre"] = fields.centre
    models["half"] = np.where(np.arange(COUNT) % 4 == 3, 0.8, 1.05) * fields.half.max(axis=1) / BOX_REACH
    series = np.random.default_rng(3).uniform(-1, 1, (COUNT, 27))
    terms = np.empty((COUNT, 27))
    matrix = np.prod([TO_CHEBYSHEV[POWERS[:, None, k], POWERS[:, k]] for k in range(3)], axis=0)
    for k, (half, own) in enumerate(zip(fields.half / (BOX_ROOM * models["half"][:, None]), series, strict=True)):
        terms[k] = matrix @ chebval3d(*(half * NODES[POWERS]).T, own.reshape(3, 3, 3).T)
    return kernel, models, series, terms


@pytest.mark.parametrize(("part", "is_avoided"), [(0.9, False), (1.1, True)])
def test_levels_are_avoided_by_series_of_boxes_beyond_their_terms_and_errors(boxes, fields, part, is_avoided):
    """One of rounding, the errors of values and those of series is the largest; series hold as far as boxes reach."""
    kernel, models, series, terms = boxes
    first, rest = terms[:, 0], np.abs(terms[:, 1:]).sum(axis=1)
    kind, side = np.arange(COUNT) % 3, np.repeat([-1, 1], COUNT // 2)
    models["error"], models["misfit"][:, 0] = 1e-3 * (kind == 1), 1e-3 * (kind == 2)
    errors = LEBESGUE * outside_of(fields, np.ones(COUNT)) * models["error"] + models["misfit"][:, 0]
    rounding = SUMMED * (rest + np.abs(first) + np.abs(first - side * rest))
    level = first - side * (rest + part * (errors + rounding))
    rows = np.column_stack([fields.centre, fields.half, np.zeros(COUNT), level])
    found = kernel(rows, 1, box_models=models, leaf_series=series.reshape(-1))[:, 0]
    assert (found == (is_avoided & (np.arange(COUNT) % 4 != 3))).all()


def test_leaves_are_series_whose_rounding_grows_with_all_terms(functions, fields):
    """Of positions and fields on the cubes of elements: of coefficients in sum, and of sums of the series."""
    kernel = functions("iso_leaves")
    view = kernel.records("level_view", 1)
    view["count"] = COUNT
    given = {
        "level_view": view,
        "elements": np.arange(COUNT, dtype=np.uint32),
        "leaf_nodes": NODES,
        "leaf_chebyshev": TO_CHEBYSHEV,
        "polynomials": fields.polynomials,
        "leaf_series": np.zeros(5 * 27 * COUNT),
        "grid_errors": np.zeros(2 * 5 * COUNT),
    }
    found = kernel.results(COUNT, ["leaf_series", "grid_errors"], **given)
    terms = fields.terms(np.zeros((COUNT, 3)), np.ones((COUNT, 3)))
    assert found["leaf_series"].reshape(terms.shape) == pytest.approx(terms, abs=1e-13)
    parts = np.array([SUMMED, (15 * 9 + 3 * 4) * UNIT])
    errors = np.abs(terms).sum(axis=2)[..., None] * parts
    assert found["grid_errors"].reshape(errors.shape) == pytest.approx(errors, rel=1e-9, abs=0)
