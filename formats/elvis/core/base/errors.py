"""The exceptions that reach a user: one sentence each, with a place, an expectation and a fact."""

from __future__ import annotations

from pathlib import Path


class ElvisError(Exception):
    """An error that the user can act on; its message is one sentence.

    A message that quotes texts is one line; long ones are shortened to the beginning and the end.

    keeps_lines  whether messages quote a compiler, line by line
    """

    keeps_lines = False

    def __init__(self, *args: object) -> None:
        super().__init__(*(self._limited(each) if isinstance(each, str) else each for each in args))

    def _limited(self, message: str) -> str:
        return _shortened(message, _LONGEST_OF_ALL) if self.keeps_lines else _in_a_line(message, _LONGEST_OF_ALL)


def fault_sentence(error: Exception) -> str:
    """The message of an ElvisError; for other errors, a sentence that calls them a bug."""
    if isinstance(error, ElvisError):
        return str(error)
    what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return f"unexpected {what}; this is a bug in ElVis"


#: maximum length of a message about a file, in characters; longer ones only quote more of the file
_LONGEST = 1000
#: characters of any message
_LONGEST_OF_ALL = 1900


class FormatError(ElvisError):
    """A file that violates its format.

    The message reads ``file: place: expected …, found …``; unknown parts are omitted.
    """

    def __init__(self, message: str, *, file: str | Path | None = None, place: str | None = None) -> None:
        self.message, self.file, self.place = _in_a_line(message, _LONGEST), file, place and _in_a_line(place, _LONGEST)
        super().__init__(": ".join(str(part) for part in (file, self.place, self.message) if part))

    def within(self, file: str | Path | None = None, place: str | None = None) -> FormatError:
        """The error with missing file and place filled in."""
        return FormatError(self.message, file=self.file or file, place=self.place or place)


def _in_a_line(text: str, longest: int) -> str:
    """The text without ends of lines; if it is longer than ``longest``, the beginning and the end."""
    return _shortened(" ".join(part.strip() for part in text.splitlines()), longest)


def _shortened(text: str, longest: int) -> str:
    """The text; if it is longer than ``longest``, the beginning and the end."""
    half = longest // 2
    return text if len(text) <= longest else f"{text[:half]} … {text[-half:]}"
