"""Messages from pages, checked before the session acts on them."""

from __future__ import annotations

import json
from math import isfinite
from typing import Annotated, Any, Literal, NoReturn, TypeAlias

from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, ValidationError

from elvis.core.base.errors import ElvisError
from elvis.core.base.texts import LONGEST_TEXT

#: quantities of one request
MAX_QUANTITIES = 100
#: characters of the key of a setting, such as ``objects[3].style.opacity``
MAX_KEY = 300
#: characters of a message that an error quotes
_QUOTED = 100

Text: TypeAlias = Annotated[str, Field(max_length=LONGEST_TEXT)]
Key: TypeAlias = Annotated[str, Field(max_length=MAX_KEY)]
Number: TypeAlias = Annotated[float, Field(allow_inf_nan=False)]
Place: TypeAlias = Annotated[list[Number], Field(min_length=2, max_length=3)]
#: key by which a page distinguishes answers
Id: TypeAlias = int | Key


class Message(BaseModel):
    """A message; unknown keys and values of other types are errors."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


class Shown(Message):
    """The page has shown one more picture."""

    type: Literal["shown"]


class Change(Message):
    """Other values of settings, by dotted keys; null takes one back."""

    type: Literal["change"]
    changes: dict[Key, Any]
    moving: bool = False


class Size(Message):
    """Width and height of the picture in pixels."""

    type: Literal["size"]
    size: Annotated[list[Number], Field(min_length=2, max_length=2)]


class Paper(Message):
    """Background of the picture where the scene has none, as a page with a dark theme wants it; None for white."""

    type: Literal["paper"]
    color: Annotated[list[Annotated[float, Field(ge=0, le=1)]], Field(min_length=3, max_length=3)] | None


class Hide(Message):
    """An object that is not to be shown."""

    type: Literal["hide"]
    key: Key


class Unhide(Message):
    """A hidden object that is to be shown again, or forgotten."""

    type: Literal["unhide", "forget"]
    number: int


class Step(Message):
    """Back or forth in the history."""

    type: Literal["undo", "redo"]


class Proof(Message):
    """Whether statuses are shown."""

    type: Literal["proof"]
    on: bool


class ReadAgain(Message):
    """The files are to be read again."""

    type: Literal["read again"]


class Level(Message):
    """How often linear elements are cut."""

    level: int


class Linear(Message):
    """Request for the picture of linear elements."""

    type: Literal["linear"]
    id: Id
    content: Level


class Beside(Message):
    """The name of another dataset, and whether a draft of it is wanted."""

    name: Key
    draft: bool = False


class Other(Message):
    """Request for the last picture, drawn from another dataset."""

    type: Literal["other"]
    id: Id
    content: Beside


class Pixel(Message):
    """A pixel of the picture with a number."""

    row: int
    column: int
    number: int | None = None


class Pick(Message):
    """Request for the value at a pixel."""

    type: Literal["pick"]
    id: Id
    content: Pixel


class Segment(Message):
    """Quantities from one place to another."""

    start: Place
    end: Place
    quantities: Annotated[list[Text], Field(max_length=MAX_QUANTITIES)]


class Line(Message):
    """Values along a line."""

    type: Literal["line"]
    id: Id
    content: Segment


class OnWall(Message):
    """Quantities along the wall at a place; the axis at right angles to the section, None to choose it."""

    place: Place
    quantities: Annotated[list[Text], Field(max_length=MAX_QUANTITIES)]
    axis: Literal["x", "y", "z"] | None = None


class Section(Message):
    """Values along a wall."""

    type: Literal["section"]
    id: Id
    content: OnWall


class QuantityAt(Message):
    """A quantity at a place."""

    quantity: Text
    place: Place


class History(Message):
    """Values over time."""

    type: Literal["history"]
    id: Id
    content: QuantityAt


class OfQuantity(Message):
    """A question about one quantity."""

    type: Literal["check", "histogram", "extrema", "series range"]
    id: Id
    content: Text | None = None


class Seen(Message):
    """Request for the box of the visible points, or for their depths."""

    type: Literal["seen", "depths"]
    id: Id
    content: None = None


class Copy(Message):
    """The picture as a command, or as lines of Python."""

    type: Literal["copy"]
    id: Id
    content: Literal["command", "Python"]


class File(Message):
    """A file next to the data."""

    name: Text
    confirmed: bool = False


class Write(Message):
    """A file that is to be written."""

    type: Literal["write"]
    id: Id
    content: File


#: messages that ask for something
Question: TypeAlias = Linear | Other | Pick | Line | Section | History | OfQuantity | Seen | Copy | Write
AnyMessage: TypeAlias = Shown | Change | Size | Paper | Hide | Unhide | Step | Proof | ReadAgain | Question

_ADAPTER: TypeAdapter[AnyMessage] = TypeAdapter(Annotated[AnyMessage, Field(discriminator="type")])


def parsed(message: object) -> AnyMessage:
    """The message in a table; ElvisError with its first fault for an invalid message."""
    try:
        return _ADAPTER.validate_python(message)
    except ValidationError as error:
        fault = error.errors(include_url=False, include_input=False)[0]
        place = ".".join(str(part)[:40] for part in fault["loc"][1:])
        reason = f"{place}: {fault['msg']}" if place else fault["msg"]
        quoted = f"{message!r:.{_QUOTED}}"
        raise ElvisError(f"the viewer does not understand {quoted}: {reason[:300]}") from None


def table_of_text(text: str) -> Any:
    """The value of a JSON text; ElvisError for invalid JSON, and for numbers that are not finite."""
    try:
        return json.loads(text, parse_constant=_refuse, parse_float=_finite)
    except RecursionError:
        raise ElvisError("expected JSON, found lists nested too deeply") from None
    except ValueError as error:
        raise ElvisError(f"expected JSON, found: {error!s:.200}") from None


def id_of(message: object) -> Id | None:
    """The id under which a page waits for an answer, if it is one."""
    found = message.get("id") if isinstance(message, dict) else None
    is_id = isinstance(found, int) or (isinstance(found, str) and len(found) <= MAX_KEY)
    return found if is_id else None


def _refuse(word: str) -> NoReturn:
    raise ValueError(f"{word} is not a number of JSON")


def _finite(digits: str) -> float:
    """A number with a fraction or an exponent."""
    value = float(digits)
    if not isfinite(value):
        raise ValueError(f"{digits[:40]} is beyond all numbers")
    return value
