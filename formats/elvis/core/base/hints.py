"""Suggestions for unknown names: what the user may have meant."""

from __future__ import annotations

from collections.abc import Iterable
from difflib import get_close_matches


def nearest(name: str, known: Iterable[str]) -> str:
    """The known name that differs in upper and lower case, or little more; empty if none is near."""
    names = list(dict.fromkeys(known))
    folded = {each.lower(): each for each in reversed(names)}
    if name.lower() in folded:
        return folded[name.lower()]
    near = get_close_matches(name.lower(), folded, 1)
    return folded[near[0]] if near else ""


def perhaps(name: str, known: Iterable[str]) -> str:
    """`` (perhaps NEAR)``, to append to a name in a message; empty if no known name is similar."""
    near = nearest(name, known)
    return f" (perhaps {near})" if near else ""
