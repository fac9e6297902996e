"""NURBS volumes as a runtime plugin: rational elements, exactly."""

from __future__ import annotations

from elvis.plugins.nurbs.nurbs import Nurbs

__all__ = ["Nurbs"]
