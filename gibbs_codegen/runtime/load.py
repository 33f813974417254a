"""Loading a generated module by name or path, without putting its folder on the import path.

The back end is a choice of the caller's: the functions and constants are the same. What compiles is
imported when first used, since it needs NumPy, which the command line mostly does not.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.util
import logging
import os
import shlex
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

from gibbs_codegen.errors import UsageError, cause_of, near, printable, require
from gibbs_codegen.files.module_writer import generated_files, kept_options
from gibbs_codegen.files.shipped import shipped_names
from gibbs_codegen.interface import DATA
from gibbs_codegen.runtime.cache import CacheError, cached_module
from gibbs_codegen.runtime.loaded_module import LoadedModule

BACKENDS = ("numpy", "c")
# Back ends whose functions belong to another library, which the extra of that name installs.
LIBRARIES = ("casadi", "jax", "torch")
METHODS = ("euler", "rk4")
# The folder of the package, and endings of the files in it that a generated module depends on.
_BESIDE = Path(__file__).parents[2]
_SOURCES = {".c", ".jinja", ".m", ".py", ".toml"}

_log = logging.getLogger("gibbs_codegen")
_importing = threading.Lock()
# Texts of robot files, and of those of modules, that a warning named.
_WARNED: set[tuple[bytes, ...]] = set()


def load(
    name_or_path: str | os.PathLike[str], backend: str = "numpy", threads: int = 1
) -> ModuleType:
    """Load a generated module.

    Args:
        name_or_path: The module's folder, or a name, which is looked for in `generated/` of the
            working directory. A missing module of a robot that ships is generated once into the
            cache; the log `gibbs_codegen` says so.
        backend: "numpy"; "c", which compiles the module's C source once, with CC or the
            machine's compiler, and keeps it in a cache; "casadi", "jax" or "torch", whose functions
            are those of that library. That of "torch" calls the compiled ones.
        threads: How many threads of the C back end share large batches.

    Returns:
        An object with the module's functions and constants. With the C back end `__file__` is the
        shared library; where that cannot be compiled or kept, NumPy serves, and the log
        `gibbs_codegen` says so in a line.

    Raises:
        UsageError: There is no such module, C source or back end, or its library is not installed.
    """
    if backend not in (backends := (*BACKENDS, *LIBRARIES)):
        raise UsageError(f"back end {backend!r}: unknown; known: {', '.join(backends)}")
    if not isinstance(threads, int) or threads < 1:
        raise UsageError(f"threads: a whole number, at least 1, not {threads!r}")
    folder = find_module(Path(name_or_path))
    with _importing:
        module = _import(folder)
    loaded = module
    if backend in LIBRARIES:
        require(backend, f"back end {backend!r}")
    if backend == "casadi":
        from gibbs_codegen.runtime.casadi_backend import CasadiModule

        loaded = CasadiModule(module)
    elif backend == "jax":
        from gibbs_codegen.runtime.jax_backend import jax_module

        loaded = jax_module(module, folder)
    elif backend in ("c", "torch"):
        from gibbs_codegen.runtime.c_backend import c_module
        from gibbs_codegen.runtime.c_library import CompilerError, chosen_compiler

        try:
            loaded = c_module(module, folder, chosen_compiler(), threads)
        except (CompilerError, CacheError) as error:
            if backend == "torch":
                raise UsageError(
                    f"back end 'torch': {module.NAME} is not compiled: {printable(error, 400)}"
                ) from None
            words = "%s: runs in NumPy instead of C: %s; flights take many times as long"
            _log.warning(words, module.NAME, printable(error, 400))
    if backend == "torch":
        from gibbs_codegen.runtime.torch_backend import torch_module

        loaded = torch_module(loaded)
    if not isinstance(loaded, LoadedModule):
        loaded.__class__ = LoadedModule
    for ending in ("", "_derivatives"):
        if any(f"step_{method}{ending}" in loaded.DERIVATIVES for method in METHODS):
            setattr(loaded, f"step{ending}", _time_step(loaded, ending))
    return loaded


def _time_step(module: ModuleType, ending: str) -> Callable[..., object]:
    """A function that takes a time step by the method that is named.

    Names of the module's steps end with `ending` after the method.
    """

    def step(
        q: object, v: object, u: object, h: object, method: str = "euler", constants: object = None
    ) -> object:
        if method not in METHODS:
            methods = ", ".join(METHODS)
            raise UsageError(f"method {printable(method)}: unknown; known: {methods}")
        return getattr(module, f"step_{method}{ending}")(q, v, u, h, constants)

    step.__name__ = step.__qualname__ = f"step{ending}"
    step.__module__ = module.__name__
    step.__doc__ = (
        f'step_euler{ending}, or step_rk4{ending} with method="rk4".\n\n'
        f"Arguments and results are those of step_euler{ending} and step_rk4{ending}."
    )
    return step


def _import(folder: Path) -> ModuleType:
    digest = hashlib.sha256(os.fsencode(folder)).hexdigest()[:16]
    module_name = f"_gibbs_codegen_{digest}_{folder.name}"
    for name in (module_name, f"{module_name}.numpy_module"):
        sys.modules.pop(name, None)
    spec = importlib.util.spec_from_file_location(
        module_name, folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    if spec is None or spec.loader is None:
        raise UsageError(f"{printable(folder)}: cannot be imported")
    module = importlib.util.module_from_spec(spec)
    sys.modules[module_name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # Whatever stands in a file that was damaged.
        del sys.modules[module_name]
        raise UsageError(
            f"{printable(folder)}: cannot be imported, generate it again: {printable(error)}"
        ) from None
    except BaseException:
        del sys.modules[module_name]
        raise
    missing = [name for name in DATA if not hasattr(module, name)]
    if missing:
        raise UsageError(
            f"{printable(folder)}: has no {', '.join(missing)}, "
            "so it was made by an older version; generate it again"
        )
    # The name for help() and repr(); it is imported under a name that no other folder's module has.
    module.__name__ = spec.name = module.NAME
    module.__doc__ = module.numpy_module.__doc__
    return module


def find_module(path: Path) -> Path:
    """Absolute path of the folder of a generated module, given by that or by its name.

    Where there is none, the module of a robot that ships is generated. Raises `UsageError` if it
    cannot be, or there is no such robot.
    """
    folders = (path, Path("generated") / path)
    try:
        for folder in folders:
            if not _lacking(folder):
                _warn_of_changes(folder)
                return folder.resolve()
        partial = [f for f in folders if generated_files(f)]
    except OSError as error:
        raise UsageError(f"{printable(path)}: cannot be read: {cause_of(error)}") from None
    if partial:
        folder, options = partial[0], kept_options(partial[0]).split()
        options += ["--target", "numpy"] if "--target" in options and "numpy" not in options else []
        words = f"lacks {_lacking(folder)}, which loading needs; make it with: gibbs-codegen"
        command = shlex.join(["generate", str(folder), "--out", str(folder.parent), *options])
        raise UsageError(f"{printable(folder)}: {words} {printable(command, 400)}")
    if path.suffix == ".toml":
        raise UsageError(
            f"{printable(path)}: this is a robot file, not a module; run gibbs-codegen generate, "
            "and load the folder that it writes, or the robot's name"
        )
    # A folder of a robot's name is what is left of its module, or something else.
    shipped = () if any(folder.is_dir() for folder in folders) else shipped_names("robots")
    if str(path) in shipped:
        return _module_that_ships(str(path))
    # A folder has the name of no robot.
    robot = "ROBOT.toml" if path.is_dir() or not path.name else printable(path.name)
    hint = near(path.name, [*modules_made(), *shipped])
    remedy = hint or f"; make one with: gibbs-codegen generate {robot}"
    raise UsageError(f"{printable(path)}: no generated module there or in generated/{remedy}")


def _lacking(folder: Path) -> str:
    """Names of files that loading a module needs and that are not in its folder."""
    return ", ".join(x for x in ("__init__.py", "numpy_module.py") if not (folder / x).is_file())


def _warn_of_changes(folder: Path) -> None:
    """Warn, once, if NAME.toml is another text than that of which generated/NAME was made."""
    files = Path(f"{folder.name}.toml"), folder / "robot.toml"
    if folder.parent == Path("generated") and all(map(os.path.isfile, files)):
        texts = tuple(file.read_bytes() for file in files)
        if texts[0] != texts[1] and texts not in _WARNED:
            _WARNED.add(texts)
            words = "%s differs from the file that %s was made of: run `gibbs-codegen generate %s`"
            _log.warning(words, *map(printable, (files[0], folder, files[0])))


def robot_file(word: str) -> str:
    """Path of the robot file in a module of a path, or of a name in `generated/`, or NAME.toml."""
    for folder in (Path(word), Path("generated", word)):
        if not os.path.isfile(word) and os.path.isfile(folder / "robot.toml"):
            _warn_of_changes(folder)
            return str(folder / "robot.toml")
    return file if not os.path.exists(word) and os.path.isfile(file := f"{word}.toml") else word


def _module_that_ships(name: str) -> Path:
    """Folder of the module of a robot that ships, which this generator made into the cache.

    It is generated in a process of its own, so that what flies imports no SymPy.
    """

    def make(new: Path) -> None:
        _log.warning("%s: no generated module here; generating one into the cache", name)
        command = [sys.executable, "-m", "gibbs_codegen", "generate", name, "--out", str(new)]
        # The folder of this package comes first where Python looks for one.
        done = subprocess.run(  # noqa: S603 - this program
            command, cwd=_BESIDE, capture_output=True, stdin=subprocess.DEVNULL, check=False
        )
        if done.returncode:
            raise CacheError(printable(done.stderr.decode(errors="replace").strip(), 400))

    try:
        return cached_module(f"{name}\n{_generator_digest()}", name, make)
    except (CacheError, OSError) as error:
        raise UsageError(
            f"{name}: cannot be generated into the cache: {error}; "
            f"make it here with: gibbs-codegen generate {name}"
        ) from None


@functools.cache
def _generator_digest() -> str:
    """Digest of all that a generated module depends on, robots that ship among it."""
    # In a checkout templates are beside the package.
    parts = [p for f in ("gibbs_codegen", "templates") for p in (_BESIDE / f).rglob("*.*")]
    digest = hashlib.sha256()
    for path in sorted(path for path in parts if path.suffix in _SOURCES):
        digest.update(hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def modules_made() -> list[str]:
    """Names of the modules in `generated/`, the default folder of modules."""
    return sorted(path.parent.name for path in Path("generated").glob("*/robot.toml"))
