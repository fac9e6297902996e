"""Settings of a scene, each stated once, next to its name, type and default: see Setting.

The options of commands, the checks, the errors, the JSON schema and docs/scene.md are generated from them.  Loads
neither NumPy nor pydantic, so that commands start quickly; `validation` contains the parts that need pydantic.
"""

import operator
from collections.abc import Callable, Iterator
from dataclasses import MISSING, Field, dataclass, fields, is_dataclass, replace
from functools import cache
from math import inf, isfinite
from types import NoneType, UnionType
from typing import Annotated, Any, ClassVar, Literal, TypeAlias, TypeVar, Union, get_args, get_origin

from elvis.core.base.hints import nearest
from elvis.core.base.texts import LONGEST_TEXT
from elvis.scene.model.errors import KeywordError, SceneError

Made = TypeVar("Made", bound="Model")

#: entries of a list, at most
LONGEST = 10_000


def check(holds: object, what: str, expected: str, found: object) -> None:
    """SceneError naming ``what``, a key of the scene, unless ``holds``."""
    if not holds:
        raise SceneError(f"{what}: expected {expected}, found {found}")


@dataclass(frozen=True)
class Setting:
    """A setting: ``opacity: Annotated[float, Setting("Opacity of the object.", gt=0, le=1)] = 1.0``.

    help            its meaning, in a sentence
    gt, ge, lt, le  bounds of the number, or of each number of a list
    finite          whether numbers without bounds must be finite; those with bounds must, unless ``le`` is infinite
    unit            of the numbers
    expected        valid numbers in words, if bounds and unit don't describe them
    names           all possible texts
    default         the default in words, if its value doesn't describe it
    option          names of the command line option, separated by blanks; empty: there is no option
    metavar         form of the option's value
    parse           the function of ``commands.parameters`` that reads it; empty: its type does
    repeatable      whether the option may be given several times
    option_help     help of the option, if it differs from that of the setting
    """

    help: str
    gt: float | None = None
    ge: float | None = None
    lt: float | None = None
    le: float | None = None
    finite: bool = False
    unit: str = ""
    expected: str = ""
    names: tuple[str, ...] = ()
    default: str = ""
    option: str = ""
    metavar: str | None = None
    parse: str = ""
    repeatable: bool = False
    option_help: str = ""

    @property
    def bounds(self) -> dict[str, float]:
        """The bounds that there are, by the names of their comparisons."""
        own = {name: getattr(self, name) for name in ("gt", "ge", "lt", "le")}
        return {name: bound for name, bound in own.items() if bound is not None}

    @property
    def values_text(self) -> str:
        """Valid numbers in words: ``0 to 1``, ``seconds above 0``; empty if all numbers are valid."""
        what, bounds = self.unit or "a number", {name: f"{bound:g}" for name, bound in self.bounds.items()}
        if self.expected or not bounds:
            return self.expected or ("a finite number" if self.finite else "")
        match tuple(bounds):
            case ("ge",):
                return f"{bounds['ge']} or more"
            case ("ge", "le"):
                return f"{bounds['ge']} to {bounds['le']} {self.unit}".rstrip()
            case ("gt", "lt"):
                return f"{what} between {bounds['gt']} and {bounds['lt']}"
            case ("gt", "le") if bounds["le"] != "inf":
                return f"{what} above {bounds['gt']} and at most {bounds['le']}"
            case _:
                return f"{what} above {bounds['gt']}"

    @property
    def option_words(self) -> str:
        """The sentence of the option, with its range and default."""
        words = self.option_help or self.help
        words += "  Repeatable." if self.repeatable else ""
        limits = [self.values_text] if self.bounds and not self.expected else []
        limits += [f"default: {self.default}"] if self.default else []
        return f"{words}  [{'; '.join(limits)}]" if limits else words

    def check(self, value: Any, what: str) -> None:
        """SceneError naming ``what``, unless the numbers of a value are in bounds; None and texts have none."""
        if not self.holds(value):
            raise SceneError(f"{what}: expected {self.values_text}, found {value}")

    def holds(self, value: Any) -> bool:
        """Whether all numbers of a value are in bounds."""
        return all(self._is_within(number) for number in _numbers(value))

    def _is_within(self, number: float) -> bool:
        within = all(getattr(operator, name)(number, bound) for name, bound in self.bounds.items())
        return within and (isfinite(number) or self.le == inf)

    # pydantic asks these two of what annotates a type

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from elvis.scene.model.validation import annotated

        return handler(annotated(source))

    def __get_pydantic_json_schema__(self, core: Any, handler: Any) -> Any:
        from elvis.scene.model.validation import setting_schema

        return setting_schema(self, handler(core))


def _numbers(value: Any) -> Iterator[float]:
    """The numbers in a value, whatever its shape; of an optional value or of a text there are none."""
    if value is None or isinstance(value, str):
        return
    if hasattr(value, "__len__"):
        for item in value:
            yield from _numbers(item)
    else:
        yield value


def _check_length(value: Any, what: str) -> None:
    """Raise SceneError naming ``what`` for a text, or a text in a list, that is longer than texts may be."""
    texts = value if isinstance(value, tuple) else (value,)
    for text in texts:
        if isinstance(text, str) and len(text) > LONGEST_TEXT:
            raise SceneError(f"{what}: expected a text of at most {LONGEST_TEXT} characters, found {len(text)}")


@dataclass(frozen=True)
class Text:
    """A text that names files, by its kind.

    file        the name of a file
    palette     the name of a file if it ends in .xml
    expression  may contain distances to triangles in files
    seeds       the name of a file if it has no other form of seeds
    other       a name in expressions, =, and files separated by commas
    """

    kind: Literal["file", "palette", "expression", "seeds", "other"]

    def changed(self, text: str, change: Callable[[str], str]) -> str:
        """The text with other names of files."""
        if self.kind == "expression":
            from elvis.core.distances.triangle_files import renamed

            return renamed(text, change)
        if self.kind == "other":
            name, equals, files = text.partition("=")
            return name + equals + ",".join(change(file.strip()) for file in files.split(",") if file.strip())
        if self.kind == "seeds":
            from elvis.core.streamlines.seed_forms import names_file

            return change(text) if names_file(text) else text
        return change(text) if self.kind == "file" or text.lower().endswith(".xml") else text

    def __get_pydantic_core_schema__(self, source: Any, handler: Any) -> Any:
        from elvis.scene.model.validation import filled

        return handler(source) if self.kind == "expression" else filled(handler(source))

    def __get_pydantic_json_schema__(self, core: Any, handler: Any) -> Any:
        return {**handler(core), "minLength": 0 if self.kind == "expression" else 1}


#: the name of a file; in scene files relative to them
FilePath: TypeAlias = Annotated[str, Text("file")]
#: the name of a colour map, or of an .xml file with one
PaletteName: TypeAlias = Annotated[str, Text("palette")]
#: where streamlines begin; a table of points is named relative to the scene file
Seeds: TypeAlias = Annotated[str, Text("seeds")]
#: a field, an expression or a predefined quantity
Quantity: TypeAlias = Annotated[str, Text("expression")]
#: a velocity that lines follow, or None for the default
Components: TypeAlias = Annotated[
    Quantity | None,
    Setting(
        "Components of the velocity: any quantities, separated by commas.",
        metavar="U,V,W",
        default="u,v,w, rhou/rho, … as named",
    ),
]
#: the files of another dataset, and the name that expressions have for it
OtherFiles: TypeAlias = Annotated[str, Text("other")]
#: memory that elements may take
Memory: TypeAlias = Annotated[
    float | None,
    Setting(
        "Memory for the elements that are drawn, about four times the size of their coefficients: elements that the "
        "picture depends on are read in bricks of this size. Libraries, kernels and pictures are not counted.",
        gt=0,
        unit="bytes",
        option="--memory",
        metavar="BYTES",
        parse="memory",
        option_help="Memory for the elements that are drawn, such as 2GiB, about four times the size of their "
        "coefficients: elements that the picture depends on are read in bricks of this size.  Libraries, kernels and "
        "pictures are not counted; a note reports the peak of the whole process.",
    ),
]


class Model:
    """Base of the dataclasses of a scene: settings that are checked, and a representation of changed ones.

    noun  names the owner of a setting in errors
    """

    noun: ClassVar[str] = ""
    #: how pydantic reads tables
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": True, "allow_inf_nan": False}

    def __new__(cls: type[Made], *values: Any, **named: Any) -> Made:
        """An empty object; KeywordError with a similar name for an unknown keyword."""
        known = cls.__dataclass_fields__  # type: ignore[attr-defined]
        for name in named.keys() - known.keys():
            near = nearest(name, known)
            told = cls.elsewhere(name) or (f"did you mean {near}?" if near else f"there are {', '.join(known)}")
            raise KeywordError(f"{cls.__name__} has no keyword {name!r}: {told}")
        return object.__new__(cls)

    @classmethod
    def elsewhere(cls, name: str) -> str:
        """A clause about a keyword that is at home elsewhere; empty where none is known."""
        return ""

    def __init_subclass__(cls, of: str = "") -> None:
        """``of`` is the noun: radius of a sphere."""
        cls.noun = f" of {of}" if of else ""

    def __post_init__(self) -> None:
        self.check()
        cls: Any = type(self)
        for name, setting in _check(cls):
            setting.check(getattr(self, name), f"{name}{self.noun}")
        for field in fields(cls):
            _check_length(getattr(self, field.name), f"{field.name}{self.noun}")

    def check(self) -> None:
        """SceneError for invalid settings, beyond their own bounds."""

    def __repr__(self) -> str:
        given = [f"{name}={value!r}" for name, value in given_values(self).items()]
        return f"{type(self).__name__}({', '.join(given)})"


@cache
def settings(cls: type) -> dict[str, Setting]:
    """The settings of a class by their names, in order."""
    found = {}
    for field in fields(cls):
        setting = _of_kind(Setting, field.type)
        if setting:
            found[field.name] = replace(setting, default=setting.default or _default_words(default_of(field)))
    return found


def _default_words(value: Any) -> str:
    """A plain default as people write it; empty for none and for tables."""
    if isinstance(value, float):
        return f"{value:g}"
    return str(value) if isinstance(value, int | str) and not isinstance(value, bool) else ""


@cache
def _check(cls: type) -> tuple[tuple[str, Setting], ...]:
    return tuple((name, setting) for name, setting in settings(cls).items() if setting.bounds or setting.finite)


@cache
def types(cls: type) -> dict[str, Any]:
    """The types of all that a class holds, by their names."""
    return {field.name: field.type for field in fields(cls)}


def default_of(field: "Field[Any]") -> Any:
    """The default of a setting, MISSING where it must be given."""
    return field.default_factory() if field.default_factory is not MISSING else field.default


def given_values(item: Any) -> dict[str, Any]:
    """The values of an instance that are not the defaults."""
    cls: Any = type(item)
    table = {}
    for field in fields(item):
        value = getattr(item, field.name)
        if field.name in settings(cls) and (default_of(field) is MISSING or value != default_of(field)):
            table[field.name] = value
    return table


def text_of(hint: Any) -> Text | None:
    """The kind of texts in a place of some type, also in a list."""
    found = _of_kind(Text, hint)
    parts = () if found else get_args(hint)
    return found or next(filter(None, map(text_of, parts)), None)


def _of_kind(kind: type, hint: Any) -> Any:
    """The annotation of a kind in a type, None if there is none."""
    return next((item for item in getattr(hint, "__metadata__", ()) if isinstance(item, kind)), None)


def choices(hint: Any) -> tuple[Any, ...]:
    """The alternatives of a type but for None."""
    bare = get_args(hint)[0] if get_origin(hint) is Annotated else hint
    if get_origin(bare) in (Union, UnionType):
        return tuple(own for own in get_args(bare) if own is not NoneType)
    return (bare,)


def is_free(hint: Any) -> bool:
    """Whether a type is a list of any length."""
    return get_origin(hint) is tuple and get_args(hint)[-1] is Ellipsis


def type_words(hint: Any) -> str:
    """Description of the values of a type, for errors and pages: ``a finite number``, ``a list of 3``."""
    text = _of_kind(Text, hint)
    own = choices(hint)
    if text:
        return _TEXTS[text.kind]
    if all(map(is_dataclass, own)):
        return "a table"
    if len(own) > 1:
        return " or ".join(map(type_words, own))
    if own[0] is not hint:
        return type_words(own[0])
    items = get_args(hint)
    if get_origin(hint) is Literal:
        return " or ".join(map(str, items))
    if get_origin(hint) is tuple:
        return f"a list of at most {LONGEST}" if is_free(hint) else f"a list of {len(items)}"
    return _PLAIN[hint]


#: what texts that name files are called, by kind
_TEXTS = {
    "file": "a file name",
    "palette": "a palette name",
    "expression": "a text",
    "seeds": "a text",
    "other": "NAME=FILE,FILE",
}
#: what plain values of a type are called
_PLAIN: dict[Any, str] = {float: "a finite number", int: "a whole number", str: "a text", bool: "true or false"}
