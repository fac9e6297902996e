"""Plugins found by entry points and loaded on first use; one that is broken never hides another.

A distribution offers a plugin by a line in its ``pyproject.toml``::

    [project.entry-points."elvis.commands"]
    hello = "my_package.hello:hello"
"""

from __future__ import annotations

import os
import re
import sys
from dataclasses import dataclass
from functools import lru_cache
from importlib.metadata import Distribution, EntryPoint, entry_points
from typing import TypeAlias

from elvis.core.base.errors import ElvisError

#: group of entry points -> what one of them names
GROUPS = {
    "elvis.commands": "a click command",
    "elvis.converters": "a conversion plugin",
    "elvis.exporters": "an export",
    "elvis.volumes": "a runtime plugin",
    "elvis.devices": "a device that draws",
    "elvis.comparisons": "pictures for comparison with exact ones",
}
#: what a distribution is called, in its metadata
_HEADER = re.compile(r"^(Name|Version):[ \t]*(.*?)[ \t]*$", re.MULTILINE)
#: our own plugins come first, so that no other distribution can take their names away
_OWN = "elvis-viz"
#: folders of distributions, and when each was last changed, in ns; None if it is absent
Places: TypeAlias = tuple[tuple[str, int | None], ...]


class PluginError(ElvisError):
    """A plugin that does not exist, does not load, or is not what its group asks for."""


@dataclass(frozen=True)
class Plugin:
    """An entry point that may not have been loaded yet.

    distribution  its name and version, as ``elvis-viz 0.1.0``
    """

    group: str
    name: str
    distribution: str
    entry_point: EntryPoint

    def load(self) -> object:
        """The object that the entry point names; whatever goes wrong in its import is a PluginError that says so."""
        try:
            return self.entry_point.load()
        except Exception as error:
            reason = f"{type(error).__name__}: {error}"
            raise PluginError(f"{self} does not load: {reason}") from error

    def __str__(self) -> str:
        return f"{self.group} plugin {self.name!r} ({self.entry_point.value} of {self.distribution})"


def plugins(group: str) -> dict[str, Plugin]:
    """The plugins of a group by name, sorted; of several with one name, ours, else that of the first distribution."""
    chosen: dict[str, Plugin] = {}
    for plugin in every_plugin(group):
        chosen.setdefault(plugin.name, plugin)
    return chosen


def every_plugin(group: str) -> list[Plugin]:
    """All plugins of a group, including several with one name, of which the first one counts.

    The search is repeated after changes of the installed distributions.
    """
    return list(_found(group, _places()))


def _places() -> Places:
    """The current folders of distributions."""
    return tuple((path, _changed(path)) for path in sys.path)


def _changed(path: str) -> int | None:
    """When a folder of ``sys.path`` was changed last, in ns; the empty path is the working folder."""
    try:
        return os.stat(path or os.curdir).st_mtime_ns
    except OSError:
        return None


@lru_cache(maxsize=2 * len(GROUPS))
def _found(group: str, places: Places) -> tuple[Plugin, ...]:
    """All plugins of a group, from metadata of every distribution in these places, which take 10 to 20 ms to read."""
    points = entry_points(group=group)
    owners: dict[int, str] = {}
    for point in points:
        # what a distribution is called is read from its metadata, once for all of its plugins
        if id(point.dist) not in owners:
            owners[id(point.dist)] = _owner(point.dist) if point.dist else "an unknown distribution"
    found = [Plugin(point.group, point.name, owners[id(point.dist)], point) for point in points]
    return tuple(sorted(found, key=lambda p: (p.name, not p.distribution.startswith(_OWN + " "), p.distribution)))


def load(group: str, name: str) -> object:
    """The object that plugin ``name`` of ``group`` names.

    Raises PluginError if there is none, listing the existing ones, and if it does not load.
    """
    known = plugins(group)
    if name not in known:
        raise PluginError(f"there is no {group} plugin {name!r}; there are: {', '.join(known) or 'none'}")
    return known[name].load()


def _owner(distribution: Distribution) -> str:
    """Name and version of a distribution: the first ones in its metadata, which have the form of message headers."""
    text = distribution.read_text("METADATA") or distribution.read_text("PKG-INFO") or ""
    found = dict(_HEADER.findall(text.partition("\n\n")[0])[::-1])
    return f"{found.get('Name')} {found.get('Version')}"
