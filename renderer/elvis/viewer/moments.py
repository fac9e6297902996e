"""Data of a viewer: one state, or the steps of a series and the facts about all of them."""

from __future__ import annotations

from pathlib import Path
from time import sleep
from typing import TYPE_CHECKING, Any

from elvis.core.base.errors import ElvisError

if TYPE_CHECKING:
    from elvis.core.data.dataset import Dataset
    from elvis.core.data.moments import Moment
    from elvis.plugins.runtime.opening import PluginData
    from elvis.plugins.series.following import Following
    from elvis.plugins.series.series import Series
    from elvis.renderer.parts.bricks import Bricks
    from elvis.scene.model.whole import Scene
    from elvis.viewer.drawing_process import Source

#: steps at which values over time are found, at most
MOST_STEPS = 200


def source_of(
    scene: Scene, data: Dataset | PluginData | None = None, *, is_kept: bool = True, is_live: bool = False
) -> Source:
    """The source of a scene: data in memory, or its files, in bricks if the scene limits memory.

    is_kept  whether conversions are cached
    is_live  see `Source`
    """
    from elvis.renderer.asking.deformed_data import DeformedData
    from elvis.renderer.asking.request import reading_of
    from elvis.renderer.parts.bricks import opening_for
    from elvis.viewer.drawing_process import Source

    # what is known of the data before the first picture belongs to the geometry and the phase that it shows
    if data is not None:
        data = DeformedData(data, True).of(scene)
    return Source(scene.data, data, reading_of(scene, is_kept), scene.device, is_live, opening_for([scene]))


class Moments:
    """The data of a viewer at successive times.

    data   of the time that was shown last
    """

    def __init__(self, source: Source) -> None:
        """Open the data; ElvisError where they can't be read, or a run has no whole step yet."""
        from elvis.core.base.terminal import warn
        from elvis.core.data.moments import Moment
        from elvis.plugins.data.data import Reading, open_data
        from elvis.plugins.series.series import series_in

        reading = source.reading or Reading()
        files = tuple(map(Path, source.files))
        self._following: Following | None = None
        self._moment = reading.moment if source.data is None else Moment()
        self.series: Series | None = None
        self.data: Dataset | PluginData | Bricks
        if source.data is not None:
            self.data = source.data
        elif source.is_live:
            self.data = self._first(files, reading)
        else:
            self.series = series_in(files, reading)
            opening = source.opening or open_data
            found = self.series
            self.data = opening(files, reading, warn) if found is None else found.at_moment(self._moment)

    def _first(self, files: tuple[Path, ...], reading: Any) -> Dataset:
        """The newest step of a run."""
        from elvis.plugins.series.following import SOON, Following

        self._following = Following(files, reading)
        self._following.look()
        sleep(SOON)
        found = self._following.look()
        if found is None:
            raise ElvisError(self._following.waiting or "waiting for a complete step")
        self.series = self._following.series
        return found

    @property
    def times(self) -> list[float]:
        """Times of the steps, empty for one state."""
        return [] if self.series is None else [float(time) for time in self.series.times]

    def look(self) -> bool:
        """Whether there is a newer step of a run; it is shown where no other moment is requested."""
        found = None if self._following is None else self._following.look()
        if found is None or self._following is None:
            return False
        self.series = self._following.series
        if not self._moment.is_asked:
            self.data = found
        return True

    def at(self, moment: Moment) -> Dataset | PluginData | Bricks:
        """The data at a moment; ElvisError where there are none."""
        if self.series is not None and moment != self._moment:
            self.data = self.series.at_moment(moment)
            self._moment = moment
        return self.data

    def _steps(self) -> Series:
        if self.series is None:
            raise ElvisError("expected several steps of a series, found one state")
        return self.series

    def history(self, text: str, place: list[float]) -> dict[str, Any]:
        """Times, and exact values of a quantity at a place, None where it has none."""
        import numpy as np

        from elvis.core.numbers.sampling import sample

        series = self._steps().narrowed(text)
        numbers = np.unique(np.linspace(0, len(series) - 1, min(len(series), MOST_STEPS)).round().astype(int))
        times, values = [], []
        for number in numbers.tolist():
            try:
                found = sample(series.at(float(series.times[number])), text, [place])
            except ElvisError:
                continue  # a step that can't be read has no value
            value = float(found[text][0])
            times.append(float(series.times[number]))
            values.append(value if np.isfinite(value) else None)
        return {"name": text, "times": times, "values": values, "steps": len(series)}

    def range_of(self, text: str, scene: Scene) -> list[float]:
        """Certified bounds of a quantity over all steps, and over the copies in a scene."""
        from elvis.renderer.asking.series_range import range_over

        # a component on copies depends on those of its vector, so that no fields may be left out
        series = self._steps() if scene.copies else self._steps().narrowed(text)
        return list(range_over(text, series, scene))
