"""``elvis view``: a window of the browser in which data are turned, cut, picked and edited."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from elvis.core.data.arguments import cache_option
from elvis.scene.commandline.command import SceneCommand, setting_option

#: keys of a scene that have no meaning for a window
LEAVING = ("outputs", "stats", "panels", "scenes", "plain", "timeout")
EPILOG = """\b
Examples:
  elvis view wing.xml wing.fld
  elvis view flow.vtu --field p --plane 0,0,0.2:0,0,1
  elvis view wing.toml --port 8080 --no-browser
  elvis view wing.xml wing_*.chk --range series
  elvis view run/ --live --field p
"""


@click.command(cls=SceneCommand, leaving=LEAVING, epilog=EPILOG, short_help="Explore and edit data in a browser.")
@click.argument("data", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="[SCENE] DATA...")
@setting_option
@click.option(
    "--host",
    default="localhost",
    show_default=True,
    help="Address to listen on; with another address, other machines can connect.",
)
@click.option(
    "--allow-host", multiple=True, metavar="NAME", help="Also accept this host name, such as a proxy.  Repeatable."
)
@click.option("--port", default=0, type=click.IntRange(0, 65535), help="Port to listen on.  [default: a free port]")
@click.option("--browser/--no-browser", default=True, help="Open a browser.  [default: yes]")
@click.option("--idle", type=click.FloatRange(0), metavar="SECONDS", help="Exit if no page connects for this time.")
@click.option("--live", is_flag=True, help="Follow the newest complete step in a folder in which a solver writes.")
@click.option("--allow-writes", is_flag=True, help="Allow the page to write files in the folder of the data or below.")
@cache_option
def view(
    data: tuple[Path, ...],
    settings: tuple[tuple[str, str], ...],
    host: str,
    allow_host: tuple[str, ...],
    port: int,
    browser: bool,
    idle: float | None,
    live: bool,
    allow_writes: bool,
    no_cache: bool,
    **options: Any,
) -> None:
    """Explore DATA (mesh and field files, or a scene) in a browser: serve a page and print its address.

    While the view stands still, the picture is exact and the same as that of elvis render.  Ctrl-C ends the command.
    """
    from elvis.viewer.drawing_process import spawn

    # the drawing process starts while this one processes the command
    process = spawn()
    from contextlib import ExitStack, suppress

    from elvis.core.base.terminal import say
    from elvis.core.files.plain import check_plain_or_folder
    from elvis.plugins.series.step_names import expanded
    from elvis.renderer.asking.series_range import with_range
    from elvis.scene.commandline.composing import composed
    from elvis.scene.model.errors import SceneError
    from elvis.viewer.access import open_browser
    from elvis.viewer.moments import source_of
    from elvis.viewer.server import Server, run_until_interrupted, serve
    from elvis.viewer.session import Session

    scene = composed(data, options, settings, LEAVING)
    if not scene.data:
        raise SceneError("the scene names no data; also give the mesh and field files")
    if live and scene.range == "series":
        raise SceneError("range: later steps are not known: expected visible, all or two values")
    scene = with_range(scene, not no_cache)
    for path in expanded(tuple(map(Path, scene.data))) if not live else ():
        check_plain_or_folder(path)

    def opened(address: str) -> None:
        say(f"{address}\nPress Ctrl-C to stop")
        if browser:
            open_browser(address, pages)

    async def run() -> None:
        source = source_of(scene, is_kept=not no_cache, is_live=live)
        server = Server(Session(scene, source, allow_writes, process), allow_hosts=allow_host)
        # a run that goes on may have its first step later
        await serve(server, host, port, opened, idle, needs_data=not live)

    with suppress(KeyboardInterrupt), ExitStack() as pages:
        run_until_interrupted(run)
