"""``elvis devices``: the devices that can draw."""

from __future__ import annotations

import click

EPILOG = """\b
Examples:
  elvis devices
  elvis render wing.xml wing.fld --plane 0,0,0:0,0,1 --device vulkan:1 -o wing.png
"""


@click.command(epilog=EPILOG, short_help="List the devices that can draw.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
@click.option("--caches", "is_of_caches", is_flag=True, help="List the caches instead: folders, files and bytes.")
def devices(as_json: bool, is_of_caches: bool) -> None:
    """List the devices that can draw, and the one that --device auto chooses."""
    if is_of_caches:
        _list_caches(as_json)
        return
    from elvis.core.base.terminal import print_json, print_table, warn
    from elvis.plugins.command.registry import plugins
    from elvis.renderer.device.adapters import ADVICE, COMPILER_ADVICE, adapters, by_preference, unfit
    from elvis.renderer.device.errors import DeviceError

    advice = []
    try:
        every = adapters()
    except DeviceError as error:
        every = []
        advice.append(str(error))
    else:
        if not any(adapter.kind == "vulkan" for adapter in every):
            advice.append(f"no Vulkan device was found: {ADVICE}")
        if not any(adapter.kind == "cpu" for adapter in every):
            advice.append(f"the device cpu is not available: {COMPILER_ADVICE}")
    reasons = {adapter.name: unfit(adapter) for adapter in every}
    chosen = next((adapter.name for adapter in by_preference(every) if not reasons[adapter.name]), "")
    rows = [(a.name, "software" if a.software else "GPU", a.label, a.name == chosen, reasons[a.name]) for a in every]
    rows += [
        (name, "software", f"plugin of {plugin.distribution}", False, "")
        for name, plugin in plugins("elvis.devices").items()
        if name != "auto"
    ]
    if as_json:
        keys = ("name", "kind", "label", "auto", "problem")
        print_json([dict(zip(keys, row, strict=True)) for row in rows])
        return
    said = [(*row[:3], "auto" if row[3] else row[4] and f"skipped: it {row[4]}") for row in rows]
    print_table(("device", "kind", "description", ""), said)
    for sentence in advice:
        warn(sentence)


def _list_caches(as_json: bool) -> None:
    """Print where and how much is cached on the disk, and the limit of tables in the memory of a process."""
    from elvis.core.base.bounded_cache import MAX_BYTES
    from elvis.core.base.memory import size_text
    from elvis.core.base.terminal import print_json, print_table
    from elvis.core.files.keeping import cache_folder, kept_files

    found = [(name, cache_folder(name), *kept_files(name)) for name in ("kernels", "conversions")]
    if as_json:
        shown = [(name, None if folder is None else str(folder), *counts) for name, folder, *counts in found]
        caches = [dict(zip(("name", "folder", "files", "bytes"), row, strict=True)) for row in shown]
        print_json({"caches": caches, "most_bytes_of_tables_in_memory": MAX_BYTES})
        return
    rows = [(name, str(folder or "nowhere"), str(count), size_text(size)) for name, folder, count, size in found]
    rows.append(("tables", f"in the memory of a process, {size_text(MAX_BYTES)} at most", "", ""))
    print_table(("cache", "folder", "files", "size"), rows)
