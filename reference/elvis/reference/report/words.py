"""Numbers in words that people read."""

from __future__ import annotations


def size(count: float) -> str:
    """Bytes, in decimal units: ``9.1 GB``."""
    for unit in ("B", "kB", "MB", "GB"):
        if count < 999.5 or (unit == "B" and count < 1000):
            return f"{count:.0f} {unit}" if unit == "B" or count >= 99.95 else f"{count:.2g} {unit}"
        count /= 1000
    return f"{count:.3g} TB"


def some(number: float | None) -> str:
    """A number with its significant digits only; a dash for None."""
    if number is None:
        return "–"
    if number == 0:
        return "0"
    if abs(number) >= 99.5:
        return f"{number:,.0f}"
    return f"{number:.2g}" if abs(number) >= 1e-3 else f"{number:.1e}"


def percent(number: float | None) -> str:
    """``2.4 %``."""
    return f"{some(number)} %"


def count_of(count: int, noun: str) -> str:
    """``1 pixel``, ``2,000 pixels``."""
    return f"{count:,} {noun}{'' if count == 1 else 's'}"
