"""A digest of values and functions that is the same in every process.

cloudpickle takes them to pieces, but for four kinds: functions go without the place of their
source, classes without the random number that cloudpickle gives them, sets in an order that is the
same in every process, and of modules of the user's what is used of them. What installed packages
and the standard library define counts by name and version.
"""

from __future__ import annotations

import hashlib
import io
import sys
import sysconfig
import threading
import weakref
from collections.abc import Iterator
from dis import get_instructions
from functools import partial
from importlib import import_module
from pathlib import Path
from types import CellType, CodeType, FunctionType, ModuleType
from typing import Any

import cloudpickle

from gibbs_codegen.errors import GibbsCodegenError, UsageError, printable

_PROTOCOL = 4  # Later ones tell arrays that may be written from others.
# Byte code that takes a global.
_LOOK_UP = ("LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS")
# The folder of Python's own modules.
_STANDARD = sysconfig.get_path("stdlib")
# The flag of types that are not of Python itself, some of which have no place by their name.
_MADE_BY_CLASS = 1 << 9
# Types that have no effect on numbers.
_LOCKS = (type(threading.Lock()), type(threading.RLock()))
# Attributes that Python adds to a class, without effect on its work.
_OF_PYTHON = {
    *("__module__", "__doc__", "__dict__", "__weakref__", "__firstlineno__"),
    *("__static_attributes__", "__annotations__", "__annotations_cache__", "__annotate_func__"),
    *("__abstractmethods__", "_abc_impl"),
}


def fingerprint(*values: Any) -> str:
    """The SHA-256 of values, in hexadecimal digits."""
    written = io.BytesIO()
    try:
        _ValueWriter(written).dump(values)
    except GibbsCodegenError:
        raise
    except Exception as error:  # Whatever pickling meets.
        why = "it holds itself" if "cyclic" in str(error) else printable(error)
        raise UsageError(
            f"{printable(repr(values), 60)}: a later call of the sweep cannot recognise this "
            f"value ({why}); use numbers, arrays and functions in measures"
        ) from None
    return hashlib.sha256(written.getbuffer()).hexdigest()


class _ValueWriter(cloudpickle.Pickler):  # type: ignore[misc]  # It has no types.
    """Writes what values are."""

    def __init__(self, file: io.BytesIO) -> None:
        super().__init__(file, _PROTOCOL)
        # Constants that are equal are one object in one process and two in another: each is written
        # as often as it occurs. What has attributes may hold itself, and is written once.
        self.fast = True
        self._seen: dict[int, tuple[int, Any]] = {}

    def persistent_id(self, value: Any) -> Any:
        """The name of a value that is not taken to pieces; None if it is."""
        if isinstance(value, set | frozenset):
            return (type(value).__name__, *sorted(map(fingerprint, value)))
        if id(value) in self._seen:
            return self._seen[id(value)][0]
        home, name = getattr(value, "__module__", None), getattr(value, "__qualname__", None)
        if isinstance(value, ModuleType):
            home, name = value.__name__, ""
        elif not isinstance(getattr(value, "__self__", None), ModuleType | None):
            return None  # A method, of an object that counts.
        if not (isinstance(home, str) and isinstance(name, str) and _installed(home)):
            return None
        original: Any = sys.modules.get(home)
        for part in filter(None, name.split(".")):
            original = getattr(original, part, None)
        of_c = isinstance(value, type) and not value.__flags__ & _MADE_BY_CLASS
        if original is not value and not of_c:  # It only bears the name, by `functools.wraps`.
            return None
        package = sys.modules.get(home.partition(".")[0])
        return f"{home}.{name} {getattr(package, '__version__', '')}"

    def reducer_override(self, value: Any) -> Any:
        """The parts of a value, in the form of `__reduce__`."""
        if hasattr(value, "__dict__"):
            self._seen[id(value)] = (len(self._seen), value)
        if isinstance(value, CodeType):
            body = (value.co_code, value.co_consts, value.co_names, value.co_exceptiontable)
            counts = (value.co_argcount, value.co_posonlyargcount, value.co_kwonlyargcount)
            names = (value.co_varnames, value.co_cellvars, value.co_freevars)
            return CodeType, (*body, value.co_flags, *counts, *names)
        if isinstance(value, FunctionType):
            return FunctionType, (), _of_function(value)
        if isinstance(value, type):
            state = {name: part for name, part in vars(value).items() if name not in _OF_PYTHON}
            return type(value), (value.__qualname__, value.__bases__), state
        if isinstance(value, ModuleType):
            state = {name: part for name, part in vars(value).items() if name[:2] != "__"}
            return ModuleType, (value.__name__,), state
        if isinstance(value, _LOCKS):
            return type(value), ()
        if isinstance(value, weakref.ref):
            return type(value), (value(),)
        library = _installed(type(value).__module__) and not isinstance(value, partial)
        if library and hasattr(value, "__wrapped__"):  # A cache of results, compiled code.
            return type(value), (value.__wrapped__,)
        return super().reducer_override(value)


def _of_function(function: FunctionType) -> tuple[Any, ...]:
    """The parts of a function: its code, and the values that this uses."""
    codes = list(_codes(function.__code__))
    names = {name for code in codes for name in code.co_names}
    steps = [(step.opname, step.argval) for code in codes for step in get_instructions(code)]
    imports = {name for operation, name in steps if operation == "IMPORT_NAME"}
    looked_up = {name for operation, name in steps if operation in _LOOK_UP}
    globals_used = {
        n: function.__globals__[n] for n in sorted(looked_up & function.__globals__.keys())
    }
    globals_used |= {name: _imported(name) for name in sorted(imports)}
    used = {name: _reached(variable, names, ()) for name, variable in globals_used.items()}
    cells = [_reached(_contents(cell), names, ()) for cell in function.__closure__ or ()]
    defaults = (function.__defaults__, function.__kwdefaults__)
    return function.__code__, *defaults, cells, used, vars(function)


def _contents(cell: CellType) -> Any:
    """The contents of a closure's cell."""
    try:
        return cell.cell_contents
    except ValueError:  # Nothing yet.
        return None


def _reached(value: Any, names: set[str], within: tuple[ModuleType, ...]) -> Any:
    """A value; of a user's module the parts in use, reached through modules `within`."""
    if not isinstance(value, ModuleType) or value in within or _installed(value.__name__):
        return value
    has = sorted(names & vars(value).keys())
    return {name: _reached(vars(value)[name], names, (*within, value)) for name in has}


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A code, and those that it holds."""
    yield code
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _codes(constant)


def _imported(name: str) -> ModuleType:
    """A module that a function imports when it is called."""
    try:
        return import_module(name)
    except Exception as error:  # Whatever a module raises; names may be relative too.
        raise UsageError(
            f"measure: a function imports the module {printable(name)}, which the sweep cannot "
            f"import ({printable(error)}); import it at the top of the function's module"
        ) from None


def _installed(module: str) -> bool:
    """True if a module belongs to this package, to another one that is installed, or to Python."""
    top = module.partition(".")[0]
    file = getattr(sys.modules.get(module) or sys.modules.get(top), "__file__", None)
    if file is None:  # Built in.
        return top in sys.stdlib_module_names and top != "__main__"
    places = {"site-packages", "dist-packages"}
    is_ours = top == __name__.partition(".")[0] or Path(file).is_relative_to(_STANDARD)
    return is_ours or not places.isdisjoint(Path(file).parts)
