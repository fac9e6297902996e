"""Line integral convolution, as part of how a surface looks."""

from dataclasses import dataclass
from typing import Annotated

from elvis.core.data.arguments import texts_of
from elvis.scene.model.settings import Components, Model, Setting


@dataclass(frozen=True, repr=False)
class Lic(Model, of="line integral convolution"):
    """Streaks along a velocity on a surface: image noise, averaged along lines of the tangential velocity."""

    velocity: Components = None
    length: Annotated[
        float,
        Setting("Length of the lines along which noise is averaged.", gt=0, le=1000, unit="pixels"),
    ] = 40.0
    width: Annotated[float, Setting("Width of the streaks.", ge=1, le=100, unit="pixels")] = 2.0
    contrast: Annotated[
        float, Setting("Contrast of the streaks: 0 leaves colours unchanged, 1 reaches black and white.", ge=0, le=1)
    ] = 0.5

    @property
    def components(self) -> tuple[str, ...]:
        """The texts of the components; empty while the velocity is not chosen."""
        return tuple(texts_of(self.velocity) or ())
