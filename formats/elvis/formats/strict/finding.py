"""What a check of files finds: rules that the format's own programs insist on, and others that are good practice."""

from __future__ import annotations

from dataclasses import dataclass, replace

from elvis.core.terminal import one_line


@dataclass(frozen=True)
class Finding:
    """A broken rule.

    place        where
    sentence     what is wrong there
    is_required  whether programs of the format stop at it, or read something else; else it is good practice
    """

    place: str
    sentence: str
    is_required: bool

    def within(self, file: str) -> Finding:
        """The same, in a file."""
        return replace(self, place=f"{file}, {self.place}")

    def __str__(self) -> str:
        """One line, whatever the names in the file hold."""
        return one_line(f"{self.place}: {self.sentence}")


def library_rule(place: str, sentence: str) -> Finding:
    """A rule on which the format's own programs insist."""
    return Finding(place, sentence, True)


def style_rule(place: str, sentence: str) -> Finding:
    """A rule that genuine files break, too: digits, orders, what readers make up for or only warn of."""
    return Finding(place, sentence, False)
