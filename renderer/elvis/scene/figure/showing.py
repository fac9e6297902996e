"""Pictures on the screen: in the notebook that runs this process, else in the system's viewer."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from elvis.scene.record.frame import Frame


def show(frame: Frame) -> None:
    """Show a frame where its user looks."""
    if is_notebook():
        from IPython.display import display

        display(frame)
        return
    from elvis.scene.figure.picture import picture

    picture(frame).show(title=frame.scene.field)


def is_notebook() -> bool:
    """Whether a kernel of Jupyter runs this process; nothing is imported to find that out."""
    ipython = sys.modules.get("IPython")
    shell = ipython.get_ipython() if ipython else None
    return shell is not None and "IPKernelApp" in shell.config
