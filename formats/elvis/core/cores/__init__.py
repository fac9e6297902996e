"""Vortex cores: lines along which a velocity is parallel to its acceleration or vorticity, all of them."""

from elvis.core.cores.vortex_cores import VortexCores, vortex_cores

__all__ = ["VortexCores", "vortex_cores"]
