"""Subcommands from the entry points ``elvis.commands``, and one way of ending for all of them.

A command is a ``click.Command`` whose module imports the heavy things inside its functions, because ``elvis --help``
loads them all.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import wraps
from typing import Any

import click

from elvis.core.base.errors import ElvisError, fault_sentence
from elvis.core.base.ranks import ALONE, Alone, MpiRanks, is_idle, ranks_of_run
from elvis.core.base.terminal import one_line
from elvis.plugins.command.help_topics import help_command
from elvis.plugins.command.interrupts import INTERRUPTED, Interrupts
from elvis.plugins.command.many_files import STEM, check_braces, for_many_files
from elvis.plugins.command.registry import Plugin, PluginError, plugins

#: options that only `elvis view` has
SERVING = ("--no-browser", "--browser", "--port", "--host", "--allow-host", "--allow-writes", "--idle", "--live")
#: environment variables, one of which is set if a browser can open, except on macOS and Windows
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")
#: the command that is not a plugin
HELP = "help"


@dataclass
class Settings:
    """Settings of the whole run.

    debug  whether the traceback of a failure is shown
    ranks  the processes that run the same command
    """

    debug: bool
    ranks: Alone | MpiRanks = ALONE


def run(arguments: Sequence[str] | None, interrupts: Interrupts) -> int:
    """Run ``elvis`` with ``arguments``, by default the process's own; returns the exit status."""
    settings = Settings(debug=os.environ.get("ELVIS_DEBUG", "0") not in ("", "0"))
    with warnings.catch_warnings():
        if not sys.warnoptions:
            warnings.simplefilter("ignore")
        try:
            status, sentence = _outcome(arguments, settings, interrupts)
        except BaseException:
            settings.ranks.abort(1)
            raise
    if sentence:
        # with nothing in it that a terminal would act on
        print("elvis: error:", one_line(sentence), file=sys.stderr)
    if status == INTERRUPTED:
        settings.ranks.abort(status)
    return settings.ranks.end(status, sentence)


def _outcome(arguments: Sequence[str] | None, settings: Settings, interrupts: Interrupts) -> tuple[int, str]:
    """Run the command to its end: the exit status, and for a failure one sentence."""
    try:
        settings.ranks = ranks_of_run()
        status = elvis.main(arguments, prog_name="elvis", standalone_mode=False, obj=settings)
        sys.stdout.flush()
    except BrokenPipeError:
        _forget_broken_stdout()
        return 1, ""
    except (KeyboardInterrupt, click.Abort):
        return INTERRUPTED, "interrupted"
    except click.ClickException as error:
        return error.exit_code, _usage_sentence(error)
    except Exception as error:  # noqa: BLE001 - also bugs and errors of libraries: each run ends with one sentence
        if settings.debug:
            sys.excepthook(type(error), error, error.__traceback__)
        is_broken = _forget_broken_stdout()
        if interrupts.asked:
            return INTERRUPTED, "interrupted"  # which a library has made something else of
        return 1, f"standard output: {sentence_of(error)}" if is_broken else sentence_of(error)
    return status if isinstance(status, int) else 0, ""


def report_traceback(error: Exception) -> None:
    """Print the traceback of an error that the command continues after, with --debug."""
    context = click.get_current_context(silent=True)
    settings = context.find_object(Settings) if context else None
    if settings is not None and settings.debug:
        sys.excepthook(type(error), error, error.__traceback__)


def sentence_of(error: Exception) -> str:
    """Message for a user about an error."""
    if isinstance(error, ElvisError):
        return str(error)
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    if isinstance(error, MemoryError):
        return f"not enough memory: {error}" if str(error) else "not enough memory"
    if isinstance(error, UnicodeEncodeError) and error.reason == "surrogates not allowed":
        return f"{error.object}: expected a name in UTF-8, as the library requires"
    return f"{fault_sentence(error)}, --debug shows where"


def _usage_sentence(error: click.ClickException) -> str:
    """The error in the command line, and where to find help."""
    message = error.format_message().rstrip(".")
    context = getattr(error, "ctx", None)
    return f"{message} (see {context.command_path} --help)" if context else message


def _forget_broken_stdout() -> bool:
    """Point standard output at nothing where it can't be written, lest the flush at exit say so; whether so."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return True
    return False


def shared(command: Callable[..., None]) -> Callable[..., None]:
    """A command that ranks share, which it gets as ``ranks``; without this the first rank does all."""

    @wraps(command)
    def with_ranks(*arguments: Any, **options: Any) -> None:
        settings = click.get_current_context().find_object(Settings)
        command(*arguments, ranks=settings.ranks if settings else ALONE, **options)

    vars(with_ranks)[_SHARED] = True
    return with_ranks


#: attribute of shared commands
_SHARED = "is_shared"


def _debug_option() -> click.Option:
    def remember(context: click.Context, parameter: click.Parameter, value: bool) -> None:
        if value and isinstance(context.obj, Settings):
            context.obj.debug = True

    text = "Show the traceback of a failure."
    return click.Option(["--debug"], is_flag=True, expose_value=False, is_eager=True, callback=remember, help=text)


def _print_version(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    if value:
        from importlib.metadata import version

        click.echo(f"elvis {version('elvis-viz')}")
        context.exit()


def _set_apart(words: list[str]) -> list[str]:
    """Words with a ``--set`` before each of several reference values, as in ``--set mu=1 u_ref=2``."""
    if "--set" not in words:
        return words
    from elvis.core.quantities.reference_values import REFERENCE

    found: list[str] = []
    for word in words:
        name, equals, _ = word.partition("=")
        follows = len(found) > 1 and found[-2] == "--set"
        if follows and equals and name in REFERENCE:
            found.append("--set")
        found.append(word)
    return found


class PluginGroup(click.Group):
    """A group whose commands are the plugins of ``elvis.commands``, loaded when they are requested."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Every name, sorted."""
        return list(_commands(ctx))

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """The command of that name, None where there is none; a broken plugin becomes a command that says so."""
        plugin = _commands(ctx).get(cmd_name)
        if plugin is None:
            return help_command(lambda name: self.get_command(ctx, name)) if cmd_name == HELP else None
        try:
            command = _loaded(plugin)
        except PluginError as error:
            return _broken(cmd_name, error)
        if all("--debug" not in parameter.opts for parameter in command.params):
            command.params.append(_debug_option())
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Resolve as click does, but open bare files; an unknown name is reported with similar ones.

        A command whose outputs name {stem} runs for one file of a pattern after another.
        """
        own_name, command, words = self._resolved(ctx, args)
        words = _set_apart(words)
        if command is not None and any(STEM in word for word in words):
            return own_name, for_many_files(command), words
        # only this command names steps in braces
        if own_name != "watch":
            check_braces(words, ctx)
        return own_name, command, words

    def _resolved(self, ctx: click.Context, args: list[str]) -> tuple[str | None, click.Command | None, list[str]]:
        name = args[0]
        if not name.startswith("-") and name not in (HELP, *self.list_commands(ctx)):
            if _names_data(name):
                return super().resolve_command(ctx, [_showing_command(ctx, args), *args])
            raise click.UsageError(f"there is no command {name!r}{self._suggestion(name, ctx)}", ctx)
        return super().resolve_command(ctx, args)

    def _suggestion(self, name: str, ctx: click.Context) -> str:
        from difflib import get_close_matches

        near = get_close_matches(name, self.list_commands(ctx), cutoff=0.5)
        return f"; did you mean {' or '.join(near)}?" if near else ""


def _names_data(word: str) -> bool:
    """Whether the first word is a file, or is written as one, rather than a command."""
    return os.path.exists(word) or any(mark in word for mark in (".", "*", os.sep))


def has_screen() -> bool:
    """Whether a browser can open."""
    return sys.platform in ("darwin", "win32") or any(map(os.environ.get, SCREENS))


def _showing_command(context: click.Context, words: list[str]) -> str:
    """The command for files alone: ``view``, or ``render`` if no browser can open and no option is of ``view``."""
    settings = context.find_object(Settings)
    is_alone = settings is None or settings.ranks.size == 1
    is_served = any(word.split("=")[0] in SERVING for word in words)
    if is_alone and (has_screen() or is_served):
        return "view"
    if is_alone:
        print("elvis: note: no screen here, so this draws a picture; elvis view DATA serves a page", file=sys.stderr)
    return "render"


def _commands(context: click.Context) -> dict[str, Plugin]:
    """The plugins of ``elvis.commands``, searched for once in a run."""
    found: dict[str, Plugin] = context.meta.setdefault("elvis.commands", {})
    if not found:
        found.update(plugins("elvis.commands"))
    return found


def _loaded(plugin: Plugin) -> click.Command:
    command = plugin.load()
    if not isinstance(command, click.Command):
        raise PluginError(f"{plugin} is not a click command but {type(command).__name__}")
    return command


def _broken(name: str, error: PluginError) -> click.Command:
    """A command that accepts any arguments and only reports its fault."""

    def fail(**ignored: object) -> None:
        raise error

    return click.Command(
        name,
        callback=fail,
        params=[click.Argument(["anything"], nargs=-1, type=click.UNPROCESSED)],
        context_settings={"ignore_unknown_options": True, "help_option_names": []},
        short_help="(does not load, see elvis plugins)",
    )


@click.group(
    cls=PluginGroup,
    invoke_without_command=True,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
@click.option(
    "--version", is_flag=True, expose_value=False, is_eager=True, callback=_print_version, help="Show the version."
)
@click.pass_context
def elvis(context: click.Context) -> None:
    """Pixel-exact pictures of high-order finite element solutions.

    DATA is one or more files in any order: meshes and fields are recognised by their content.
    elvis DATA opens them in a browser.  elvis help geometry describes surfaces, curves and seeds.
    """
    if context.invoked_subcommand is None:
        click.echo(context.get_help())
        return
    command = elvis.get_command(context, context.invoked_subcommand)
    is_shared = command is not None and hasattr(command.callback, _SHARED)
    settings = context.find_object(Settings)
    if settings is not None and not is_shared and is_idle(settings.ranks):
        context.exit()


elvis.params.append(_debug_option())
