"""Tables as aligned Markdown, which reads well on a terminal and in a results file alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field


@dataclass
class Table:
    """Rows of texts under a title; ``notes`` follow, one a paragraph."""

    title: str
    columns: Sequence[str]
    rows: list[Sequence[str]] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def text(self) -> str:
        """Title, table and notes."""
        cells = [list(self.columns), *[list(row) for row in self.rows]]
        widths = [max(len(row[i]) for row in cells) for i in range(len(self.columns))]
        lines = [_line(cells[0], widths)]
        lines.append("|" + "|".join("-" * (w + 1) + (":" if i else "-") for i, w in enumerate(widths)) + "|")
        lines += [_line(row, widths) for row in cells[1:]]
        return "\n".join([f"## {self.title}", "", *lines, *[f"\n{note}" for note in self.notes], ""])


def _line(row: Sequence[str], widths: Sequence[int]) -> str:
    """First column to the left, all others to the right."""
    padded = [
        cell.rjust(width) if i else cell.ljust(width) for i, (cell, width) in enumerate(zip(row, widths, strict=True))
    ]
    return "| " + " | ".join(padded) + " |"


def seconds(value: float) -> str:
    """Seconds to three digits."""
    return f"{value:.3g}" if value >= 1 else f"{value:.4f}" if value < 0.01 else f"{value:.3f}"


def mebibytes(value: float) -> str:
    """Bytes in MiB."""
    return f"{value / 2**20:,.1f}" if value < 100 * 2**20 else f"{value / 2**20:,.0f}"


def percent(share: float) -> str:
    """A share of 1 in percent, none told from few."""
    return "0" if share == 0 else f"{100 * share:.3f}" if share < 0.01 else f"{100 * share:.1f}"
