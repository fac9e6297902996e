"""Metadata: free pairs of key and text, of which one is the time."""

from __future__ import annotations

from collections.abc import Mapping


def time_of(metadata: Mapping[str, str]) -> float | None:
    """The time, None where there is none that is a number."""
    try:
        return float(metadata["Time"])
    except (KeyError, ValueError):
        return None
