"""Streamlines: lines along a velocity, integrated in the elements' own coordinates."""

from __future__ import annotations

from elvis.core.lazy import lazy_names

TYPE_CHECKING = False
if TYPE_CHECKING:
    from elvis.core.streamlines.streamlines import TracedLines, trace

__all__ = ["TracedLines", "trace"]

# what draws needs the words for the ends of lines, not what follows them
__getattr__ = lazy_names(__name__, {"elvis.core.streamlines.streamlines": tuple(__all__)})
