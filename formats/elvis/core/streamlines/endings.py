"""Kinds of ends of streamlines."""

from __future__ import annotations

from collections.abc import Sequence
from enum import IntEnum


class End(IntEnum):
    """Numbers of ends; further numbers, from ``len(End)`` on, are boundaries through which lines leave the domain."""

    GOING = 0
    LEFT = 1
    LENGTH = 2
    DURATION = 3
    SPEED = 4
    STEPS = 5
    STAGNATION = 6
    JUMP = 7
    OUTSIDE = 8
    NAN = 9
    INVERTED = 10
    FAILED = 11


#: names of the ends, and their meanings
WORDS = {
    End.GOING: ("going", "under way"),
    End.LEFT: ("left", "left the domain, or the wall that it is on"),
    End.LENGTH: ("length", "reached the requested length"),
    End.DURATION: ("duration", "reached the requested duration"),
    End.SPEED: ("speed", "fell below the requested speed"),
    End.STEPS: ("steps", "reached the maximum number of steps"),
    End.STAGNATION: ("stagnation", "came to rest"),
    End.JUMP: ("jump", "reached a jump of the velocity that points back"),
    End.OUTSIDE: ("outside", "begin outside the mesh"),
    End.NAN: ("nan", "reached a velocity that is not a number"),
    End.INVERTED: ("inverted", "reached an inverted element"),
    End.FAILED: ("failed", "could not be followed to the tolerance"),
}
#: the name of the end of a line that was cut after it was traced, which follows the names of boundaries
CLIPPED = ("clip", "reached a part that --clip removes")


def end_names(boundaries: Sequence[str]) -> tuple[str, ...]:
    """The name of each end by its number, the names of boundaries last."""
    return (*(WORDS[end][0] for end in End), *boundaries)
