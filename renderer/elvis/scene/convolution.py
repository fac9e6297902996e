"""Line integral convolution, as part of how a surface looks."""

from dataclasses import dataclass
from typing import Annotated

from elvis.core.arguments import texts_of
from elvis.scene.settings import Components, Model, Setting


@dataclass(frozen=True, repr=False)
class Lic(Model, of="line integral convolution"):
    """Streaks along a velocity on a surface: noise of the picture, averaged along lines of its part in the surface."""

    velocity: Components = None
    length: Annotated[
        float,
        Setting("Length in pixels of the lines that noise is averaged along.", gt=0, le=1000, unit="pixels"),
    ] = 40.0
    width: Annotated[float, Setting("Width of streaks in pixels.", ge=1, le=100, unit="pixels")] = 2.0
    contrast: Annotated[
        float, Setting("How far colours go to black and white: 0 leaves them as they are.", ge=0, le=1)
    ] = 0.5

    @property
    def components(self) -> tuple[str, ...]:
        """The texts of the components; none where the velocity is still to be guessed."""
        return tuple(texts_of(self.velocity) or ())
