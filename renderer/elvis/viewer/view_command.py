"""``elvis view``: a window of the browser in which data are turned, cut, picked and edited."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from elvis.core.arguments import cache_option
from elvis.scene.commandline.command import SceneCommand, text_type

#: keys of a scene that have no meaning for a window
LEAVING = ("outputs", "stats", "panels", "scenes", "plain", "timeout")
EPILOG = """\b
Examples:
  elvis view wing.xml wing.fld
  elvis view flow.vtu --field p --plane 0,0,0.2:0,0,1
  elvis view wing.toml --port 8080 --no-browser
"""


@click.command(cls=SceneCommand, leaving=LEAVING, epilog=EPILOG, short_help="Turn, cut, pick and edit in a browser.")
@click.argument("data", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="[SCENE] DATA...")
@click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    type=text_type("setting"),
    help="Any other key of the scene.",
)
@click.option("--host", default="localhost", show_default=True, help="The address to listen at; others can reach it.")
@click.option("--port", default=0, type=click.IntRange(0, 65535), help="The port to listen at.  [default: a free one]")
@click.option("--browser/--no-browser", default=True, help="Open a browser.")
@click.option("--idle", type=click.FloatRange(0), metavar="SECONDS", help="End once no page has looked for so long.")
@cache_option
def view(
    data: tuple[Path, ...],
    settings: tuple[tuple[str, str], ...],
    host: str,
    port: int,
    browser: bool,
    idle: float | None,
    no_cache: bool,
    **options: Any,
) -> None:
    """Look at DATA (mesh and field files, or a scene) in a browser: a page is served here, and its address printed.

    What stands still is exact, as elvis render draws it.  Ctrl-C ends it.
    """
    import asyncio
    import webbrowser
    from contextlib import suppress

    from elvis.core.terminal import say
    from elvis.scene.commandline.composing import composed
    from elvis.scene.errors import SceneError
    from elvis.viewer.drawing_process import Source
    from elvis.viewer.server import Server, serve
    from elvis.viewer.session import Session

    scene = composed(data, options, settings, LEAVING)
    if not scene.data:
        raise SceneError("the scene names no data: give the mesh and field files too")

    def opened(address: str) -> None:
        say(f"{address}\nCtrl-C ends it")
        if browser:
            webbrowser.open(address)

    async def run() -> None:
        source = Source(scene.data, None, scene.plugin, scene.reader, not no_cache, scene.device)
        await serve(Server(Session(scene, source)), host, port, opened, idle)

    with suppress(KeyboardInterrupt):
        asyncio.run(run())
