"""Pictures in axes of matplotlib, in the coordinates of the data where the view is along an axis."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.core.base.needing import require_module
from elvis.scene.figure.rulers import aligned
from elvis.scene.model.style import ColorBar

if TYPE_CHECKING:
    from elvis.scene.record.frame import Frame, Legend


def plot_frame(frame: Frame, axes: Any, colorbar: bool) -> Any:
    """See `Frame.plot`."""
    require_module("matplotlib", "a plot", "figures")
    if axes is None:
        from matplotlib import pyplot

        axes = pyplot.subplots()[1]
    place = _Place(frame)
    aspect = "equal" if frame.ordinate is None else "auto"
    image = axes.imshow(frame.image, extent=place.extent, interpolation="nearest", aspect=aspect)
    if place.names:
        axes.set(xlabel=place.names[0], ylabel=place.names[1])
    else:
        axes.set_axis_off()
    _draw_strokes(frame, axes, place)
    # the curves must not widen what imshow shows
    left, right, bottom, top = place.extent
    axes.set(xlim=(left, right), ylim=(bottom, top))
    for legend in frame.legends if colorbar else ():
        if legend.palette is not None and legend.constant is None:
            _add_bar(axes, legend)
    return image


class _Place:
    """Position of the pixels in the axes.

    names   coordinates along columns and rows; empty if the view is not along an axis
    extent  left, right, bottom and top edge
    """

    def __init__(self, frame: Frame) -> None:
        view = frame.view
        self._origin = np.zeros(2)
        self._step = np.array([1.0, 1.0])
        self.names: tuple[str, ...] = ()
        axes = aligned(view.camera)
        if axes is not None:
            corner = np.asarray(view.camera.eye) + view.corner
            self._origin = np.array([corner[axes[0]], corner[axes[1]]])
            self._step = np.array([view.column[axes[0]], view.row[axes[1]]])
            self.names = tuple("xyz"[axis] for axis in axes)
        if self.names and frame.ordinate is not None:
            own = frame.ordinate
            self._origin[1] = own.base + self._origin[1] / own.scale
            self._step[1] /= own.scale
            self.names = (self.names[0], own.name)
        ends = self.of(np.array([[-0.5, -0.5], [view.width - 0.5, view.height - 0.5]]))
        self.extent = (*ends[:, 0].tolist(), ends[1, 1].item(), ends[0, 1].item())

    def of(self, pixels: Floats) -> Floats:
        """(n, 2) coordinates of places in columns and rows (n, 2)."""
        return np.asarray(self._origin + self._step * pixels)


def _draw_strokes(frame: Frame, axes: Any, place: _Place) -> None:
    """The lines that a picture for vector files has besides its pixels."""
    from matplotlib.collections import LineCollection

    for stroke in () if frame.drawing is None else frame.drawing.strokes:
        curves = [place.of(line) for line in stroke.lines if len(line) > 1]
        look: dict[str, Any] = {"colors": [stroke.color], "linewidths": 0.75 * stroke.width, "alpha": stroke.opacity}
        axes.add_collection(LineCollection(curves, **look))


def _add_bar(axes: Any, legend: Legend) -> None:
    """A colour bar with the title and the marks that the scene wants."""
    from matplotlib.cm import ScalarMappable

    from elvis.scene.figure.bar import value_norm
    from elvis.scene.figure.broken_lines import bar_title

    assert legend.palette is not None
    own = legend.bar or ColorBar()
    bar = axes.figure.colorbar(ScalarMappable(*value_norm(legend.palette, own)), ax=axes, label=bar_title(legend))
    if own.ticks:
        bar.set_ticks(list(own.ticks))
    bar.minorticks_off()
