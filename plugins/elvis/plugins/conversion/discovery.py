"""Which converter reads given files: one that is installed, or one in a file that the user names."""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from typing import Any

from elvis.core.base.errors import ElvisError
from elvis.core.base.needing import is_there
from elvis.core.files.plain import check_plain_or_folder
from elvis.plugins.command.registry import PluginError, plugins
from elvis.plugins.conversion.plugin import Converter, Option
from elvis.plugins.conversion.recognition import found_instead

GROUP = "elvis.converters"

#: where our own converters are, whose libraries come with an extra of their name
_OWN = "elvis."


@dataclass(frozen=True)
class Candidate:
    """A converter by name; ``fault`` says why it doesn't load, None where it does."""

    name: str
    converter: type[Converter] | None
    fault: str | None = None

    @property
    def missing(self) -> tuple[str, ...]:
        """Packages that it needs and that are not installed."""
        return _not_there(self.converter.needs if self.converter else ())


def installed_converters() -> list[Candidate]:
    """All converters of installed distributions, by name; broken ones with the reason."""
    found = []
    for name, plugin in plugins(GROUP).items():
        try:
            loaded = plugin.load()
            if not (isinstance(loaded, type) and issubclass(loaded, Converter)):
                raise PluginError(f"{plugin} is not a subclass of elvis.plugins.conversion.plugin.Converter")
            found.append(Candidate(name, loaded))
        except PluginError as error:
            found.append(Candidate(name, None, str(error)))
    return found


def in_file(path: Path) -> list[Candidate]:
    """The converters that a Python file defines, by class name; PluginError where it has none or doesn't load."""
    own = converters_of(path)
    if not own:
        raise PluginError(f"{path}: expected a subclass of elvis.plugins.conversion.plugin.Converter, found none")
    return own


def converters_of(path: Path) -> list[Candidate]:
    """The converters of a file, like `in_file`, but possibly none."""
    own = [value for value in defined_in(path) if issubclass(value, Converter)]
    return [Candidate(converter.__name__, converter) for converter in own]


def defined_in(path: Path) -> list[type]:
    """The classes that a Python file defines; PluginError where it doesn't load."""
    spec = spec_from_file_location(f"elvis_plugin_{path.stem}", path)
    if spec is None or spec.loader is None or not path.is_file():
        raise PluginError(f"{path}: expected a Python file, found none")
    module = module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:
        raise PluginError(f"{path}: does not load: {type(error).__name__}: {error}") from error
    return [value for value in vars(module).values() if isinstance(value, type) and value.__module__ == spec.name]


def choose_converter(candidates: Sequence[Candidate], paths: Sequence[Path], name: str | None = None) -> Candidate:
    """The candidate of that name, or the one that opens the files; ElvisError where there isn't just one that can."""
    for path in paths:
        check_plain_or_folder(path)
    known = {candidate.name: candidate for candidate in candidates}
    if name is not None and name not in known:
        raise ElvisError(f"there is no converter {name!r}; there are: {', '.join(known) or 'none'}")
    opening = [known[name]] if name is not None else _opening(candidates, paths)
    files = ", ".join(str(path) for path in paths)
    if not opening:
        raise ElvisError(_unopened(candidates, paths))
    if len(opening) > 1:
        several = " and ".join(c.name for c in opening)
        raise ElvisError(f"{files}: {several} can open them; choose one with --from NAME (--reader from=NAME)")
    return _usable(opening[0], paths)


def _opening(candidates: Sequence[Candidate], paths: Sequence[Path]) -> list[Candidate]:
    return [each for each in candidates if each.converter and each.converter.opens(paths)]


def _unopened(candidates: Sequence[Candidate], paths: Sequence[Path]) -> str:
    """Message about files that no converter opens: their names, kind and advice."""
    alone = {path: [each.name for each in _opening(candidates, [path])] for path in paths}
    strange = [path for path, names in alone.items() if not names]
    if strange:
        known = [each.converter for each in candidates if each.converter]
        names = ", ".join(each.name for each in candidates) or "none"
        return f"{strange[0]}: expected a file of a known format ({names}), found {found_instead(strange[0], known)}"
    files = ", ".join(map(str, paths))
    if len({tuple(names) for names in alone.values()}) == 1:
        name = next(iter(alone.values()))[0]
        return f"{files}: expected files that belong together, found {len(paths)} that {name} opens one at a time"
    owners = ", ".join(f"{path.name} ({' or '.join(names)})" for path, names in alone.items())
    return f"{files}: expected files of one converter, found {owners}: give them one by one"


def _not_there(packages: Sequence[str]) -> tuple[str, ...]:
    """The packages that are not installed."""
    return tuple(name for name in packages if not is_there(name))


def _usable(candidate: Candidate, paths: Sequence[Path]) -> Candidate:
    if candidate.fault:
        raise PluginError(candidate.fault)
    missing = _not_there(candidate.converter.needs_of(paths)) if candidate.converter else ()
    if missing and candidate.converter:
        is_own = candidate.converter.__module__.startswith(_OWN)
        command = installing(candidate.name) if is_own else f"pip install {' '.join(missing)}"
        packages = " and ".join(missing)
        raise ElvisError(
            f"the converter {candidate.name} needs {packages}, which is not installed; {command} installs it"
        )
    return candidate


def installing(extra: str) -> str:
    """The command that installs an extra of ElVis: what one of its converters or exports needs, by its name."""
    return f"pip install 'elvis-viz[{extra}]'"


def with_defaults(converter: type[Converter], given: Mapping[str, str | bool]) -> dict[str, Any]:
    """Keywords for the constructor: given options, checked, and their defaults."""
    options = {option.name: option for option in converter.options}
    for name in given:
        if name not in options:
            known = ", ".join(options) or "none"
            raise ElvisError(f"{converter.__name__} has no option {name!r}; its options are: {known}")
    defaults = {name: option.default for name, option in options.items() if option.default is not None}
    named: dict[str, Any] = {**defaults, **{name: _check(options[name], value) for name, value in given.items()}}
    return {name.replace("-", "_"): value for name, value in named.items()}


def _check(option: Option, value: str | bool) -> str | bool:
    """The value of an option; ElvisError where it can't have that."""
    if option.choices is None and isinstance(value, str):
        if value not in ("yes", "no"):
            raise ElvisError(f"option {option.name}: expected yes or no, found {value!r}")
        return value == "yes"
    if option.choices and value not in option.choices:
        raise ElvisError(f"option {option.name}: expected {', '.join(option.choices)}, found {value!r}")
    return value
