"""Command-line values of scenes: what the text of an option means.  SceneErrors and BadParameters are of usage."""

from __future__ import annotations

import re
from math import inf
from typing import Any, get_args, get_origin

import click
from PIL import ImageColor

from elvis import scene
from elvis.core.base.hints import perhaps
from elvis.core.data.arguments import numbers, triples
from elvis.core.data.axis_planes import middle_axis, point_and_normal, with_normals
from elvis.scene.commandline.other_programs import VIEWS
from elvis.scene.model.settings import check, choices, settings, types
from elvis.scene.model.style import check_range
from elvis.scene.model.surfaces import Middle

SURFACES: dict[str, Any] = {each.kind: each for each in get_args(scene.Surface)}

#: directions of the coordinates by their names
AXES: dict[str, scene.Vector] = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def plane(text: str) -> scene.Plane:
    """``x,y,z:nx,ny,nz``: a point and a normal; or ``z=0.2``."""
    own = point_and_normal(text)
    expected = "POINT:NORMAL or z=VALUE, such as 0,0,0.2:0,0,1 or z=0.2"
    check(":" in own, "a plane", expected, repr(text))
    found: scene.Plane = _instance(scene.Plane, own)
    return found


def cutting_plane(text: str) -> scene.Plane | Middle:
    """`plane`; ``z`` is the plane through the middle of the data."""
    axis = middle_axis(text)
    return Middle(axis) if axis else plane(text)


def surface(text: str) -> scene.Surface:
    """A surface from its kind and parameters: ``sphere:x,y,z:radius``, ``mesh:FILE``, ``implicit:EXPRESSION``.

    A bare ``z=0.2`` is a plane, a bare ``z`` or ``plane:z`` the one through the middle; SURFACES lists the kinds.
    """
    axis = middle_axis(text)
    if axis:
        return Middle(axis)
    is_plane = point_and_normal(text) != text
    kind, _, rest = with_normals(f"plane:{text}" if is_plane else text).partition(":")
    check(kind in SURFACES and rest, "a surface", f"{', '.join(SURFACES)} and a colon", repr(text))
    found: scene.Surface = _instance(SURFACES[kind], rest)
    return found


def cut(text: str) -> scene.CutSurface:
    """A surface that cuts."""
    return scene.CutSurface(surface(text))


def _instance(cls: Any, text: str) -> Any:
    """An instance of a model, from its settings with colons between."""
    names = list(settings(cls))
    parts = text.split(":", len(names) - 1)
    check(len(parts) == len(names), cls.kind, ":".join(names).upper(), repr(text))
    return cls(*(_value(types(cls)[name], part) for name, part in zip(names, parts, strict=True)))


def _value(hint: Any, text: str) -> Any:
    """A value of a type: a number, a text or a point."""
    (only,) = choices(hint)
    if only is float:
        return _number(text)
    return text if only is str else _point(text)


def _number(text: str) -> float:
    return numbers(text, 1)[0]


def _point(text: str) -> scene.Vector:
    return triples(text, 1)[0]


def clip(text: str) -> scene.Clip:
    """A surface, after ``outside:`` where its outside is to go."""
    away, _, within = text.partition(":")
    if away == "outside":
        return scene.Clip(surface(within), "outside")
    return scene.Clip(surface(within if away == "inside" else text))


def faces(text: str) -> scene.Faces:
    """Names with commas between them."""
    return scene.Faces(tuple(name.strip() for name in text.split(",")))


def isosurface(text: str) -> scene.Isosurface:
    """``VALUE,VALUE…``, or ``QUANTITY=VALUE,VALUE…``."""
    quantity, _, values = text.rpartition("=")
    return scene.Isosurface(numbers(values), quantity.strip() or None)


def volume(text: str) -> scene.VolumeRendering:
    """``VALUE:DENSITY,VALUE:DENSITY…``, or the same after ``QUANTITY=``."""
    quantity, _, points = text.rpartition("=")
    values, densities = zip(*(numbers(pair.replace(":", ",", 1), 2) for pair in points.split(",")), strict=True)
    return scene.VolumeRendering(scene.Transfer(values, densities), quantity.strip() or None)


def streamlines(text: str) -> scene.Streamlines:
    """Seeds, and ``KEY=VALUE`` of other settings, with semicolons between them."""
    found: scene.Streamlines = _from_places(scene.Streamlines, "seeds", text)
    return found


def glyphs(text: str) -> scene.Glyphs:
    """Points, and ``KEY=VALUE`` of other settings, separated by semicolons."""
    found: scene.Glyphs = _from_places(scene.Glyphs, "points", text)
    return found


def _from_places(cls: Any, name: str, text: str) -> Any:
    """An object of places, which are the setting of that name, and of other settings as ``KEY=VALUE``."""
    places: list[str] = []
    known, given = types(cls), {}
    for part in filter(None, map(str.strip, text.split(";"))):
        key, equals, value = (word.strip() for word in part.partition("="))
        if not equals or ":" in key or "." in key:
            places.append(part)
            continue
        check(key in known and key not in (name, "style"), cls.kind, f"a key of {', '.join(known)}", repr(key))
        given[key] = _plain(known[key], value)
    return cls(tuple(places), **given)


def contours(text: str) -> scene.Contours:
    """A whole number: n lines; else their values, with commas or a decimal point; then ``:even`` and ``:labels``."""
    text, *rest = text.split(":")
    check(set(rest) <= {"even", "labels"}, "contours", "N or V,V, :even and :labels", repr(":".join(rest)))
    is_round, has_labels = "even" not in rest, "labels" in rest
    if text.isdecimal():
        return scene.Contours(count=int(text), round=is_round, labels=has_labels)
    return scene.Contours(numbers(text), labels=has_labels)


def bar(text: str) -> scene.ColorBar:
    """``KEY=VALUE,KEY=VALUE…``; of a title up to the next comma with a key behind it."""
    pairs = [part.partition("=") for part in re.split(r",\s*(?=\w+=)", text)]
    known = types(scene.ColorBar)
    for key, equals, _ in pairs:
        check(equals and key in known, "--bar", f"KEY=VALUE of {', '.join(known)}", repr(key))
    return scene.ColorBar(**{key: _plain(known[key], value) for key, _, value in pairs})


def _plain(hint: Any, text: str) -> Any:
    """A text, a number, a whole one, true or false, or a list of numbers."""
    only = choices(hint)[0]
    if only is bool:
        check(text in ("true", "false"), "a setting", "true or false", repr(text))
        return text == "true"
    if get_origin(only) is tuple:
        return numbers(text.replace(" ", ","))
    if only is int:
        check(text.isdecimal(), "a number", "a whole one", repr(text))
        return int(text)
    return _number(text) if only is float else text


def panels(text: str) -> tuple[int, int]:
    """``ROWSxCOLUMNS``."""
    sides = text.lower().split("x")
    check(len(sides) == 2 and all(map(str.isdecimal, sides)), "panels", "ROWSxCOLUMNS such as 2x2", repr(text))
    return int(sides[0]), int(sides[1])


def camera(text: str) -> scene.Camera | str:
    """The name of a view, or ``eye:at[:up[:degrees]]``."""
    names, parts = ("fit", *scene.NAMED_VIEWS), text.split(":")
    name = VIEWS.get(text, text)
    if name in names:
        return name
    found = f"{text!r}{perhaps(text, names)}"
    check(2 <= len(parts) <= 4, "camera", f"{', '.join(names)} or eye:at[:up[:degrees]]", found)
    eye, at, up = map(_point, [*parts, "0,0,1"][:3])
    return scene.Camera(eye, at, up, *map(_number, parts[3:]))


def region(text: str) -> tuple[float, ...]:
    """``X0:X1,Y0:Y1``."""
    return numbers(text.replace(":", ","), 4)


def size(text: str) -> tuple[int, int]:
    """``WIDTHxHEIGHT`` in pixels; one number is both."""
    sides, setting = text.lower().replace(",", "x").split("x"), settings(scene.Scene)["size"]
    good = len(sides) in (1, 2) and all(side.isdecimal() and setting.holds(int(side)) for side in sides)
    check(good, "size", f"WIDTHxHEIGHT such as 1000x800, or one number, {setting.values_text}", repr(text))
    return int(sides[0]), int(sides[-1])


def memory(text: str) -> float:
    """A number of bytes, such as ``2GiB``, ``500MB`` or ``1e9``."""
    found = re.fullmatch(r"\s*([\d.eE+]+)\s*(?:([kKMGT])(i?))?B?\s*", text)
    try:
        amount = float(found[1]) if found else 0.0
    except ValueError:
        amount = 0.0
    check(found is not None and 0.0 < amount < inf, "memory", "bytes above 0, such as 2GiB", repr(text))
    assert found is not None
    return amount * (1024.0 if found[3] else 1000.0) ** " KMGT".index((found[2] or " ").upper())


def color_range(text: str) -> tuple[float, float] | str:
    """``LOW:HIGH``, ascending; or ``visible``, ``all`` or ``series``."""
    if text in ("visible", "all", "series"):
        return text
    low, high = numbers(text.replace(":", ",", 1), 2)
    check_range((low, high))
    return low, high


def background(text: str) -> tuple[float, ...]:
    """A name, ``#rrggbb`` or ``#rrggbbaa``, as CSS has them, or parts from 0 to 1 with commas between them."""
    if text == "transparent":
        return 1.0, 1.0, 1.0, 0.0
    if text.count(",") in (2, 3) and "(" not in text:
        return numbers(text, text.count(",") + 1)
    try:
        return tuple(part / 255 for part in ImageColor.getrgb(text))
    except ValueError as error:
        raise click.BadParameter(f"expected a colour such as white, #ff8000 or 1,0.5,0, found {text!r}") from error


def color(text: str) -> scene.Vector:
    """The same without opacity, which --opacity says."""
    found = background(text)
    check(len(found) == 3 or found[3] == 1.0, "a colour", "one without opacity; use --opacity", repr(text))
    return found[0], found[1], found[2]


def caption(text: str) -> scene.Caption:
    """``POINT:TEXT``, or ``POINT@DX,DY:TEXT`` for a text that is shifted."""
    place, colon, words = text.partition(":")
    check(bool(colon and words), "text", "POINT:TEXT, such as 1,0,0.2:tip", repr(text))
    point, _, shift = place.partition("@")
    right, above = numbers(shift) if shift else (0.0, 0.0)
    return scene.Caption(words, _point(point), (right, above))


def light(text: str) -> scene.Light:
    """``x,y,z`` towards the light or ``eye``, then ``:intensity`` where it is not the usual one."""
    direction, _, intensity = text.partition(":")
    towards = None if direction == "eye" else _point(direction)
    return scene.Light(towards, *map(_number, [intensity] if intensity else []))


def deform(text: str) -> scene.Deform:
    """The components of a displacement with commas between them."""
    return scene.Deform(text)


def repeat(text: str) -> scene.Repeat:
    """``x,y,z:count``, or ``x:count`` for the period of the data along x."""
    step, _, count = text.rpartition(":")
    expected = "VECTOR:COUNT such as 1,0,0:4, or x:4 for the period of the data"
    check(step and count.isdecimal(), "repeat", expected, repr(text))
    return scene.Repeat(step if step in AXES else _point(step), int(count))  # type: ignore[arg-type]


def turn(text: str) -> scene.Turn:
    """``z:count``, ``x,y,z:count`` or ``point:axis:count``."""
    *point, axis, count = ("", *text.split(":")) if ":" in text else ("", "", "")
    expected = "AXIS:COUNT such as z:6 or 0,0,1:6, or POINT:AXIS:COUNT"
    check(axis and count.isdecimal() and len(point) <= 2, "turn", expected, repr(text))
    middle = _point(point[1]) if len(point) == 2 else (0.0, 0.0, 0.0)
    return scene.Turn(AXES[axis] if axis in AXES else _point(axis), int(count), middle)


def setting(text: str) -> tuple[str, str]:
    """``KEY=VALUE``."""
    key, equals, value = text.partition("=")
    check(key.strip() and equals, "a setting", "KEY=VALUE such as objects[0].style.opacity=0.5", repr(text))
    own = key.strip()
    return f"reference.{own}" if own in settings(scene.Reference) else own, value.strip()
