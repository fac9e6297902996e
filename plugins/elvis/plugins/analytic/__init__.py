"""Fields in closed form over native meshes, as a runtime plugin."""

from __future__ import annotations

from elvis.plugins.analytic.expression import Expression
from elvis.plugins.analytic.volume import AnalyticVolume

__all__ = ["AnalyticVolume", "Expression"]
