"""A sample of the audit of `benchmarks/exactness.py`: nothing certain is wrong; and the audit sees what is."""

from dataclasses import replace

import numpy as np
import pytest
from audit import integrals, levels
from audit.families.expressions import Rays, Values, crossings
from audit.running import Gallery, case_of
from audit.validating import Count
from audit.worlds import margins

from elvis import Scene, Status
from elvis.core.numbers.sampling import sample
from elvis.scene.cameras.view import View
from elvis.scene.record.frame import Drawing, Frame

SEED = 1
#: families, and cases of theirs whose kernels other tests need as well
SAMPLE = {
    "cuts": (2, 5, 8),
    "faces": (3, 7),
    "isosurfaces: multiplicity": (2, 3),
    "isosurfaces: touching": (0, 5),
    "isosurfaces: sheets": (3, 4),
    "isosurfaces: near pairs": (2,),
    "volumes": (5,),
    "volumes: kinks": (10,),
    "contours: expressions": (0,),
    "waves": (1,),
    "probes": (0, 1, 2, 3, 5),
}
#: all of them on the device that people use; of each family one on the other, where that takes few seconds
PICTURES = [("vulkan", name, number) for name, numbers in SAMPLE.items() for number in numbers]
PICTURES += [("reference", name, numbers[0]) for name, numbers in SAMPLE.items() if name != "volumes: kinks"]
#: families without a picture, which don't differ between devices
NUMBERS = {"lines": (1, 6), "differences": (0, 2)}


@pytest.fixture(scope="module")
def gallery():
    """An open device by name."""
    opened = {}

    def open_device(name):
        if name not in opened:
            opened[name] = Gallery(name)
        return opened[name]

    yield open_device
    for one in opened.values():
        one.close()


@pytest.mark.parametrize(("device", "family", "number"), PICTURES)
def test_nothing_certain_is_wrong(gallery, device, family, number):
    found = gallery(device).count(case_of(family, SEED, number, (44, 36) if device == "vulkan" else (36, 30)))
    assert not found.first
    assert found.wrong == found.failed == 0
    assert found.pixels > 100


@pytest.mark.parametrize(("family", "number"), [(name, n) for name, numbers in NUMBERS.items() for n in numbers])
def test_every_number_is_within_its_stated_error(gallery, family, number):
    found = gallery("reference").count(case_of(family, SEED, number))
    assert not found.first
    assert found.wrong == found.failed == 0
    assert found.pixels > 100


def test_two_nearly_coincident_faces_of_a_sliver_are_ambiguous(gallery):
    """A pixel of this picture showed the hind one of two faces 2e-11 of the depth apart, whose values differ."""
    found = gallery("vulkan").count(case_of("faces", 11, 6))
    assert found.wrong == found.failed == 0
    assert 0 < found.ambiguous < 1e-3 * found.pixels


@pytest.mark.thorough
@pytest.mark.sampled(least=2, free=("number",))
@pytest.mark.parametrize("number", [2, 7, 11, 14])
def test_two_lines_between_the_samples_of_a_pixel_are_both_drawn(gallery, number):
    """Pairs 0.03 to 0.07 pixels apart were drawn as one line between them, along the diagonal with gaps."""
    found = gallery("vulkan").count(case_of("contours: near pairs", 4, number))
    assert not found.first
    assert found.wrong == 0


@pytest.mark.parametrize("family", ["contours: poles", "contours: near pairs"])
def test_contours_of_the_reference_are_certain_where_they_are_right(gallery, family):
    total = Count()
    for number in range(10):
        total.add(gallery("reference").count(case_of(family, SEED, number, (36, 30))))
    assert not total.first
    assert total.wrong == total.failed == 0
    assert total.ambiguous < 0.03 * total.pixels
    assert total.pixels > 3000


def test_slow_pictures_of_the_reference_are_abandoned():
    found = Gallery("reference", 1e-6).count(case_of("isosurfaces: multiplicity", SEED, 1, (36, 30)))
    assert found.given_up == len(found.slow) == 1
    assert found.pixels == found.failed == 0


def test_no_sign_of_a_jacobian_is_wrong(gallery):
    total = Count()
    for number in (0, 2, 3, 6, 9, 14, 15, 17, 22, 23):
        total.add(gallery("reference").count(case_of("validity", SEED, number)))
    assert not total.first
    assert total.pixels > 200
    assert total.ambiguous < 0.1 * total.pixels


@pytest.fixture(scope="module")
def drawn(gallery):
    """A case with its frame."""

    def draw(family, number):
        case = case_of(family, SEED, number, (60, 50))
        return case, gallery("vulkan").frame(case.data, Scene(**case.scene))

    return draw


def spoilt(frame, **changes):
    """The frame with other depths, and whatever else."""
    depth = changes.pop("depth", frame.depth)
    drawing = Drawing(depth, frame.normal, frame.color, ())
    return replace(frame, drawing=drawing, **changes)


@pytest.mark.parametrize(("family", "number"), [("cuts", 5), ("faces", 7)])
def test_the_audit_detects_errors(drawn, family, number):
    case, frame = drawn(family, number)
    assert case.count(case, frame).wrong == 0
    there = frame.status == Status.CERTAIN
    pixel = tuple(np.argwhere(there)[there.sum() // 2])
    one = np.zeros(frame.status.shape, bool)
    one[pixel] = True
    diagonal = np.linalg.norm(np.ptp(frame.position[there], axis=0))
    faults = {
        "missed what must be seen": {"status": np.where(one, Status.MISS, frame.status)},
        "seen where nothing is": {"depth": np.where(one, frame.depth + 1e-6 * diagonal, frame.depth)},
        "the wrong value": {"field": np.where(one, frame.field + 1e-7 * np.ptp(frame.field[there]), frame.field)},
        "the wrong element": {"element": np.where(one, 10**6, frame.element)},
    }
    for kind, fault in faults.items():
        found = case.count(case, spoilt(frame, **fault))
        assert found.wrong == 1, kind
        assert kind in found.first[0]


def test_no_value_of_an_expression_is_beyond_its_certified_range(gallery):
    total = Count()
    for number in range(8):
        total.add(gallery("reference").count(case_of("ranges of expressions", SEED, number)))
    assert not total.first
    assert (total.pixels, total.failed, total.ambiguous) == (8, 0, 0)


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["proved", "any", "named"])
def test_the_audit_of_expressions_detects_errors(kind):
    """Of a frame that shows what samples show, without a device; its expressions have the values of `sample`."""
    case = case_of(f"expressions: {kind}", SEED, 0, (24, 18))
    own, fields, expression, level = case.count.args
    straight = np.random.default_rng(1).uniform(0.01, 0.99, (50, 3))
    values = expression.value(Values(own, fields, straight))
    found = sample(case.data, [expression.text], own.placed(own.bent(straight))).values[:, 0]
    np.testing.assert_allclose(found, values, 1e-9, 1e-9)

    view = View.through(case.scene["camera"], case.scene["size"])
    pixels, depths = crossings(Rays(own, fields, expression, level, view))
    nearest = np.full(view.count, np.inf)
    np.minimum.at(nearest, pixels, depths)
    frame = frame_of(case, own, view, nearest)
    assert case.count(case, frame).wrong == 0
    one = np.arange(view.count) == pixels[0]
    faults = {
        "missed what must be seen": np.where(one, np.inf, nearest),
        "seen where nothing is": nearest - np.where(one, 1e-6 * depths[0], 0.0),
    }
    for sentence, depth in faults.items():
        found = case.count(case, frame_of(case, own, view, depth))
        assert found.wrong == 1, sentence
        assert sentence in found.first[0]


def frame_of(case, own, view, depth):
    """A frame of depths (n,), with the elements that hold the places; all of it certain."""
    rows, hit = (view.height, view.width), np.isfinite(depth)
    origins, ways = view.every_ray()
    straight = own.straightened(origins + np.where(hit, depth, 0.0)[:, None] * ways)
    sides = own.sides()
    away = [margins(sides, np.full(view.count, element), straight) for element in range(len(sides))]
    element = np.where(hit, np.argmax(away, axis=0), -1).reshape(rows)
    nothing = np.full((*rows, 3), np.nan)
    drawing = Drawing(depth.reshape(rows), nothing, nothing, ())
    status = np.where(hit, Status.CERTAIN, Status.MISS).astype(np.uint8).reshape(rows)
    scene = Scene(**case.scene)
    return Frame(scene, view, np.full(rows, np.nan), element, nothing, status, {}, drawing)


@pytest.mark.parametrize(("refutation", "count"), [(integrals.refutation, 24), (levels.refutation, 8)])
def test_no_stated_error_of_a_sample_is_below_the_true_one(monkeypatch, refutation, count):
    """Fewer points than users have: bounds hold wherever refinement ends."""
    monkeypatch.setattr("elvis.core.integrals.refinement._MOST", 1 << 12)
    assert not [sentence for seed in range(count) if (sentence := refutation(seed))]
