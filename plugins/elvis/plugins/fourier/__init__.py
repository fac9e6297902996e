"""Periodic boxes in Fourier bases as a runtime plugin."""

from __future__ import annotations

from elvis.plugins.fourier.box import FourierBox, write_box

__all__ = ["FourierBox", "write_box"]
