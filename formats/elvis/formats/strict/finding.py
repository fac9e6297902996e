"""Findings about files: violations of rules that the format's own programs enforce, and of good practice."""

from __future__ import annotations

from dataclasses import dataclass, replace

from elvis.core.base.terminal import one_line


@dataclass(frozen=True)
class Finding:
    """A broken rule.

    place        position of the defect
    sentence     the defect
    is_required  whether the format's programs stop at it or misread it; otherwise it violates good practice
    """

    place: str
    sentence: str
    is_required: bool

    def within(self, file: str) -> Finding:
        """The finding in a file."""
        return replace(self, place=f"{file}, {self.place}")

    def __str__(self) -> str:
        """One line, for any names in the file."""
        return one_line(f"{self.place}: {self.sentence}")


def library_rule(place: str, sentence: str) -> Finding:
    """A rule on which the format's own programs insist."""
    return Finding(place, sentence, True)


def style_rule(place: str, sentence: str) -> Finding:
    """A rule that genuine files also break: digits, orders, and defects that readers correct or only warn about."""
    return Finding(place, sentence, False)
