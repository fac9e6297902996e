"""``elvis devices``: what can draw here."""

from __future__ import annotations

import click

EPILOG = """\b
Examples:
  elvis devices
  elvis render wing.xml wing.fld --plane 0,0,0:0,0,1 --device vulkan:1 -o wing.png
"""


@click.command(epilog=EPILOG, short_help="List the devices that can draw.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def devices(as_json: bool) -> None:
    """List the devices that can draw, and the one that --device auto takes."""
    from elvis.core.terminal import print_json, print_table
    from elvis.plugins.registry import plugins
    from elvis.renderer.adapters import ADVICE, adapters, choose

    chosen = choose("auto").name
    rows = [
        (a.name, "software" if a.software else "GPU", a.label, "auto" if a.name == chosen else "") for a in adapters()
    ]
    rows += [
        (name, "software", f"plugin of {plugin.distribution}", "")
        for name, plugin in plugins("elvis.devices").items()
        if name != "auto"
    ]
    if as_json:
        keys = ("name", "kind", "label", "auto")
        print_json([dict(zip(keys, (*row[:3], row[3] == "auto"), strict=True)) for row in rows])
        return
    print_table(("device", "kind", "what it is", ""), rows)
    if not any(row[0].startswith("vulkan") for row in rows):
        click.echo(f"No Vulkan device was found: {ADVICE}.", err=True)
