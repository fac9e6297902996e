"""Streamlines and glyphs of a scene: their drawing, ends and lengths."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import TypeAlias

from elvis.core.base.arrays import Floats
from elvis.core.base.errors import ElvisError
from elvis.core.data.dataset import Dataset
from elvis.core.streamlines.endings import WORDS, End
from elvis.core.streamlines.flow_data import FlowSource
from elvis.core.streamlines.lines.pieces import Curves
from elvis.plugins.runtime.host.flow import HostFlow
from elvis.plugins.runtime.opening import PluginData
from elvis.renderer.frame.draw_calls import DrawCall
from elvis.renderer.passes.glyphs.glyphs import GlyphDrawer
from elvis.renderer.passes.pieces.in_view import Girth
from elvis.renderer.passes.ribbons.ribbons import RibbonDrawer
from elvis.renderer.passes.streams.following import Followers
from elvis.renderer.passes.tubes.tubes import TubeDrawer
from elvis.renderer.raster.hit_buffer import HitBuffer
from elvis.renderer.volume.device_volume import DeviceVolume
from elvis.scene import Glyphs, Scene, Streamlines, Style
from elvis.scene.cameras.view import View
from elvis.scene.flow.flow import RADIUS, curves_in, heads_in, ribbons_in
from elvis.scene.flow.frusta import Frusta, frusta_in, keys_of
from elvis.scene.model.errors import SceneError
from elvis.scene.record.frame import Legend

#: source of a volume: a dataset, or data opened by a runtime plugin; None if unknown
Made: TypeAlias = Dataset | PluginData | None


class FlowStage:
    """Computes and draws vectors in a loaded volume.

    made_of  source of the volume; None if unknown
    """

    def __init__(self, loaded: DeviceVolume, made_of: Made) -> None:
        self.loaded, self._made_of = loaded, made_of

    @cached_property
    def _tube_drawer(self) -> TubeDrawer:
        return TubeDrawer(self.loaded)

    @cached_property
    def _ribbon_drawer(self) -> RibbonDrawer:
        return RibbonDrawer(self.loaded)

    @cached_property
    def _glyph_drawer(self) -> GlyphDrawer:
        return GlyphDrawer(self.loaded)

    @cached_property
    def _followers(self) -> Followers:
        """Tracers of lines on the device."""
        device = self.loaded.device
        return Followers(lambda: device)

    def _curves_of(self, item: Streamlines) -> Curves:
        """The lines of an object."""
        return curves_in(self._data, item, self._followers)

    def _frusta_of(self, item: Glyphs) -> Frusta:
        """The solids of an object."""
        return frusta_in(self._data, item)

    def lines(self, name: str, item: Streamlines, own: str | None) -> list[DrawCall]:
        """Streamlines, coloured by a quantity of the volume, and arrow heads along them."""
        lines = self._tubes(name, item, own) if item.ribbon is None else self._ribbons(name, item, own)
        if item.arrows is None:
            return [lines]
        heads = heads_in(self._data, item, self._followers)
        return [lines, self._solids(f"{name} arrows", item.style, heads, own, lines.lit)]

    @cached_property
    def _data(self) -> FlowSource:
        """The data in which lines are traced; SceneError if a runtime plugin doesn't describe its elements in NumPy."""
        if self._made_of is None:
            raise SceneError("streamlines and glyphs: expected a dataset, found only a volume")
        if isinstance(self._made_of, Dataset):
            return self._made_of
        try:
            return HostFlow(self._made_of)
        except ElvisError as error:
            raise SceneError(str(error)) from error

    def _ribbons(self, name: str, item: Streamlines, own: str | None) -> DrawCall:
        """Streamlines as ribbons."""
        assert item.ribbon is not None
        found = ribbons_in(self._data, item, self._followers)
        girth = Girth(0.5 * item.ribbon, None)

        def draw(view: View, beyond: Floats | None) -> HitBuffer:
            return self._ribbon_drawer.draw(view, found, girth, beyond, own)

        return DrawCall(name, item.style, own, draw, item.style.lit is not False)

    def _tubes(self, name: str, item: Streamlines, own: str | None) -> DrawCall:
        """Streamlines as tubes or lines of a width in pixels."""
        found = self._curves_of(item)
        default = None if item.width is not None else RADIUS * found.size
        girth = Girth(item.radius or default, item.width)

        def draw(view: View, beyond: Floats | None) -> HitBuffer:
            return self._tube_drawer.draw(view, found.pieces, girth, beyond, own)

        lit = item.width is None if item.style.lit is None else item.style.lit
        return DrawCall(name, item.style, own, draw, lit)

    def glyphs(self, name: str, item: Glyphs, own: str | None) -> DrawCall:
        """The draw call of arrows and cones."""
        return self._solids(name, item.style, self._frusta_of(item), own, item.style.lit is not False)

    def _solids(self, name: str, style: Style, found: Frusta, own: str | None, lit: bool) -> DrawCall:
        """Solids across axes."""

        def draw(view: View, beyond: Floats | None) -> HitBuffer:
            return self._glyph_drawer.draw(view, found, beyond, own)

        return DrawCall(name, style, own, draw, lit)

    def keys(self, scene: Scene, view: View) -> tuple[Legend, ...]:
        """How long the glyphs of a scene are."""
        if not any(isinstance(item, Glyphs) for item in scene.every_object):
            return ()
        return keys_of(self._data, scene, view)

    def remarks(self, scene: Scene) -> Iterator[str]:
        """Sentences on lines that end where nobody asked them to, and on points without a glyph."""
        for item in scene.every_object:
            if isinstance(item, Streamlines):
                yield from self._endings(item)
                yield from self._missing_heads(item)
            if isinstance(item, Glyphs):
                left = self._frusta_of(item).left
                yield from (f"points of glyphs that {why}: {count}" for why, count in left.items())

    def _missing_heads(self, item: Streamlines) -> Iterator[str]:
        """A remark if lines are too short for arrow heads."""
        if item.arrows is None or not len(self._curves_of(item).pieces):
            return
        if not len(heads_in(self._data, item, self._followers).element):
            yield f"streamlines: no line is as long as the spacing of its arrows, {item.arrows:g}"

    def _endings(self, item: Streamlines) -> Iterator[str]:
        found = self._curves_of(item)
        ends = found.ends
        yield from found.remarks
        if item.seeds and not len(found.pieces):
            yield f"streamlines: none is drawn, as none of the {found.lines} lines moves"
        for end in (End.OUTSIDE, End.STEPS, End.JUMP, End.NAN, End.INVERTED, End.FAILED):
            name, meaning = WORDS[end]
            if name in ends:
                yield f"streamlines, {name}: {ends[name]} of {sum(ends.values())} lines {meaning}"
