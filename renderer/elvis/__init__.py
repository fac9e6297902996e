"""Exact pictures and numbers of high-order finite element solutions.

>>> import elvis
>>> ds = elvis.read("wing.xml", "wing.fld")  # doctest: +SKIP
>>> elvis.render(ds, "speed", plane=((0, 0, 0.2), (0, 0, 1))).save("speed.png")  # doctest: +SKIP

The package has five roots in a checkout, one for each area, and one folder where it is installed.
"""

from __future__ import annotations

import os
import sys

# each command waits for this module: pkgutil.extend_path and typing would cost it most of its time
__path__ = list(dict.fromkeys([*__path__, *filter(os.path.isdir, (os.path.join(path, "elvis") for path in sys.path))]))

from elvis import api
from elvis.core.base.lazy import lazy_names

TYPE_CHECKING = False
if TYPE_CHECKING:
    from elvis.api import *  # noqa: F403

__all__ = [*api.__all__]

__getattr__ = lazy_names(__name__, api.NAMES)


def __dir__() -> list[str]:
    return __all__
