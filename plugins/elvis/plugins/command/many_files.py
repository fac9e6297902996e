"""One command for many files: ``elvis render 'case_*.fld' mesh.xml -o '{stem}.png'``.

A pattern among the files of a command stands for one case after another if outputs name ``{stem}``, the name of its
file without the suffix; other files belong to each case.  With several patterns, files with the same texts for the
marks form a case.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import click

from elvis.core.base.errors import ElvisError
from elvis.plugins.series.step_names import MARKS, expanded

STEM = "{stem}"
#: parameters of commands that name their files, and the outputs that they write
_FILES = ("data", "files")
_OUTPUTS = ("output", "outputs", "plot", "stats", "save_scene")
_BRACES = re.compile(r"\{\w+\}")


@dataclass(frozen=True)
class Case:
    """One run of a command.

    name   of the file that is its own
    words  of the command line; none where a file is missing, which ``fault`` says
    """

    name: str
    words: tuple[str, ...]
    fault: str = ""


def for_many_files(command: click.Command) -> click.Command:
    """A command that takes the same words, and runs the other one for each case that they stand for."""

    def run_all(words: tuple[str, ...]) -> None:
        context = click.get_current_context()
        own = click.Context(command, context.parent, context.info_name)
        try:
            given, *_ = command.make_parser(own).parse_args(list(words))
        except click.UsageError:
            # the command may report further faults
            command.make_context(context.info_name, list(words), context.parent)
            raise

        def run(some: Sequence[str]) -> object:
            with command.make_context(context.info_name, list(some), context.parent) as made:
                return command.invoke(made)

        run_cases(cases(words, given, own), run)

    settings = {"ignore_unknown_options": True, "help_option_names": []}
    everything = click.Argument(["words"], nargs=-1, type=click.UNPROCESSED)
    return click.Command(command.name, callback=run_all, params=[everything], context_settings=settings)


def check_braces(words: Sequence[str], context: click.Context) -> None:
    """UsageError for an output whose name has other braces than ``{stem}``."""
    for flag, word in pairwise(words):
        found = _BRACES.search(word) if flag in ("-o", "--output", "--plot") else None
        if found and STEM not in word:
            raise click.UsageError(f"{word}: expected {STEM}, found {found[0]}", context)


def cases(words: Sequence[str], given: Mapping[str, object], context: click.Context) -> list[Case]:
    """The runs that words stand for.

    words    of a command line in which ``{stem}`` occurs
    given    their values, by the names of the command's parameters

    UsageError if no file is a pattern, or if an output would be overwritten repeatedly; ElvisError if no files match,
    or two have the same stem.
    """
    files = next((value for name in _FILES if isinstance(value := given.get(name), (tuple, list))), ())
    patterns = [str(file) for file in files if MARKS.search(str(file)) and not Path(str(file)).exists()]
    if not patterns:
        raise click.UsageError(
            f"{STEM}: expected a pattern of files in quotes, such as 'case_*.fld', found none", context
        )
    _check_outputs(given, context)
    matches = [_matches(pattern) for pattern in patterns]
    stems: dict[str, str] = {}
    for file in matches[0].values():
        stem = _stem(file)
        if stem in stems:
            raise ElvisError(
                f"{stems[stem]} and {file} have the same stem, so {STEM} would name the same output for both"
            )
        stems[stem] = file
    return [_case(words, patterns, matches, key) for key in matches[0]]


def run_cases(every: Sequence[Case], run: Callable[[Sequence[str]], object]) -> None:
    """Run a command for one case after the other; ElvisError at the end that sums up what failed.

    run  runs words; a status that it returns, or exits with, which isn't 0 is a failure

    Usage errors and interrupts end all.
    """
    from elvis.core.base.terminal import announce, warn
    from elvis.plugins.command.running import report_traceback, sentence_of

    failures: list[str] = []
    for number, case in enumerate(every, 1):
        announce(f"{number} of {len(every)}: {case.name}")
        fault = case.fault
        try:
            status = 0 if fault else run(case.words)
        except SystemExit as end:
            status = end.code
        except (click.ClickException, click.Abort, BrokenPipeError):
            raise
        except Exception as error:  # noqa: BLE001 - any failure of a case, also a bug, must leave the other cases
            report_traceback(error)
            status, fault = 1, sentence_of(error)
        if fault or (isinstance(status, int) and status):
            fault = fault or f"exit status {status}"
            warn(fault if fault.startswith(case.name) else f"{case.name}: {fault}")
            failures.append(case.name)
    if failures:
        raise ElvisError(f"{len(failures)} of {len(every)} cases failed: {', '.join(failures)}")


def _check_outputs(given: Mapping[str, object], context: click.Context) -> None:
    """UsageError for an output that all cases would write."""
    for name in _OUTPUTS:
        value = given.get(name)
        texts = value if isinstance(value, (tuple, list)) else [] if value is None else [value]
        for text in texts:
            if STEM not in str(text):
                raise click.UsageError(f"expected {STEM} in each output, as all cases would write {text}", context)


def _matches(pattern: str) -> dict[tuple[str, ...], str]:
    """The files of a pattern by the texts that its marks stand for, in the order of their numbers."""
    form = re.compile("".join(_of_mark(mark) for mark in MARKS.split(Path(pattern).name)), re.S)
    found = {}
    for file in expanded([Path(pattern)]):
        match = form.fullmatch(file.name)
        if match is not None:
            found[match.groups()] = str(file)
    return found


def _of_mark(text: str) -> str:
    """A regular expression for a part of a pattern."""
    if text.startswith("[") and text.endswith("]"):
        return f"([{text[1:-1].replace('!', '^', 1) if text[1] == '!' else text[1:-1]}])"
    return {"*": "(.*)", "?": "(.)"}.get(text) or re.escape(text)


def _case(
    words: Sequence[str],
    patterns: Sequence[str],
    matches: Sequence[Mapping[tuple[str, ...], str]],
    key: tuple[str, ...],
) -> Case:
    """The run for the files of a key."""
    name = matches[0][key]
    for pattern, found in zip(patterns, matches, strict=True):
        if key not in found:
            return Case(name, (), f"{pattern}: expected a file with {', '.join(key)} in its name, found none")
    files = {pattern: found[key] for pattern, found in zip(patterns, matches, strict=True)}
    stem = _stem(name)
    return Case(name, tuple(_substituted(words, files, stem)))


def _substituted(words: Sequence[str], files: Mapping[str, str], stem: str) -> Iterator[str]:
    for word in words:
        yield files[word] if word in files else word.replace(STEM, stem)


def _stem(file: str) -> str:
    """The name of a file without its suffix, and without .gz."""
    return Path(Path(file).name.removesuffix(".gz")).stem
