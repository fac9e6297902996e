"""Motions of a number of the scene over the frames of an animation."""

from __future__ import annotations

import json
from dataclasses import dataclass
from fractions import Fraction
from math import isfinite, pi, sin
from typing import TypeAlias

import numpy as np

from elvis.core.base.arrays import Floats
from elvis.scene.model.errors import SceneError
from elvis.scene.model.files import toml_value

#: the word before the amplitude of an oscillation
MODE = "mode:"
#: the key whose values are angles, and a whole turn of it
PHASE = "phase"
TURN = 360.0


@dataclass(frozen=True)
class Key:
    """Values of a key of the scene at equal parts of the animation, linear between.

    values  (n,) numbers, or (n, k) of lists
    """

    name: str
    values: Floats

    @classmethod
    def of(cls, name: str, text: str, option: str = "") -> Key:
        """``0:1:0``, or ``[0,0,1]:[1,0,0]``; SceneError for texts that are not numbers.

        option  that the text was given with, for errors; by default --key
        """
        parts = [toml_value(part.strip()) for part in text.split(":")]
        try:
            values = np.array(parts, np.float64)
        except (TypeError, ValueError):
            values = np.empty(0)
        if len(values) < 2 or not np.isfinite(values).all():
            option = option or f"--key {name}"
            raise SceneError(f"{option}: expected two or more numbers with colons between them, found {text!r}")
        return cls(name, values)

    def at(self, share: float) -> tuple[str, str]:
        """The key and its value, as `with_settings` takes them, at a share of the animation from 0 to 1."""
        place = share * (len(self.values) - 1)
        first = min(int(place), len(self.values) - 2)
        value = self.values[first] + (place - first) * (self.values[first + 1] - self.values[first])
        return self.name, json.dumps(value.tolist())

    def of_frame(self, number: int, count: int) -> tuple[str, str]:
        """The key and its value in one of n frames; the last has the last value, unless the animation is a loop."""
        is_loop = self.name == PHASE and self.values.ndim == 1 and (self.values[-1] - self.values[0]) % TURN == 0
        return self.at(number / (count if is_loop else max(1, count - 1)))


@dataclass(frozen=True)
class Mode:
    """A key of the scene that oscillates once: amplitude · sin(2 pi t), with t from 0 to 1.

    The frame after the last one would be the first one, so an animation that is repeated has no seam.
    """

    name: str
    amplitude: float

    def of_frame(self, number: int, count: int) -> tuple[str, str]:
        """The key and its value, as `with_settings` takes them, in one of n frames."""
        return self.name, json.dumps(self.amplitude * sine_of_turns(Fraction(number, count)))


Motion: TypeAlias = Key | Mode


def motion_of(name: str, text: str, option: str = "") -> Motion:
    """The motion of a key: ``A:B:...`` for values in turn, ``mode:S`` for an oscillation; SceneError for others.

    option  that the text was given with, for errors; by default --key
    """
    if not text.startswith(MODE):
        return Key.of(name, text, option)
    try:
        amplitude = float(text.removeprefix(MODE))
    except ValueError:
        amplitude = float("nan")
    if not isfinite(amplitude):
        raise SceneError(f"{option or f'--key {name}'}: expected a finite amplitude after {MODE}, found {text!r}")
    return Mode(name, amplitude)


def sine_of_turns(turns: Fraction) -> float:
    """sin(2 pi t), exact at quarters of a turn and with its symmetries to the last bit."""
    turns %= 1
    sign = -1.0 if turns >= Fraction(1, 2) else 1.0
    half = turns % Fraction(1, 2)
    # sin(pi - a) = sin(a) brings the angle to a quarter
    quarter = min(half, Fraction(1, 2) - half)
    return sign * sin(2.0 * pi * float(quarter)) if quarter else 0.0
