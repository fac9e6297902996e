"""Drawing cases on a device, and validating them."""

from time import perf_counter, process_time
from zlib import crc32

import numpy as np

from audit.families import FAMILIES
from audit.validating import Count
from elvis import Renderer, Scene, SceneError
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.plugins.runtime.serving import volume_of
from elvis.reference.picture import render as reference
from elvis.renderer.asking.completing import completed
from elvis.scene.cameras.view import View
from elvis.scene.model.quantities import quantities
from elvis.scene.model.time_limit import ObsoleteError, stopped_when
from elvis.scene.record.frame import Drawing, Frame, Status


def case_of(family, seed, number, size=None):
    """One case of a family, by its number in the sequence of a seed."""
    make, usual, _ = FAMILIES[family]
    return make(np.random.default_rng([seed, crc32(family.encode()), number]), size=size or usual)


class GivenUpError(ElvisError):
    """A picture that took longer than it was given."""


class Gallery:
    """A device kept open for many pictures; ``reference`` is NumPy.

    limit  processor seconds after which a picture is given up: a busy machine changes nothing; None waits for ever
    """

    def __init__(self, device="auto", limit=None):
        self.device, self.limit = device, limit
        self.renderer = None if device == "reference" else Renderer(device)

    def close(self):
        if self.renderer is not None:
            self.renderer.device.close()

    def frame(self, data, scene):
        """The frame of a scene; one of misses where the scene is rejected since nothing would be seen.

        GivenUpError where it takes too long.
        """
        until = float("inf") if self.limit is None else process_time() + self.limit
        try:
            with stopped_when(lambda: process_time() > until):
                return self._frame(data, scene)
        except ObsoleteError as error:
            raise GivenUpError(f"not done after {self.limit:g} processor seconds") from error

    def _frame(self, data, scene):
        try:
            if isinstance(data, Dataset):
                scene = completed(data, scene)
            if self.renderer is None:
                return reference(data, scene)
            if isinstance(data, Dataset):
                self.renderer.load(data, *quantities(scene))
            else:
                self.renderer.show(volume_of(data, quantities(scene)))
            return self.renderer.render(scene)
        except SceneError as error:
            return _nothing(scene, str(error))

    def count(self, case):
        """The count of one case; pixels of pictures that could not be made have failed."""
        start = perf_counter()
        try:
            frame = case.draw(self, case) if case.draw else self.frame(case.data, Scene(**case.scene))
        except GivenUpError as error:
            return Count(given_up=1, seconds=perf_counter() - start, slow=[f"{case.name}: {error}"])
        except Exception as error:
            # a crash is a failure of all pixels, and the next case follows
            pixels = int(np.prod(case.scene.get("size", (1, 1))))
            return Count(
                1,
                pixels,
                failed=pixels,
                first=[f"{case.name}: {type(error).__name__}: {error}"],
                seconds=perf_counter() - start,
            )
        found = case.count(case, frame)
        found.seconds = perf_counter() - start
        return found


def _nothing(scene, why):
    """A frame of misses."""
    view = View.through(scene.camera, scene.size)
    shape = (view.height, view.width)
    nan = np.full(shape, np.nan)
    vectors = np.full((*shape, 3), np.nan)
    drawing = Drawing(np.full(shape, np.inf), vectors, np.broadcast_to(scene.background, (*shape, 3)), ())
    missed = np.full(shape, Status.MISS, np.uint8)
    return Frame(scene, view, nan, np.full(shape, -1), vectors, missed, {"remarks": [why]}, drawing)
