"""What a picture of everything saves by what its objects share: each sharing switched off in turn."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from typing import Any
from unittest.mock import patch

import numpy as np
from measuring import in_turn
from scenes import WORDS, exact
from shown import Shown
from tables import Table, seconds

from elvis import Renderer, Scene
from elvis.renderer.frame.stages import Stages
from elvis.renderer.passes.volume.media import Medium
from elvis.renderer.passes.volume.ray_integrals import RayIntegrals
from elvis.renderer.passes.volume.rendering import VolumeRenderer
from elvis.renderer.raster import compositing
from elvis.renderer.raster.compositing import FragmentLists

PARTS = ("cut", "faces", "isosurface", "volume")
SHARINGS = {
    "one march": "a march for each stretch between surfaces",
    "depth": "segments are listed behind opaque surfaces too",
    "light": "elements without light are traversed too",
    "samples": "surfaces are computed again for their contours",
}


def measure(shown: Shown, device: str, side: int, rounds: int, quick: bool) -> dict[str, Any]:
    """Seconds of everything, of its parts from the same camera, and with each sharing off; the largest difference."""
    dataset = shown.dataset(quick)
    whole = next(iter(shown.scenes("together", side).values()))
    alone = {kind: replace(whole, objects=(item,)) for kind, item in zip(PARTS, whole.objects, strict=True)}
    with Renderer(device) as renderer:
        renderer.load(dataset, shown.field)
        pictures = {name: partial(exact, renderer, scene) for name, scene in {"together": whole, **alone}.items()}
        works: dict[str, Callable[[], Any]] = {
            **pictures,
            **{name: partial(_without, name, renderer, whole) for name in SHARINGS},
        }
        plain = exact(renderer, whole).color
        off = {name: float(np.abs(_without(name, renderer, whole).color - plain).max()) for name in SHARINGS}
        timings = in_turn(works, rounds)
        level = _level(renderer, alone["isosurface"])
    return {"pixels": side, "off": off, "level": level, **{name: it.record() for name, it in timings.items()}}


def _level(renderer: Renderer, scene: Scene) -> float:
    """Processor seconds of finding the isosurface, without colours: all that lists shared with volumes could save."""
    view = renderer.render(scene, references=False).view
    draw_call = renderer.stages.draw_calls(scene)[0]
    return in_turn({"level": lambda: draw_call.draw(view, None).depth}, 3)["level"].effort


def _without(name: str, renderer: Renderer, scene: Scene) -> Any:
    """The picture without one of the sharings."""
    with _off(name):
        return exact(renderer, scene)


@contextmanager
def _off(name: str) -> Iterator[None]:
    draw, hit_buffers = VolumeRenderer.draw, Stages.hit_buffers

    def stretches(
        self: VolumeRenderer, view: Any, media: Any, fragments: FragmentLists, error: float, *rest: Any
    ) -> RayIntegrals:
        depths = fragments.device.read(fragments.buffers["fragment_depths"], np.float64).reshape(fragments.count, -1)
        for depth in depths:
            wall = [(depth, np.ones((len(depth), 3)), np.ones(len(depth)))]
            draw(
                self,
                view,
                media,
                FragmentLists.of(fragments.device, fragments.pixels, wall, (1, 1, 1)).compose(),
                error,
                *rest,
            )
        return draw(self, view, media, fragments, error, *rest)

    def twice(self: Stages, *arguments: Any) -> Iterator[Any]:
        for hits in hit_buffers(self, *arguments):
            assert len(hits.depth)
        yield from hit_buffers(self, *arguments)

    changed = {
        "one march": (VolumeRenderer, "draw", stretches),
        "depth": (compositing, "FAINT", -1.0),
        "light": (Medium, "counts", lambda self, low, high: np.ones(len(low), bool)),
        "samples": (Stages, "hit_buffers", twice),
    }
    with ExitStack() as stack:
        stack.enter_context(patch.object(*changed[name]))
        yield


def table(numbers: dict[str, Any]) -> Table:
    """Everything next to the sum of its parts, and without each sharing."""
    shown = Table("Everything in one picture", ["picture", "best s", "CPU s", "CPU / together"])
    whole = numbers["together"]

    def add(title: str, best: float, effort: float) -> None:
        shown.rows.append([title, seconds(best), seconds(effort), f"{effort / whole['processor']:.2f}"])

    for name in PARTS:
        add(WORDS[name], numbers[name]["best"], numbers[name]["processor"])
    add("sum of the parts", *(sum(numbers[name][key] for name in PARTS) for key in ("best", "processor")))
    add(WORDS["together"], whole["best"], whole["processor"])
    for name, title in SHARINGS.items():
        add(f"- {title}", numbers[name]["best"], numbers[name]["processor"])
    shown.notes = [
        f"{numbers['pixels']}^2 pixels, all from one camera. Pictures without a sharing differ by "
        f"{max(numbers['off'].values()):.1e} of colour at most.",
        "Isosurface and volume list segments each for itself: they look at the elements that bounds leave to each. "
        f"Finding the isosurface takes {seconds(numbers['level'])} CPU s, the most that a common list could save.",
    ]
    return shown
