"""Rays through elements with models of the inverse map: pictures are those that Newton's method gives."""

from dataclasses import replace

import numpy as np
import pytest

from elvis import Camera, Status
from elvis.core.chebyshev_models.inverse_maps import at_points, inverse_maps, to_powers
from elvis.core.chebyshev_models.model_boxes import ShapeFacets
from elvis.core.chebyshev_models.series import coefficients_of
from elvis.core.mapping.margins import facets
from elvis.core.polynomials.chebyshev_nodes import series
from elvis.core.shapes import Shape
from elvis.core.testing import curved, grid, with_field
from elvis.renderer.passes.volume import inverses
from elvis.scene import Transfer, VolumeRendering

CAMERA = Camera((3.0, -4.0, 2.5), (0.5, 0.55, 0.55), height=1.9)
SIZE = (40, 32)
VOLUME = VolumeRendering(
    Transfer((-1.0, 0.2, 1.0), (2.0, 0.0, 3.0), ((0.1, 0.2, 0.9), (1.0, 1.0, 1.0), (0.9, 0.1, 0.0)))
)


def waves(p):
    return np.sin(3.0 * p[..., 0] + 2.0 * p[..., 1]) * np.cos(2.0 * p[..., 2])


def bent(p):
    x, y, z = np.moveaxis(p, -1, 0)
    return np.stack([x + 0.03 * np.sin(2 * y), y + 0.03 * np.sin(2 * z + x), z + 0.03 * x * y], axis=-1)


def picture(draw, monkeypatch, data, pixels):
    monkeypatch.setattr(inverses, "_PIXELS_OF_A_BOX", pixels)
    return draw(data, camera=CAMERA, size=SIZE, objects=(VOLUME,))


@pytest.mark.parametrize("shape", [Shape.HEXAHEDRON, Shape.PRISM, Shape.TETRAHEDRON])
def test_pictures_by_models_are_those_by_newtons_method(shape, draw, monkeypatch):
    data = with_field(curved(grid(shape, 2), bent, 6), waves, 6)
    found = list[int]()
    known = inverses.InverseMaps.joined
    monkeypatch.setattr(inverses.InverseMaps, "joined", lambda several: found.append(1) or known(several))
    newton, models = (picture(draw, monkeypatch, data, pixels) for pixels in (np.inf, 1e-9))
    assert found
    seen = newton.status == Status.CERTAIN
    assert seen.sum() > 300
    assert np.array_equal(newton.status, models.status)
    assert 0.0 < np.abs(newton.color - models.color).max() < 1e-4


def bulged(p):
    """The unit cube, bent inside."""
    bulge = np.prod(p * (1.0 - p), axis=-1)
    return p + 0.5 * bulge[..., None] * np.array([1.0, -0.7, 0.5])


def test_models_are_found_for_the_largest_elements_and_kept(monkeypatch):
    """While there is room for their boxes; elements that gain pixels are added to those that are known."""
    rng, count = np.random.default_rng(3), 5
    line = series(count - 1)[0]
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    own = coefficients_of(np.stack([x + 0.002 * y * z, y, z + 0.002 * x * x]))
    maps = np.repeat(own[None], 6, axis=0) * rng.uniform(1.0, 2.0, (6, 1, 1, 1, 1))
    inside = ShapeFacets(np.column_stack(facets(Shape.HEXAHEDRON)))
    known = inverses.KnownInverses(np.zeros(6, np.int64))
    monkeypatch.setattr(inverses, "_MOST_BOXES", 4)
    pixels = np.array([10, 100, 300, 0, 90, 200])
    known.add(maps, inside, pixels)
    assert sorted(np.concatenate([own.element for own in known.found])) == [1, 2, 4, 5]
    known.add(maps, inside, pixels + 1000)
    assert sum(map(len, known.found)) == 4
    monkeypatch.setattr(inverses, "_MOST_BOXES", 100)
    known.add(maps, inside, pixels + 1000)
    assert sorted(np.concatenate([own.element for own in known.found])) == list(range(6))


@pytest.mark.parametrize("shape", [Shape.HEXAHEDRON, Shape.PRISM])
def test_light_through_models_has_its_closed_form(shape, draw, monkeypatch):
    """The density rises linearly in a cube whose elements are bent inside: its integral along a ray is quadratic."""
    rise = np.array([0.3, 0.5, 0.1])
    data = with_field(curved(grid(shape, 2), bulged, 7), lambda p: 0.05 + p @ rise, 7)
    monkeypatch.setattr(inverses, "_PIXELS_OF_A_BOX", 1e-9)
    found = list[int]()
    known = inverses._terms
    monkeypatch.setattr(inverses, "_terms", lambda models: found.append(len(models)) or known(models))
    look = VolumeRendering(Transfer((0.0, 1.0), (0.0, 2.0), ((1.0, 1.0, 1.0), (1.0, 1.0, 1.0))))
    frame = draw(data, camera=CAMERA, size=SIZE, objects=(look,), background=(0.0, 0.0, 0.0))
    assert sum(found) > 0
    # where rays enter and leave the cube
    origins, directions = frame.view.rays_of(np.arange(frame.view.count))
    ends = np.sort([-origins / directions, (1.0 - origins) / directions], axis=0)
    first, last = ends[0].max(axis=1), ends[1].min(axis=1)
    length = np.maximum(last - first, 0.0) * np.linalg.norm(directions, axis=1)
    middle = origins + 0.5 * (first + last)[:, None] * directions
    expected = -np.expm1(-2.0 * length * (0.05 + middle @ rise))
    certain = frame.status.reshape(-1) == Status.CERTAIN
    assert np.array_equal(certain, length > 0.0)
    assert np.abs(frame.color.reshape(-1, 3) - expected[:, None]).max() < 1e-5


def line_through(rng, number):
    """Ends (3,) of a part of a line in the cube [-1, 1]^3, which changes coordinates by 2 / ``number`` at most."""
    middle, change = rng.uniform(-1, 1, 3), rng.choice((-1.0, 1.0), 3) * rng.uniform(0.5, 1.0, 3)
    change *= 1.0 / (number * np.abs(change).max())
    middle = np.clip(middle, -1.0 + np.abs(change), 1.0 - np.abs(change))
    return middle - change, middle + change


@pytest.mark.parametrize("degree", [6, 10])
def test_fields_are_within_the_stated_errors_of_polynomials_along_rays(degree):
    """The errors of polynomials through Chebyshev points, in models whose own error is zero."""
    rng, count = np.random.default_rng(degree), 8
    line = series(count - 1)[0]
    z, y, x = np.meshgrid(line, line, line, indexing="ij")
    map_of_element = coefficients_of(bent(0.25 * np.stack([x, y, z], axis=-1)).transpose(3, 0, 1, 2))[None]
    inside = ShapeFacets(np.column_stack(facets(Shape.HEXAHEDRON)))
    models = replace(inverse_maps(map_of_element, inside, np.array([0]), 1), error=np.zeros(8))
    field = coefficients_of(np.cos(2.0 * x + 0.6 * rng.uniform(-1, 1, (8, 1, 1, 1))) * np.sin(1.5 * y + z))
    worst = 0.0
    for number in inverses._PIECES:
        off, pieces = inverses.errors_along_rays(
            models, field, np.zeros(8), degree, allowed_with(number, models, field, degree)
        )
        for k in np.flatnonzero(pieces == number):
            for _ in range(40):
                miss = miss_along(models.part(slice(k, k + 1)), field[k], *line_through(rng, number), degree)
                assert miss <= off[k]
                worst = max(worst, miss / off[k])
    assert worst > 1e-4


def allowed_with(number, models, field, degree):
    """An allowed error that most boxes meet with so many pieces."""
    magnitudes = np.abs(field)
    magnitudes[:, 0, 0, 0] = 0.0
    return 1.01 * np.median(inverses._tails(np.abs(models.series), magnitudes, degree, number)) + 1e-10


def miss_along(model, field, first, last, degree):
    """Largest difference of the field from its polynomial through Chebyshev points along a part of a ray."""

    def values(t):
        y = 0.5 * ((1 - t)[:, None] * first + (1 + t)[:, None] * last)
        v = at_points(to_powers(model.series), y.T[None])[0]
        basis = [np.polynomial.chebyshev.chebvander(v[axis], field.shape[-1] - 1) for axis in range(3)]
        return np.einsum("cba,na,nb,nc->n", field, *basis, optimize=True)

    nodes = np.cos(np.pi * np.arange(degree + 1) / degree)
    fitted = np.polynomial.chebyshev.Chebyshev.fit(nodes, values(nodes), degree, domain=(-1, 1))
    t = np.linspace(-1, 1, 101)
    return np.abs(fitted(t) - values(t)).max()
