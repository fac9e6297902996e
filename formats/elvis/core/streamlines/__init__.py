"""Streamlines: lines along a velocity, integrated in the elements' own coordinates."""

from elvis.core.streamlines.streamlines import Streamlines, trace

__all__ = ["Streamlines", "trace"]
