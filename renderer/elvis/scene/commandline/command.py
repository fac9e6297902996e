"""Commands that draw: they have the options of a scene, created on first use, and options of their own."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import click

from elvis.core.data.arguments import FIELDS_DECLARATION, TextType

#: whether the help lists all options, in the meta data of a context
ALL_OPTIONS = "elvis.all_options"
#: lines of the examples in the short help
SHORT_EXAMPLES = 8
#: what a figure has around and over its pixels, by keys of a scene
FIGURE = (
    *("title", "axes", "scale_bar", "box", "outline", "font", "font_size", "dpi"),
    *("texts", "image", "domain_outline", "panels"),
)
OUTPUT = click.Path(path_type=Path, dir_okay=False)


class SceneCommand(click.Command):
    """A command with the options of all keys of a scene, except the keys in ``leaving``."""

    def __init__(self, *arguments: Any, leaving: Sequence[str] = (), **rest: Any) -> None:
        super().__init__(*arguments, **rest)
        self.leaving = leaving
        self._scene_options: list[click.Option] = []
        self._fields = click.Option(["--fields"], **FIELDS_DECLARATION)
        self._help_all = click.Option(
            ["--help-all"],
            is_flag=True,
            is_eager=True,
            expose_value=False,
            callback=_show_all_options,
            help="Show all options and exit.",
        )

    def get_params(self, ctx: click.Context) -> list[click.Parameter]:
        """Arguments, the options of a scene, its own options."""
        from elvis.scene.commandline.options import scene_options

        self._scene_options = self._scene_options or scene_options(self.leaving)
        own = super().get_params(ctx)
        arguments = [parameter for parameter in own if isinstance(parameter, click.Argument)]
        return [*arguments, *self._scene_options, self._fields, *own[len(arguments) :], self._help_all]

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse as click does, but also accept option names of other programs; a hint replaces unsuitable ones."""
        from elvis.scene.commandline.other_programs import advice, in_own_words

        known = {name for parameter in self.get_params(ctx) for name in (*parameter.opts, *parameter.secondary_opts)}
        try:
            return super().parse_args(ctx, in_own_words(args, known))
        except click.NoSuchOption as error:
            told = advice(error.option_name)
            if not told:
                raise
            raise click.UsageError(f"there is no option {error.option_name}: {told}", ctx) from error

    def format_help(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the help: common options and examples only, unless ``--help-all`` requested all of them."""
        if ctx.meta.get(ALL_OPTIONS):
            super().format_help(ctx, formatter)
            return
        self.format_usage(ctx, formatter)
        self.format_help_text(ctx, formatter)
        self._format_common(ctx, formatter)
        formatter.write_paragraph()
        formatter.write(first_lines(self.epilog or "", SHORT_EXAMPLES))

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write all options in chapters."""
        for title, options in self._chapters(ctx).items():
            records = [record for option in options if (record := option.get_help_record(ctx))]
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)

    def _format_common(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the common options in chapters, each with the names of its other options."""
        from elvis.scene.commandline.options import COMMON

        names_of_scene = {option.name for option in (*self._scene_options, self._fields)}
        for title, options in self._chapters(ctx).items():
            records = []
            others = []
            for option in options:
                if option.name in names_of_scene and option.name not in COMMON:
                    others.append(option.opts[0])
                elif record := option.get_help_record(ctx):
                    records.append(record)
            if others:
                records.append(("...", f"{', '.join(others)}: see --help-all"))
            if records:
                with formatter.section(title):
                    formatter.write_dl(records)

    def _chapters(self, ctx: click.Context) -> dict[str, list[click.Option]]:
        """The options by the chapters of the help."""
        from elvis.scene.commandline.options import CHAPTERS, chapter_of

        chapters: dict[str, list[click.Option]] = {title: [] for title in CHAPTERS}
        for parameter in self.get_params(ctx):
            if isinstance(parameter, click.Option):
                chapters[chapter_of(parameter.name or "")].append(parameter)
        return chapters


def _show_all_options(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    """Print the help with all options, and exit."""
    if value and not context.resilient_parsing:
        context.meta[ALL_OPTIONS] = True
        click.echo(context.get_help(), color=context.color)
        context.exit()


def first_lines(epilog: str, count: int) -> str:
    """The first lines of the examples in an epilog, indented."""
    lines = epilog.lstrip("\b\n").splitlines()[:count]
    return "".join(f"  {line}".rstrip() + "\n" for line in lines)


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
    help="Set any other key of the scene, or a reference value of the flow by its name, such as mu=2e-4.  Repeatable.",
)
