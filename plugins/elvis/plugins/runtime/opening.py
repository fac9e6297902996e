"""Which runtime plugin opens given files: one that is installed, or one in a file that the user names."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from elvis.core.base.errors import ElvisError
from elvis.core.files.plain import check_plain_or_folder
from elvis.plugins.command.registry import PluginError, plugins
from elvis.plugins.conversion.discovery import defined_in
from elvis.plugins.runtime.source import VolumeSource
from elvis.plugins.runtime.volume import Volume
from elvis.plugins.runtime.volume_checks import check_volume

GROUP = "elvis.volumes"

T = TypeVar("T")


@dataclass(frozen=True)
class PluginData:
    """Data that a plugin has opened; whatever goes wrong in the plugin's own code is a PluginError with its name.

    time       what stands for the source's own time, if any
    reference  values of the flow by name
    """

    name: str
    source: VolumeSource
    time: float | None = None
    reference: Mapping[str, float] = field(default_factory=dict)

    @property
    def fields(self) -> tuple[str, ...]:
        """The names of the fields."""
        return call_plugin(self.name, "its fields", lambda: tuple(self.source.fields))

    def volume(self, field: str) -> Volume:
        """The elements with one field, after all checks that need no device."""
        volume = call_plugin(self.name, f"the volume of {field!r}", lambda: self.source.volume(field))
        check_volume(self.name, volume)
        return volume


def open_files(
    paths: Sequence[Path], plugin: str | None = None, report: Callable[[str], object] = str
) -> PluginData | None:
    """The data of the one plugin that opens the files; None if there is none.

    plugin  the name of an installed plugin, or a Python file that defines one; no other plugin is used
    report  called with one line for each plugin that fails
    FormatError for paths that are neither a plain file nor a folder
    """
    for path in paths:
        check_plain_or_folder(path)
    candidates = plugin_named(plugin) if plugin is not None else installed_plugins()
    if plugin is None:
        candidates = {name: source for name, source in candidates.items() if _opens(name, source, paths, report)}
    if len(candidates) > 1:
        files = ", ".join(map(str, paths))
        raise ElvisError(f"{files}: {' and '.join(candidates)} can open them; choose one with --plugin")
    if not candidates:
        return None
    ((name, source),) = candidates.items()
    return PluginData(name, call_plugin(name, f"opening {paths[0]}", lambda: source(paths)))


def installed_plugins() -> dict[str, type[VolumeSource]]:
    """All runtime plugins that open files, by name, without broken ones (see ``elvis plugins``)."""
    found = {}
    for name, plugin in plugins(GROUP).items():
        try:
            loaded = plugin.load()
        except PluginError:
            continue
        if isinstance(loaded, type) and issubclass(loaded, VolumeSource):
            found[name] = loaded
    return found


def plugin_named(plugin: str) -> dict[str, type[VolumeSource]]:
    """The plugin of that name, or the one that a Python file defines; PluginError where there is none."""
    if Path(plugin).suffix == ".py":
        own = [kind for kind in defined_in(Path(plugin)) if issubclass(kind, VolumeSource)]
        if len(own) != 1:
            raise PluginError(
                f"{plugin}: expected one subclass of elvis.plugins.runtime.source.VolumeSource, found {len(own)}"
            )
        return {own[0].__name__: own[0]}
    known = plugins(GROUP)
    if plugin not in known:
        raise PluginError(f"there is no {GROUP} plugin {plugin!r}; there are: {', '.join(known) or 'none'}")
    loaded = known[plugin].load()
    if not (isinstance(loaded, type) and issubclass(loaded, VolumeSource)):
        raise PluginError(
            f"{known[plugin]} opens no files: it is not a subclass of elvis.plugins.runtime.source.VolumeSource"
        )
    return {plugin: loaded}


def _opens(name: str, source: type[VolumeSource], paths: Sequence[Path], report: Callable[[str], object]) -> bool:
    """Whether the plugin opens the files; one that raises doesn't."""
    try:
        return bool(source.opens(paths))
    except MemoryError:
        raise
    except Exception as error:  # noqa: BLE001 - a plugin's own code may raise anything
        report(f"plugin {name} is skipped: for {paths[0]} it raises {type(error).__name__}: {error}")
        return False


def call_plugin(name: str, what: str, work: Callable[[], T]) -> T:
    """The result of a plugin's own code; its exceptions become a PluginError with its name, except ElvisErrors."""
    try:
        return work()
    except (ElvisError, MemoryError):
        raise
    except Exception as error:  # a plugin's own code may raise anything
        raise PluginError(f"plugin {name}: {what}: {type(error).__name__}: {error}") from error
