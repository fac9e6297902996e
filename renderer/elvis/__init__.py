"""Exact pictures and numbers of high-order finite element solutions.

>>> import elvis
>>> ds = elvis.read("wing.xml", "wing.fld")  # doctest: +SKIP
>>> elvis.render(ds, "speed", plane=((0, 0, 0.2), (0, 0, 1))).save("speed.png")  # doctest: +SKIP

The package has five roots in a checkout, one for each area, and one folder where it is installed.
"""

from __future__ import annotations

from pkgutil import extend_path
from typing import TYPE_CHECKING

__path__ = extend_path(__path__, __name__)

from elvis import api
from elvis.core.lazy import lazy_names

if TYPE_CHECKING:
    from elvis.api import *  # noqa: F403

__all__ = [*api.__all__]

__getattr__ = lazy_names(__name__, api.NAMES)


def __dir__() -> list[str]:
    return __all__
