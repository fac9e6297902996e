"""Streamlines and glyphs of a scene: what is drawn of them, how they end, how long they are."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property

from elvis.core.arrays import Floats
from elvis.core.dataset import Dataset
from elvis.core.streamlines.endings import WORDS, End
from elvis.core.streamlines.line_pieces import Curves
from elvis.renderer.device_volume import DeviceVolume
from elvis.renderer.draw_calls import DrawCall
from elvis.renderer.hit_buffer import HitBuffer
from elvis.renderer.passes.glyphs.glyphs import GlyphDrawer
from elvis.renderer.passes.ribbons.ribbons import RibbonDrawer
from elvis.renderer.passes.streams.following import Followers
from elvis.renderer.passes.tubes.tubes import TubeDrawer
from elvis.renderer.pieces_in_view import Girth
from elvis.scene import Glyphs, Scene, Streamlines, Style
from elvis.scene.errors import SceneError
from elvis.scene.flow import RADIUS, curves_in, heads_in, ribbons_in
from elvis.scene.frame import Legend
from elvis.scene.frusta import Frusta, frusta_in, keys_of
from elvis.scene.view import View


class FlowStage:
    """What follows and draws vectors in a loaded volume.

    dataset  what the volume was made of; None where a runtime plugin has made it
    """

    def __init__(self, loaded: DeviceVolume, dataset: Dataset | None) -> None:
        self.loaded, self.dataset = loaded, dataset

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
        """What follows lines on the device."""
        device = self.loaded.device
        return Followers(lambda: device)

    def _curves_of(self, item: Streamlines) -> Curves:
        """The lines of an object; SceneError where nothing is known of the elements' neighbours."""
        return curves_in(self._known(), item, self._followers)

    def _frusta_of(self, item: Glyphs) -> Frusta:
        """The solids of an object; SceneError where nothing is known of the data but a runtime plugin's elements."""
        if self.dataset is None:
            raise SceneError("glyphs: expected elements of a dataset, found what a runtime plugin has opened")
        return frusta_in(self.dataset, item)

    def lines(self, name: str, item: Streamlines, own: str | None) -> list[DrawCall]:
        """Streamlines, coloured by a quantity of the volume, and arrow heads along them."""
        lines = self._tubes(name, item, own) if item.ribbon is None else self._ribbons(name, item, own)
        if item.arrows is None:
            return [lines]
        heads = heads_in(self._known(), item, self._followers)
        return [lines, self._solids(f"{name} arrows", item.style, heads, own, lines.lit)]

    def _known(self) -> Dataset:
        """The dataset; SceneError where a runtime plugin has made the volume, of whose neighbours nothing is known."""
        if self.dataset is None:
            raise SceneError(
                "streamlines: expected elements whose neighbours are known, found what a runtime plugin has opened"
            )
        return self.dataset

    def _ribbons(self, name: str, item: Streamlines, own: str | None) -> DrawCall:
        """Streamlines as ribbons."""
        assert item.ribbon is not None
        found = ribbons_in(self._known(), item, self._followers)
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
        """Arrows and cones, likewise."""
        return self._solids(name, item.style, self._frusta_of(item), own, item.style.lit is not False)

    def _solids(self, name: str, style: Style, found: Frusta, own: str | None, lit: bool) -> DrawCall:
        """Solids across axes."""

        def draw(view: View, beyond: Floats | None) -> HitBuffer:
            return self._glyph_drawer.draw(view, found, beyond, own)

        return DrawCall(name, style, own, draw, lit)

    def keys(self, scene: Scene, view: View) -> tuple[Legend, ...]:
        """How long the glyphs of a scene are."""
        return () if self.dataset is None else keys_of(self.dataset, scene, view)

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
        """A sentence where lines are too short for arrow heads."""
        if item.arrows is None or not len(self._curves_of(item).pieces):
            return
        if not len(heads_in(self._known(), item, self._followers).element):
            yield f"streamlines: no line is as long as its arrows are apart, {item.arrows:g}"

    def _endings(self, item: Streamlines) -> Iterator[str]:
        found = self._curves_of(item)
        ends = found.ends
        if not len(found.pieces):
            yield f"streamlines: none is drawn, as none of the {found.lines} lines moves"
        for end in (End.OUTSIDE, End.STEPS, End.JUMP, End.NAN, End.INVERTED, End.FAILED):
            name, meaning = WORDS[end]
            if name in ends:
                yield f"streamlines, {name}: {ends[name]} of {sum(ends.values())} lines {meaning}"
