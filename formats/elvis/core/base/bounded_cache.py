"""A cache of results that is bounded by their bytes, one for all functions of a process.

Tables of polynomials depend on few numbers, but a table of degree 20 takes as much memory as ten thousand of degree 3;
caches that count entries therefore grow to gigabytes.  This one counts bytes: the results that were not used for
longest go.
"""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable, Hashable
from dataclasses import fields, is_dataclass
from functools import wraps
from threading import Lock
from typing import Any, ParamSpec, TypeVar

import numpy as np

P = ParamSpec("P")
R = TypeVar("R")

#: total bytes of cached results; the newest result stays even if it exceeds this
MAX_BYTES = 128 << 20
#: memory of a result in addition to its arrays: the key and wrapper objects
_OVERHEAD = 512

_Key = tuple[Callable[..., Any], tuple[Hashable, ...]]
_results: OrderedDict[_Key, tuple[Any, int]] = OrderedDict()
_lock = Lock()
_total = 0


def bounded_cache(function: Callable[P, R]) -> Callable[P, R]:
    """Keep the results of a function of hashable arguments, within `MAX_BYTES` of all such functions.

    Results must not be changed by those who get them.

    Examples
    --------
    >>> @bounded_cache
    ... def table(degree):
    ...     return np.eye(degree + 1)
    >>> table(3) is table(3)
    True
    """

    @wraps(function)
    def cached(*args: P.args, **kwargs: P.kwargs) -> R:
        key = (function, (*args, *kwargs.items()))
        with _lock:
            if key in _results:
                _results.move_to_end(key)
                result: R = _results[key][0]
                return result
        # outside of the lock: functions call one another, and threads may compute the same at worst twice
        result = function(*args, **kwargs)
        _keep(key, result)
        return result

    return cached


def cached_bytes() -> dict[str, int]:
    """Cached bytes by names of functions, the largest first."""
    found: Counter[str] = Counter()
    with _lock:
        for (function, _), (_, size) in _results.items():
            found[f"{function.__module__}.{function.__qualname__}"] += size
    return dict(found.most_common())


def clear() -> None:
    """Forget all results."""
    global _total
    with _lock:
        _results.clear()
        _total = 0


def _keep(key: _Key, result: Any) -> None:
    """Add a result, then drop the least recently used ones until the total is within the limit."""
    global _total
    size = _OVERHEAD + array_bytes(result)
    with _lock:
        if key in _results:
            return
        _results[key] = result, size
        _total += size
        while _total > MAX_BYTES and len(_results) > 1:
            _, (_, freed) = _results.popitem(last=False)
            _total -= freed


def array_bytes(value: Any) -> int:
    """Bytes of the arrays in a value: an array, a tuple, list or mapping of values, or a dataclass."""
    if isinstance(value, np.ndarray):
        base = value.base
        return int(base.nbytes if isinstance(base, np.ndarray) else value.nbytes)
    if isinstance(value, (tuple, list)):
        return sum(map(array_bytes, value))
    if isinstance(value, dict):
        return sum(map(array_bytes, value.values()))
    if is_dataclass(value) and not isinstance(value, type):
        return sum(array_bytes(getattr(value, field.name)) for field in fields(value))
    return 0
