"""Tables of plain values checked against the models of a scene by pydantic, and the JSON schema of scene files.

Models are dataclasses of the standard library, which Python code makes without pydantic; it is loaded for what comes
from outside.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import is_dataclass
from functools import cache
from math import inf
from sys import float_info
from types import GenericAlias
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import Discriminator, Field, Tag, TypeAdapter, ValidationError
from pydantic_core import ErrorDetails, PydanticCustomError, SchemaValidator
from pydantic_core.core_schema import no_info_after_validator_function

from elvis.core.base.hints import nearest
from elvis.scene.model.errors import SceneError
from elvis.scene.model.settings import LONGEST, Model, Setting, check, choices, is_free, type_words, types
from elvis.scene.model.whole import Scene

#: errors of pydantic about keys that a table hasn't
UNKNOWN = ("unexpected_keyword_argument", "invalid_key")
#: errors of pydantic about the key that distinguishes tables
KIND = ("union_tag_invalid", "union_tag_not_found")
#: words of JSON Schema for bounds
BOUNDS = {"gt": "exclusiveMinimum", "ge": "minimum", "lt": "exclusiveMaximum", "le": "maximum"}
#: levels of tables and lists in one another, at most
DEEPEST = 50


def scene_from(table: Any) -> Scene:
    """The scene of a table; SceneError with the key and its place, the expected value and the value found."""
    _check_plain(table, "", DEEPEST)
    try:
        scene: Scene = _validator().validate_python(table)
    except ValidationError as error:
        raise SceneError(_sentence(error.errors(include_url=False))) from error
    return scene


def scene_schema() -> dict[str, Any]:
    """The JSON schema of scene files, identical for every version of pydantic.

    >>> sorted(elvis.scene_schema()["properties"])[:3]
    ['ambient', 'axes', 'background']
    """
    found: dict[str, Any] = _plain_schema(_adapter().json_schema())
    models = {model.__name__: model for model in Model.__subclasses__()}
    for name, definition in (("Scene", found), *found["$defs"].items()):
        definition["description"] = models[name].__doc__
    return {"$schema": "https://json-schema.org/draft/2020-12/schema", **found}


def _plain_schema(node: Any) -> Any:
    """A schema without titles, which repeat names, and without lists of one alternative; unions require a kind."""
    if isinstance(node, list):
        return [_plain_schema(item) for item in node]
    if not isinstance(node, dict):
        return node
    found = {key: _plain_schema(value) for key, value in node.items()}
    if isinstance(found.get("title"), str):
        del found["title"]
    if len(found.get("allOf", ())) == 1:
        found |= found.pop("allOf")[0]
    if "const" in found:
        found.pop("enum", None)
    if "discriminator" in found:
        found["required"] = ["kind"]
    return found


def _check_plain(item: Any, place: str, deepest: int) -> None:
    """SceneError where tables lie too deep in one another, numbers are too long to be shown, or lists have no order."""
    check(deepest > 0, f"{place[:40]}...", f"tables and lists nested at most {DEEPEST} deep", "more")
    check(not isinstance(item, set | frozenset), place, "a list", "a set")
    if isinstance(item, int):
        check(abs(item) <= float_info.max, place, "a finite number", f"one of {item.bit_length()} bits")
    if isinstance(item, dict):
        for key, value in item.items():
            _check_plain(value, _join(place, key), deepest - 1)
    if isinstance(item, list | tuple):
        for number, value in enumerate(item):
            _check_plain(value, f"{place}[{number}]", deepest - 1)


@cache
def _adapter() -> TypeAdapter[Scene]:
    return TypeAdapter(Scene)


@cache
def _validator() -> SchemaValidator:
    """The models' own, strict but for tables and lists: these stand for dataclasses and tuples."""
    core: Any = _adapter().core_schema
    _loosen(core)
    return SchemaValidator(core)


def _loosen(node: Any) -> None:
    """Take tables for dataclasses and lists for tuples, all over a schema of pydantic."""
    if isinstance(node, dict):
        if node.get("type") in ("dataclass", "tuple"):
            node["strict"] = False
        node = list(node.values())
    if isinstance(node, list):
        for item in node:
            _loosen(item)


def annotated(hint: Any) -> Any:
    """A type of the models with the annotations for pydantic: lengths of lists, and the choice between alternatives."""
    if is_free(hint):
        items: Any = annotated(get_args(hint)[0])
        return Annotated[GenericAlias(tuple, (items, ...)), Field(max_length=LONGEST)]
    own = choices(hint)
    if len(own) == 1:
        return hint
    if all(map(is_dataclass, own)):
        union: Any = Annotated[Union[own], Field(discriminator="kind")]  # noqa: UP007
    else:
        tagged = tuple(Annotated[choice, Tag(_shape_of_type(choice))] for choice in own)
        union = Annotated[Union[tagged], Discriminator(_shape)]  # noqa: UP007
    return union if len(own) == len(get_args(hint)) else union | None


def filled(schema: Any) -> Any:
    """A schema of texts that are not empty; they may be invalid UTF-8, like file names."""

    def check_filled(text: str) -> str:
        if not text:
            raise PydanticCustomError("empty", "empty")
        return text

    return no_info_after_validator_function(check_filled, schema)


def _shape(value: Any) -> str:
    """Which of several alternatives a value is meant to be: a table, a list, or neither."""
    if isinstance(value, dict) or is_dataclass(value):
        return "table"
    return "list" if isinstance(value, list | tuple) else "plain"


def _shape_of_type(hint: Any) -> str:
    if is_dataclass(hint):
        return "table"
    return "list" if get_origin(hint) is tuple else "plain"


def setting_schema(setting: Setting, schema: dict[str, Any]) -> dict[str, Any]:
    """The JSON schema of a setting, with its sentence, unit and bounds."""
    names = {"enum": list(setting.names)} if setting.names else {}
    told = {BOUNDS[name]: bound for name, bound in setting.bounds.items() if bound != inf}
    bounded: dict[str, Any] = _narrow(schema, {"number": told, "integer": told, "string": names})
    unit = f" In {setting.unit}." if setting.unit else ""
    return {**bounded, "description": f"{setting.help}{unit}"}


def _narrow(schema: Any, further: dict[str, dict[str, Any]]) -> Any:
    """A JSON schema with further keys for values of some types, also for those in lists and alternatives."""
    if isinstance(schema, list):
        return [_narrow(item, further) for item in schema]
    inner = ("anyOf", "oneOf", "items", "prefixItems")
    narrowed = {key: _narrow(value, further) if key in inner else value for key, value in schema.items()}
    return {**narrowed, **further.get(str(schema.get("type")), {})}


def _sentence(errors: list[ErrorDetails]) -> str:
    """The sentence for the first error; one about an unknown key explains others, and goes before them."""
    error = min(errors, key=lambda each: each["type"] not in UNKNOWN)
    kind, loc, found = error["type"], error["loc"], error["input"]
    if kind in UNKNOWN:
        place, model = _place(loc[:-1])
        return _unknown(_join(place, loc[-1]), str(loc[-1]), list(types(choices(model)[0])))
    if kind == "missing" and isinstance(loc[-1], str):
        return f"{_place(loc[:-1])[0] or 'scene'}: expected the key {loc[-1]!r}, found none"
    if kind == "missing":
        loc = loc[:-1]
    place, hint = _place(loc)
    if kind == "value_error":
        reason = str(error["ctx"]["error"])
        return f"{place}: {reason}" if place else reason
    if kind in KIND and all(map(is_dataclass, choices(hint))):
        expected = ", ".join(choice.kind for choice in choices(hint))
        return f"{_join(place, 'kind')}: expected {expected}, found {_short_text(found.get('kind'))}"
    if kind in ("missing", "too_long"):
        return f"{place}: expected {type_words(hint)}, found {len(found)}"
    own = [choice for choice in choices(hint) if _shape_of_type(choice) == _shape(found)]
    wanted = own[0] if len(own) == 1 < len(choices(hint)) else hint
    return f"{place or 'scene'}: expected {type_words(wanted)}, found {_short_text(found)}"


def _unknown(place: str, key: str, known: Iterable[str]) -> str:
    near = nearest(key, known)
    return f"unknown key {place!r}" + (f", did you mean {near}?" if near else f": expected {', '.join(known)}")


def _place(loc: tuple[int | str, ...]) -> tuple[str, Any]:
    """The key that an error of pydantic is about, as ``objects[2].style.opacity``, and the type in its place.

    loc  keys and numbers, and where there are alternatives the name of the one that was tried
    """
    place: str = ""
    hint: Any = Scene
    for part in loc:
        own = choices(hint)
        if isinstance(part, int):
            place, hint = f"{place}[{part}]", _item(own, part)
        elif len(own) > 1:
            hint = next(choice for choice in own if part in (getattr(choice, "kind", ""), _shape_of_type(choice)))
        else:
            place, hint = _join(place, part), types(own[0]).get(part)
    return place, hint


def _item(own: tuple[Any, ...], number: int) -> Any:
    """The type of an item of a list."""
    items = get_args(own[0])
    return items[0 if is_free(own[0]) else number]


def _join(place: str, key: int | str) -> str:
    return f"{place}.{key}" if place else str(key)


def _short_text(raw: Any) -> str:
    text = repr(raw)
    return text if len(text) <= 60 else f"{text[:57]}..."
