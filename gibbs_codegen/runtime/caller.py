"""The extension type that calls compiled functions for one state with little overhead.

It is built when the package is installed. Where it was not, `native/caller.c` is compiled once and
kept in the cache, as the libraries of modules are, if Python's headers are there.
"""

from __future__ import annotations

import functools
import importlib
import importlib.machinery
import importlib.util
import logging
import re
import sys
import sysconfig
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from gibbs_codegen.runtime.c_library import NATIVE, Compiler, CompilerError, native_source
from gibbs_codegen.runtime.cache import CacheError, cached_library

_log = logging.getLogger("gibbs_codegen")
_NAME = "gibbs_codegen.runtime._caller"


@functools.cache
def caller_type(compiler: Compiler) -> Callable[..., Any] | None:
    """The extension type `Caller`, which the compiler makes where there is none yet.

    Caller(shapes of inputs, shapes of outputs, default constants, general function) has a method
    `bind`, which takes the address of the compiled function. None where the type was not built, and
    Python's headers are not installed or it cannot be made, which the log says.
    """
    try:
        return importlib.import_module(_NAME).Caller
    except ImportError as error:
        _log.debug("the extension of the installed package is missing or unusable: %s", error)
    include = sysconfig.get_path("include")
    if not (Path(include) / "Python.h").is_file() or sys.implementation.name != "cpython":
        _log.info("calls for one state are slower: Python's headers are not installed")
        return None
    try:
        path = str(_library(compiler, include))
        loader = importlib.machinery.ExtensionFileLoader(_NAME, path)
        spec = importlib.util.spec_from_file_location(_NAME, path, loader=loader)
        if spec is None:
            return None
        made = importlib.util.module_from_spec(spec)
        loader.exec_module(made)
        return made.Caller
    except (CompilerError, CacheError, ImportError) as error:
        _log.info("calls for one state are slower: %s", error)
        return None


def _library(compiler: Compiler, include: str) -> Path:
    source = NATIVE / "caller.c"

    def make(output: Path) -> None:
        extra = [f"-I{include}", f"-I{np.get_include()}"]
        if sys.platform == "darwin":
            extra += ["-undefined", "dynamic_lookup"]
        compiler.library([source], output, extra)

    numpy_abi = re.match(r"\d+\.\d+", np.__version__)
    key = [
        compiler.identity,
        sys.version,
        include,
        numpy_abi[0] if numpy_abi else np.__version__,
        native_source("caller.c"),
    ]
    return cached_library("\n".join(key), make)
