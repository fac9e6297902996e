"""Worker for ADIOS2's library in a separate process: the arrays of a step of VTX files, block by block."""

from __future__ import annotations

import re
import signal
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from elvis.core.base.errors import FormatError
from elvis.core.data.moments import checked_step

#: colours of a terminal, and the head of the library's complaints
_MARKS = re.compile(r"\x1b\[[\d;]*m|\[[^\]]*\d{4}\]|\[ADIOS2 EXCEPTION\]")

#: seconds after which the process ends, and bytes for which it has one more: of damaged files the library may wait
#: for what never comes
_PATIENCE = 20
_BYTES_PER_SECOND = 1 << 22

#: variables with one number a step: the time, and the type of all cells
_TIME, _TYPE = "step", "types"

#: the attribute that names arrays at points and on cells
_SCHEMA = "vtk.xml"

#: arrays of the format itself
_OWN = ("geometry", "connectivity", "vtkOriginalPointIds")


class Library:
    """The library, which reads files."""

    def __init__(self) -> None:
        import adios2

        self._library = adios2

    def times(self, path: str) -> list[float]:
        """The times of the steps of a file; raises FormatError if it is damaged."""
        with self._opened(path) as file:
            return _times(file)

    def arrays(self, path: str, step: int, most: int) -> dict[str, Any]:
        """The time, the type of cells and the schema of a step, and its arrays by name, a list of blocks each.

        most  bytes that an array may take
        Raises FormatError if the file is damaged.
        """
        with self._opened(path) as file:
            times = _times(file)
            number = checked_step(step, len(times), path)
            known = file.available_variables()
            names = [name for name in known if name not in (_TIME, _TYPE) and "Type" in known[name]]
            wanted = [name for name in names if name in _OWN or known[name]["Type"] in ("double", "float")]
            missing = [name for name in ("geometry", "connectivity", _TYPE) if name not in known]
            if missing:
                raise FormatError(f"expected an array {missing[0]}, found none", file=path)
            _check_stored(file, wanted, path)
            arrays = {name: _blocks(file, name, number, len(times), most) for name in wanted}
            kind = int(np.ravel(_single(file, _TYPE, number, len(times)))[0])
            attributes = file.available_attributes()
            schema = str(attributes[_SCHEMA].get("Value", "")) if _SCHEMA in attributes else ""
            return {"time": times[number], "type": kind, "schema": schema, "arrays": arrays}

    @contextmanager
    def _opened(self, path: str) -> Iterator[Any]:
        """A file; raises FormatError with the library's complaint."""
        size = sum(each.stat().st_size for each in Path(path).iterdir())
        signal.setitimer(signal.ITIMER_REAL, _PATIENCE + size / _BYTES_PER_SECOND)
        try:
            with self._library.FileReader(path) as file:
                yield file
        except FormatError:
            raise
        except Exception as error:
            words = " ".join(_MARKS.sub("", str(error)).split()) or type(error).__name__
            raise FormatError(f"expected a complete ADIOS2 file, found: {words[:200]}", file=path) from error
        finally:
            signal.setitimer(signal.ITIMER_REAL, 0)


def _check_stored(file: Any, names: Sequence[str], path: str) -> None:
    """Raise FormatError if arrays claim more bytes than the files of data hold: the library would wait for the rest.

    Packed arrays may claim more than they take.
    """
    variables = [file.inquire_variable(name) for name in names]
    if any(variable.operations() for variable in variables):
        return
    claimed = 0
    for variable in variables:
        for step in range(variable.steps()):
            blocks = file.engine.blocks_info(variable.name(), step)
            claimed += sum(prod(_shape(block)) for block in blocks) * variable.sizeof()
    stored = sum(each.stat().st_size for each in Path(path).glob("data.*"))
    if claimed > stored:
        raise FormatError(f"expected {claimed} bytes of data, found {stored}", file=path)


def _shape(block: dict[str, str]) -> list[int]:
    """Numbers of rows and columns of a block."""
    return [int(count) for count in block["Count"].split(",") if count]


def _times(file: Any) -> list[float]:
    """The times of the steps, or numbers of steps where the file has none."""
    if _TIME not in file.available_variables():
        return [float(number) for number in range(file.num_steps())]
    count = file.inquire_variable(_TIME).steps()
    return [float(time) for time in np.ravel(file.read(_TIME, step_selection=[0, count]))]


def _relative(variable: Any, step: int, steps: int) -> int:
    """The step of a variable: its only one where it is written once, as a mesh may be.

    Raises FormatError for others.
    """
    count = variable.steps()
    if count not in (1, steps):
        raise FormatError(f"expected {variable.name()} once or in all {steps} steps, found it in {count}")
    return step if count == steps else 0


def _single(file: Any, name: str, step: int, steps: int) -> NDArray[Any]:
    """A variable of one number a step."""
    own = _relative(file.inquire_variable(name), step, steps)
    return np.asarray(file.read(name, step_selection=[own, 1]))


def _blocks(file: Any, name: str, step: int, steps: int, most: int) -> list[NDArray[Any]]:
    """The blocks of a variable, one of each process that wrote."""
    variable = file.inquire_variable(name)
    own = _relative(variable, step, steps)
    found = []
    for number, block in enumerate(file.engine.blocks_info(name, own)):
        shape = _shape(block)
        size = prod(shape) * variable.sizeof()
        if not 1 <= len(shape) <= 2 or size > most:
            raise FormatError(f"expected rows of at most {most} bytes, found {size} of {name}")
        if not size:
            found.append(np.zeros(shape))
            continue
        variable.set_block_selection(number)
        variable.set_step_selection([own, 1])
        found.append(np.asarray(file.read(variable)).reshape(shape))
    return found
