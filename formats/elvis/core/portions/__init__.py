"""Datasets in parts: some of their elements with their numbers in the whole, and the processes that hold such parts."""

from __future__ import annotations

from elvis.core.portions.partition import along_curve
from elvis.core.portions.portion import Portion, portions, unite

__all__ = ["Portion", "along_curve", "portions", "unite"]
