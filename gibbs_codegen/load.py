"""Loading a generated module by name or path, without putting its folder on the import path."""

from __future__ import annotations

import hashlib
import importlib.util
import os
import sys
from pathlib import Path
from types import ModuleType

from gibbs_codegen.errors import UsageError

BACKENDS = ("numpy",)


def load(name_or_path: str | os.PathLike[str], backend: str = "numpy") -> ModuleType:
    """Load a generated module: an object with its functions and constants.

    `name_or_path` is the folder of the module, or a name, which is looked for in `generated/` of
    the working directory. Raises `UsageError` where there is no such module or back end.
    """
    if backend not in BACKENDS:
        raise UsageError(f"back end {backend!r}: unknown; known: {', '.join(BACKENDS)}")
    folder = _find(Path(name_or_path))
    digest = hashlib.sha256(str(folder).encode()).hexdigest()[:16]
    module_name = f"_gibbs_codegen_{digest}_{folder.name}"
    if module_name in sys.modules:
        del sys.modules[module_name]
        sys.modules.pop(f"{module_name}.numpy_module", None)
    spec = importlib.util.spec_from_file_location(
        module_name, folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    if spec is None or spec.loader is None:
        raise UsageError(f"{folder}: cannot be imported")
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module
    try:
        spec.loader.exec_module(module)
    except BaseException:
        del sys.modules[module_name]
        raise
    return module


def _find(path: Path) -> Path:
    for folder in (path, Path("generated") / path):
        if all((folder / name).is_file() for name in ("__init__.py", "numpy_module.py")):
            return folder.resolve()
    raise UsageError(
        f"{path}: no generated module there, nor in generated/; "
        f"make it with: gibbs-codegen generate {path.name}"
    )
