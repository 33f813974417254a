"""The source that stands in every C module, compiled by itself as `tests/emitted/alone.c`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from conftest import ROOT

from support.compiled import compile_only
from support.tools import compiled, tool


def alone(compiler: str, options: Sequence[str], real: type[np.floating], folder: Path) -> Path:
    """A shared library in a new folder."""
    folder.mkdir()
    precision = ["-DSINGLE"] if real is np.float32 else []
    sources = f"-I{ROOT / 'gibbs_codegen' / 'emitted'}"
    source = str(ROOT / "tests" / "emitted" / "alone.c")
    objects = compile_only(compiler, ["-fPIC", *options, *precision, sources], [source], folder)
    # Linked without the options: those of fast mathematics would have the library turn denormals
    # off for this whole process.
    library = folder / "library.so"
    return compiled([tool(compiler), "-shared", *objects, "-lm"], library)
