"""The interface for plugin authors: the protocols, and the discovery of plugins by entry points.

``registry`` finds plugins of any distribution; ``command`` is the ``elvis`` command, built from the commands it finds.
"""

from __future__ import annotations

from elvis.core.base.lazy import lazy_names

TYPE_CHECKING = False
if TYPE_CHECKING:
    from elvis.plugins.data.data import read

__all__ = ["read"]

__getattr__ = lazy_names(__name__, {"elvis.plugins.data.data": ("read",)})
