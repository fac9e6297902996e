"""The exceptions that reach a user: one sentence each, with a place, an expectation and a fact."""

from __future__ import annotations

from pathlib import Path


class ElvisError(Exception):
    """Anything that stops a command for a reason that a user can act on; the message is one sentence."""


class FormatError(ElvisError):
    """A file that does not hold what its format promises.

    The message reads ``file: place: expected …, found …``; parts that are unknown are left out.
    """

    def __init__(self, message: str, *, file: str | Path | None = None, place: str | None = None) -> None:
        self.message, self.file, self.place = message, file, place
        super().__init__(": ".join(str(part) for part in (file, place, message) if part))

    def within(self, file: str | Path | None = None, place: str | None = None) -> FormatError:
        """The same error with the file or place filled in where they were missing."""
        return FormatError(self.message, file=self.file or file, place=self.place or place)
