"""Streamlines: lines along a velocity, integrated in the elements' own coordinates."""

from __future__ import annotations

from elvis.core.base.lazy import lazy_names

TYPE_CHECKING = False
if TYPE_CHECKING:
    from elvis.core.streamlines.streamlines import TracedLines, trace

__all__ = ["TracedLines", "trace"]

# drawing needs the words for the ends of lines, not the tracer
__getattr__ = lazy_names(__name__, {"elvis.core.streamlines.streamlines": tuple(__all__)})
