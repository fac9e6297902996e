"""Copies of the data next to the data: mirrored, repeated and turned."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated, Literal

from elvis.scene.model.errors import SceneError
from elvis.scene.model.settings import Model, Setting, check
from elvis.scene.model.surfaces import Plane, Vector, unit

if TYPE_CHECKING:
    from elvis.core.deformed.isometries import Isometry

#: copies of one scene, the data included
MOST_COPIES = 1024


@dataclass(frozen=True, repr=False)
class Repeat(Model, of="a repetition"):
    """Copies in a row."""

    step: Annotated[
        Vector | Literal["x", "y", "z"],
        Setting(
            "Translation from one copy to the next; x, y or z is the period that the data declare in this direction."
        ),
    ]
    count: Annotated[int, Setting("Number of copies, the data included.", ge=2, le=MOST_COPIES)]

    def check(self) -> None:
        """Raise SceneError for a translation by zero, and for unknown directions."""
        if isinstance(self.step, str):
            check(self.step in ("x", "y", "z"), "step of a repetition", "a vector, x, y or z", repr(self.step))
        else:
            unit(self.step, "the step of a repetition")


@dataclass(frozen=True, repr=False)
class Turn(Model, of="a turn"):
    """Copies around an axis, evenly spaced over a full circle."""

    axis: Annotated[Vector, Setting("Direction of the axis, of any length.")]
    count: Annotated[int, Setting("Number of copies, the data included.", ge=2, le=MOST_COPIES)]
    point: Annotated[Vector, Setting("Point of the axis.")] = (0.0, 0.0, 0.0)

    def check(self) -> None:
        """Raise SceneError if the axis is zero."""
        unit(self.axis, "the axis of a turn")


@dataclass(frozen=True, repr=False)
class Copies(Model, of="the copies"):
    """Copies of the data: first they are mirrored, then the result is turned, then repeated."""

    mirror: Annotated[
        tuple[Plane, ...],
        Setting(
            "Planes at which the data are mirrored, one after another: two planes give four copies.",
            option="--mirror",
            metavar="x=V|POINT:NORMAL",
            parse="plane",
            option_help="Also draw the mirror image at a plane; vectors and derived quantities have the right signs.",
            repeatable=True,
        ),
    ] = ()
    turn: Annotated[
        tuple[Turn, ...],
        Setting(
            "Turns about axes.",
            option="--turn",
            metavar="[POINT:]AXIS:COUNT",
            parse="turn",
            option_help="Draw COUNT copies around an axis (x, y, z or a direction), evenly spaced over a full circle.",
            repeatable=True,
        ),
    ] = ()
    repeat: Annotated[
        tuple[Repeat, ...],
        Setting(
            "Repetitions along vectors.",
            option="--repeat",
            metavar="VECTOR:COUNT",
            parse="repeat",
            option_help="Draw COUNT copies in a row, each translated by a vector, such as 1,0,0:4; x, y or z is the "
            "period that the data declare.",
            repeatable=True,
        ),
    ] = ()

    def check(self) -> None:
        """Raise SceneError without any copy, and for too many copies."""
        check(self.mirror or self.turn or self.repeat, "the copies", "mirror, turn or repeat", "none of these")
        check(self.count <= MOST_COPIES, "the copies", f"at most {MOST_COPIES}", self.count)

    @property
    def count(self) -> int:
        """Number of copies, the data included."""
        total: int = 2 ** len(self.mirror)
        for count in (each.count for group in (self.turn, self.repeat) for each in group):
            total *= count
        return total

    def with_periods(self, periods: Mapping[str, float]) -> "Copies":
        """The copies with the periods of the data instead of the names of directions.

        Raises SceneError for a direction in which the data declare no period.
        """
        return replace(self, repeat=tuple(_with_period(each, periods) for each in self.repeat))

    def isometries(self) -> "tuple[Isometry, ...]":
        """The isometry of each copy; the first one is the identity."""
        from elvis.core.deformed.isometries import Isometry

        found = [Isometry()]
        for plane in self.mirror:
            image = Isometry.mirror(plane.point, plane.normal)
            found += [image.after(each) for each in found]
        for turn in self.turn:
            steps = [Isometry.turn(turn.point, turn.axis, 360.0 * k / turn.count) for k in range(turn.count)]
            found = [step.after(each) for step in steps for each in found]
        for repeat in self.repeat:
            assert not isinstance(repeat.step, str)
            steps = [Isometry.translation([k * part for part in repeat.step]) for k in range(repeat.count)]
            found = [step.after(each) for step in steps for each in found]
        return tuple(found)


def _with_period(repeat: Repeat, periods: Mapping[str, float]) -> Repeat:
    """A repetition by a vector."""
    if not isinstance(repeat.step, str):
        return repeat
    if repeat.step not in periods:
        declared = " and ".join(f"{name} ({length:g})" for name, length in periods.items())
        told = f"only along {declared}" if declared else "in no direction"
        raise SceneError(f"repeat: the data declare a period {told}: expected a vector instead of {repeat.step}")
    x, y, z = (periods[repeat.step] if name == repeat.step else 0.0 for name in "xyz")
    return replace(repeat, step=(x, y, z))
