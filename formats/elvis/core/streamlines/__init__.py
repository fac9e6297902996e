"""Streamlines: lines along a velocity, integrated in the elements' own coordinates."""

from elvis.core.streamlines.streamlines import TracedLines, trace

__all__ = ["TracedLines", "trace"]
