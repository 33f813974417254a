"""Cells of notebooks run in this process, to be looked at from inside."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable
from typing import Any


def run_cells(cells: Iterable[Any], wanted: set[str]) -> dict[str, tuple[Any, dict[str, Any]]]:
    """What cells show, and the names that are known after each of them.

    Args:
        cells: The cells of a notebook.
        wanted: Ids of the cells to look at; those after the last of them are not run.

    Returns:
        By id the value of a cell's last expression, and the namespace.
    """
    # Late, as the default run has no IPython.
    from IPython.core.interactiveshell import InteractiveShell
    from IPython.utils.capture import capture_output

    found: dict[str, tuple[Any, dict[str, Any]]] = {}
    shell, before = InteractiveShell.instance(), os.getcwd()
    shell.reset(new_session=True)
    with tempfile.TemporaryDirectory() as folder, capture_output():
        os.chdir(folder)
        try:
            for cell in cells:
                if cell.cell_type == "code" and set(found) < wanted:
                    lines = cell.source.splitlines()
                    # Magics say how a notebook shows its figures, which this does not.
                    source = "\n".join(line for line in lines if not line.startswith("%"))
                    result = shell.run_cell(source, store_history=False)
                    result.raise_error()
                    if cell.id in wanted:
                        found[cell.id] = result.result, dict(shell.user_ns)
        finally:
            os.chdir(before)
    return found
