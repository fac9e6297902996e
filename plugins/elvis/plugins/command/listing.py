"""``elvis plugins``: installed plugins, their origin, and faults in loading."""

from __future__ import annotations

from collections.abc import Iterator

import click

from elvis.plugins.command.registry import GROUPS, Plugin, PluginError, every_plugin


@click.command("plugins", short_help="List the installed commands, converters, volumes and devices.")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON list instead of a table.")
def plugins(as_json: bool) -> None:
    """List the installed commands, converters, volumes and devices, and the state of each.

    A plugin that does not load is listed with the reason; it does not affect the others.
    """
    from elvis.core.base.terminal import print_table

    rows = list(_rows())
    if as_json:
        import json

        keys = ("kind", "name", "distribution", "object", "state")
        click.echo(json.dumps([dict(zip(keys, row, strict=True)) for row in rows], indent=2))
        return
    print_table(("kind", "name", "distribution", "object", "state"), rows)


def _rows() -> Iterator[tuple[str, str, str, str, str]]:
    for group in GROUPS:
        seen: set[str] = set()
        for plugin in every_plugin(group):
            state = _state(plugin, hidden=plugin.name in seen)
            seen.add(plugin.name)
            yield group.removeprefix("elvis."), plugin.name, plugin.distribution, plugin.entry_point.value, state


def _state(plugin: Plugin, hidden: bool) -> str:
    """``ok``, or why the plugin cannot be used."""
    if hidden:
        return "hidden: the name is taken by the plugin above"
    try:
        plugin.load()
    except PluginError as error:
        return str(error.__cause__ and f"{type(error.__cause__).__name__}: {error.__cause__}")
    return "ok"
