"""From a dataset and a scene to a frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from time import perf_counter
from typing import Any, cast

import numpy as np

from elvis.formats.arrays import Bools, Floats, Ints
from elvis.formats.dataset import Dataset
from elvis.formats.errors import ElvisError
from elvis.plugins.opening import Opened
from elvis.plugins.registry import load, plugins
from elvis.plugins.volume import Volume
from elvis.plugins.volume_checks import Samples
from elvis.renderer.cut import NOBODY, Cutter, Pixels
from elvis.renderer.device import Device
from elvis.renderer.errors import SceneError
from elvis.renderer.examining import check_on_device, examine
from elvis.renderer.fitting import automatic, missed, surrounding
from elvis.renderer.frame import Frame
from elvis.renderer.loaded import Loaded
from elvis.renderer.probing import Finder, Places
from elvis.renderer.scene import Plane, Scene
from elvis.renderer.view import PlaneView, seen


def render(dataset: Dataset | Opened, scene: Scene | None = None, *, device: str = "auto", **options: Any) -> Frame:
    """A picture of a dataset, or of what a runtime plugin has opened.

    scene    what to draw; or its parts as keywords: ``render(data, field="u", plane=Plane((0, 0, 0), (0, 0, 1)))``
    device   ``auto``, ``vulkan``, ``vulkan:N``, ``cuda``, ``cpu``, or the name of a device plugin such as ``reference``

    Raises SceneError where nothing can be seen or the field is unknown, DeviceError where the device can't be used.
    """
    scene = scene or Scene(**options)
    scene = scene if scene.field else replace(scene, field=default_field(dataset))
    if isinstance(dataset, Opened):
        return drawn(dataset, scene, device)
    scene = completed(dataset, scene)
    if device in plugins("elvis.devices"):
        draw = cast(Callable[[Dataset, Scene], Frame], load("elvis.devices", device))
        return draw(dataset, scene) if scene.field in _names(dataset) else _judged(draw, dataset, scene)
    with Renderer(device) as renderer:
        renderer.load(dataset, scene.field)
        return renderer.render(scene)


def drawn(opened: Opened, scene: Scene, device: str) -> Frame:
    """A picture of a runtime plugin's data, whose elements are tried first; remarks on them go to the statistics."""
    scene = _with_field(scene, opened.fields)
    volume = opened.volume(scene.field)
    scene = _with_plane(scene, volume.dimension)
    if device in plugins("elvis.devices"):
        raise SceneError(f"the device {device!r} draws the native format only, not what the plugin {opened.name} opens")
    with Renderer(device) as renderer:
        remarks = check_on_device(renderer.device, opened.name, volume)
        renderer.show(volume)
        frame = renderer.render(scene)
    frame.stats["remarks"] = remarks
    return frame


def default_field(data: Dataset | Opened) -> str:
    """The first field; SceneError where the data have none."""
    names = _names(data)
    if not names:
        raise SceneError("the data hold a mesh but no field: give the field file too")
    return names[0]


def completed(dataset: Dataset, scene: Scene) -> Scene:
    """The scene with its field checked and a plane: z = 0 for 2D data; else it must be given.

    A field that the data don't hold is one in closed form, an expression of x, y and z.
    """
    scene = _with_field(scene, _names(dataset), is_mesh=True)
    return _with_plane(scene, 3 if _server(dataset, scene.field) == "planes" else dataset.mesh.dimension)


def _names(data: Dataset | Opened) -> tuple[str, ...]:
    return data.fields if isinstance(data, Opened) else tuple(field.name for field in data.fields)


def _with_field(scene: Scene, known: tuple[str, ...], is_mesh: bool = False) -> Scene:
    """The scene, if its field is known or, on a mesh, an expression; SceneError where it is neither."""
    if scene.field in known:
        return scene
    unknown = f"unknown field {scene.field!r}: the data hold {', '.join(known) or 'none'}"
    if not is_mesh:
        raise SceneError(unknown)
    try:
        cast(Any, load("elvis.volumes", "analytic")).parse(scene.field)
    except ElvisError as error:
        raise SceneError(unknown if scene.field.isidentifier() else f"{unknown}; {error}") from error
    return scene


def _with_plane(scene: Scene, dimension: int) -> Scene:
    """The scene with its plane: that of 2D data; else it must be given."""
    if dimension == 2:
        if scene.plane is not None:
            raise SceneError("2D data are drawn in their own plane: leave the cut plane out")
        return replace(scene, plane=Plane((0.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    if scene.plane is None:
        raise SceneError("3D data need a cut plane: give a point and a normal, such as --plane 0,0,0:0,0,1")
    return scene


def _judged(draw: Callable[[Dataset, Scene], Frame], dataset: Dataset, scene: Scene) -> Frame:
    """An expression drawn by a device plugin: it finds the points, the expression says the values there."""
    analytic = cast(Any, load("elvis.volumes", "analytic"))
    frame = draw(analytic.carrier(dataset), replace(scene, field="x"))
    y, x = np.nonzero(frame.seen)
    field = np.full(frame.field.shape, np.nan)
    field[y, x] = analytic.parse(scene.field)(frame.view.points_of(x, y))
    return replace(frame, scene=replace(frame.scene, field=scene.field), field=field)


class Renderer:
    """A device with a volume, for many pictures of the same data."""

    def __init__(self, device: str = "auto") -> None:
        """Open a device (see render)."""
        self.device = Device(device)
        self.seconds: dict[str, float] = {}
        self._volume: Volume | None = None
        self._loaded: Loaded | None = None
        self._cutter: Cutter | None = None
        self._finder: Finder | None = None
        self._fitted: tuple[object, PlaneView] | None = None

    def __enter__(self) -> Renderer:
        return self

    def __exit__(self, *_: object) -> None:
        self.device.close()

    def load(self, dataset: Dataset, field: str) -> None:
        """Bring one field of a dataset to the device, through the runtime plugin that serves datasets."""
        start = perf_counter()
        self.show(_volume(dataset, field))
        self.seconds["load"] = perf_counter() - start

    def show(self, volume: Volume) -> None:
        """Bring a runtime plugin's volume to the device."""
        self._volume, self._finder, self._fitted = volume, None, None
        self._loaded = Loaded(self.device, volume)
        self._cutter = Cutter(self._loaded)

    def probe(self, points: Floats) -> Places:
        """Elements and field at world points (n, 3), found on the device."""
        if self._loaded is None or self._volume is None:
            raise ElvisError("load a dataset before probing")
        self._finder = self._finder or Finder(self.device, self._volume, self._loaded.buffers)
        return self._finder.find(points)

    def examine(self, part: int, elements: Ints, offsets: Floats, quantity: str | None = None) -> Samples:
        """What elements (n,) of a part answer at offsets (n, 3) from their type's centre; for checks of plugins."""
        if self._volume is None:
            raise ElvisError("load a dataset before examining")
        return examine(self.device, self._volume, part, elements, offsets, quantity)

    def render(self, scene: Scene, *, references: bool = True) -> Frame:
        """A picture of the volume; the scene has a plane.  Only exact records need reference coordinates."""
        if self._cutter is None:
            raise ElvisError("load a dataset before rendering")
        assert scene.plane is not None
        cutter, start = self._cutter, perf_counter()
        view = self._view(scene)
        pixels = cutter.draw(view, references=references)
        if not (pixels.owner != NOBODY).any():
            raise SceneError(missed(scene.plane, surrounding([part.boxes for part in cutter.parts])))
        frame = self._frame(cutter, scene, view, pixels)
        frame.stats["seconds"] = {**self.seconds, **cutter.clock.seconds, "frame": perf_counter() - start}
        return frame

    def _view(self, scene: Scene) -> PlaneView:
        """The view of a scene: that of the last scene where plane, camera and size are the same."""
        assert self._cutter is not None
        key = (scene.plane, scene.camera, scene.size)
        if self._fitted is None or self._fitted[0] != key:
            boxes = [part.boxes for part in self._cutter.parts]
            self._fitted = key, seen(automatic(scene, boxes, self._glance))
        return self._fitted[1]

    def _glance(self, scene: Scene) -> Bools:
        """(h, w) where something is seen."""
        assert self._cutter is not None
        view = seen(scene)
        owner = self._cutter.draw(view, references=False).owner
        return np.asarray(owner.reshape(view.height, view.width) != NOBODY)

    def _frame(self, cutter: Cutter, scene: Scene, view: PlaneView, pixels: Pixels) -> Frame:
        """Running element numbers become global ids; pixels become rows."""
        assert self._loaded is not None
        element = self._loaded.ids.take(pixels.owner, mode="clip")
        shape = (view.height, view.width)
        frame = Frame(
            scene,
            view,
            pixels.field.reshape(shape),
            element.reshape(shape),
            None if pixels.reference is None else pixels.reference.reshape(*shape, 3),
            pixels.status.reshape(shape),
        )
        frame.stats.update(
            device={"name": self.device.adapter.name, "label": self.device.adapter.label},
            elements=len(self._loaded.ids) - 1,
            tiles=cutter.tiles,
            bytes={"volume": self._loaded.bytes, "image": 12 * pixels.owner.size},
            pixels=frame.counts(),
        )
        return frame


def _volume(dataset: Dataset, field: str) -> Volume:
    """One field of a dataset, from the runtime plugin that serves it."""
    return cast(Volume, cast(Any, load("elvis.volumes", _server(dataset, field))).of(dataset, field))


def _server(dataset: Dataset, field: str) -> str:
    """The plugin for a field of a dataset: native, or those for quasi-3D data and for fields in closed form."""
    if field not in _names(dataset):
        return "analytic"
    return "planes" if cast(Any, load("elvis.volumes", "planes")).serves(dataset, field) else "native"
