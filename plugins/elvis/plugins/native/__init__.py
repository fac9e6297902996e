"""The native format as a runtime plugin: polynomial elements of every 2D and 3D shape."""

from __future__ import annotations

from elvis.plugins.native.buffers import NativeVolume

__all__ = ["NativeVolume"]
