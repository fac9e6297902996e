"""Packages whose names are imported from their modules when they are first used, so that commands start quickly."""

from __future__ import annotations

from importlib import import_module

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable, Mapping
    from typing import Any


def lazy_names(package: str, modules: Mapping[str, tuple[str, ...]]) -> Callable[[str], object]:
    """The ``__getattr__`` of a package that offers names of modules.

    modules  full name of a module -> the names that come from it
    """
    homes = {name: module for module, names in modules.items() for name in names}

    def attribute(name: str) -> object:
        if name not in homes:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return getattr(import_module(homes[name]), name)

    return attribute


def public(name: str) -> Any:
    """A function of ``import elvis``, for methods of data that are short for it, such as ``ds.save("a.vtu")``.

    It is the only way from a class of the core to a slice above.
    """
    return getattr(import_module("elvis"), name)


def names_of_elvis(package: str) -> Callable[[str], object]:
    """The ``__getattr__`` of a package that finds all names of ``import elvis``, for scripts older than that."""

    def attribute(name: str) -> object:
        if name.startswith("__"):
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        return public(name)

    return attribute
