"""slangpy, which is only needed for drawing: ElVis installs and works without it."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

from elvis.renderer.device.errors import DeviceError

if TYPE_CHECKING:
    from types import ModuleType

#: the first version whose devices are opened as ours are
OLDEST = (0, 42)
#: where versions are to be had that are new enough
_PLATFORMS = "Linux with glibc 2.34 or later, macOS 15 or later on Apple silicon, Windows"
#: functions that work without it
_WITHOUT = "info, norms, probe and convert work without it, and --device reference draws, slowly"


def slangpy_module() -> Any:
    """The module slangpy; DeviceError with the requirements if it is missing, too old, or doesn't load."""
    module, reason = _slangpy()
    if module is None:
        raise DeviceError(reason)
    return module


@cache
def _slangpy() -> tuple[ModuleType | None, str]:
    """The module, or the reason why it can't be used."""
    needs = f"drawing needs slangpy {'.'.join(map(str, OLDEST))} or later"
    bring = f"pip install 'elvis-viz[draw]' installs it ({_PLATFORMS}); {_WITHOUT}"
    try:
        found = version("slangpy")
        if _numbers(found) < OLDEST:
            return None, f"{needs}, and {found} is installed; {bring}"
        import slangpy
    except (PackageNotFoundError, ModuleNotFoundError):
        return None, f"{needs}, which is not installed; {bring}"
    except (ImportError, OSError) as error:
        libraries = "on Linux it takes libX11 and libatomic (Debian and Ubuntu: libx11-6, libatomic1)"
        return None, f"drawing needs slangpy, which does not load: {error}; {libraries}; {_WITHOUT}"
    return slangpy, ""


def _numbers(text: str) -> tuple[int, ...]:
    """The leading numbers of a version."""
    return tuple(int("".join(filter(str.isdigit, part)) or 0) for part in text.split(".")[: len(OLDEST)])
