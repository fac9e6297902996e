"""Commands that draw: their options are those of a scene, made when they are first needed, and some of their own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from elvis.core.arguments import FIELDS_DECLARATION, TextType

#: what a figure has around and over its pixels, by keys of a scene
FIGURE = ("title", "axes", "scale_bar", "box", "outline", "font", "font_size", "dpi", "panels")
OUTPUT = click.Path(path_type=Path, dir_okay=False)


class SceneCommand(click.Command):
    """A command with all options of a scene, but for those of the keys that it leaves out."""

    def __init__(self, *arguments: Any, leaving: Sequence[str] = (), **rest: Any) -> None:
        super().__init__(*arguments, **rest)
        self.leaving = leaving
        self._scene_options: list[click.Option] = []
        self._fields = click.Option(["--fields"], **FIELDS_DECLARATION)

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Arguments, the options of a scene, its own options."""
        from elvis.scene.commandline.options import scene_options

        self._scene_options = self._scene_options or scene_options(self.leaving)
        own = super().get_params(ctx)
        arguments = [parameter for parameter in own if isinstance(parameter, click.Argument)]
        return [*arguments, *self._scene_options, self._fields, *own[len(arguments) :]]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """As click does, but with words of other programs; a hint names what some of them need."""
        from elvis.scene.commandline.other_programs import advice, in_own_words

        known = {name for parameter in self.get_params(ctx) for name in (*parameter.opts, *parameter.secondary_opts)}
        try:
            return super().parse_args(ctx, in_own_words(args, known))
        except click.NoSuchOption as error:
            told = advice(error.option_name)
            if not told:
                raise
            raise click.UsageError(f"there is no option {error.option_name}: {told}", ctx) from error

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The options in chapters."""
        from elvis.scene.commandline.options import CHAPTERS, chapter_of

        chapters: dict[str, list[tuple[str, str]]] = {title: [] for title in CHAPTERS}
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            if record is not None and isinstance(parameter, click.Option):
                chapters[chapter_of(parameter.name or "")].append(record)
        for title, records in chapters.items():
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)


def text_type(parse: str) -> TextType:
    """The type of texts that a function of `parameters`, imported when it is needed, reads."""

    def read(text: str) -> Any:
        from elvis.scene.commandline import parameters

        function: Callable[[str], Any] = getattr(parameters, parse)
        return function(text)

    return TextType(read)


setting_option = click.option(
    "--set",
    "settings",
    multiple=True,
    metavar="KEY=VALUE",
    type=text_type("setting"),
    help="Any other key of the scene; a reference value of the flow, such as mu=2e-4, by its name alone.",
)
