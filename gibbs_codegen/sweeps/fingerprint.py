"""A digest of values and functions that is the same in every process: of what they are, not where.

A function is its byte code with the constants, defaults, closed-over values and globals that it
uses, which are taken with what they hold in turn; a class is its methods. Only what installed
packages and the standard library define counts by name and version.
"""

from __future__ import annotations

import dataclasses
import hashlib
import pickle
import sys
from collections.abc import Iterator, Mapping
from dis import get_instructions
from functools import partial
from importlib import import_module
from pathlib import Path
from types import CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.errors import UsageError, printable

_IMPORT = "IMPORT_NAME"  # What byte code calls it.
_PLAIN = (int, float, complex, str, bytes, type(None), type(Ellipsis))


def fingerprint(*values: Any) -> str:
    """The SHA-256 of values, in hexadecimal digits.

    Args:
        values: Numbers, texts, arrays, functions, and tables, lists and dataclasses of these.

    Returns:
        The digits.

    Raises:
        UsageError: If something in them has nothing to tell it by.
    """
    digest = hashlib.sha256()
    for part in _parts(values, (), {}):
        digest.update(len(part).to_bytes(8, "little") + part)
    return digest.hexdigest()


def _parts(value: Any, within: tuple[int, ...], seen: dict[Any, int]) -> Iterator[bytes]:
    """What a value is, in pieces.

    Args:
        value: The value.
        within: Identities of what it is in, so that what holds itself comes to an end.
        seen: Functions and classes so far, which are told once, by their numbers.

    Yields:
        The pieces, the first of which is the kind of the value.
    """
    yield type(value).__qualname__.encode()
    if isinstance(value, _PLAIN):
        yield repr(value).encode()
        return
    if id(value) in within:
        yield b"again"
        return
    if isinstance(value, FunctionType | type):
        if value in seen:
            yield str(seen[value]).encode()
            return
        seen[value] = len(seen)
    within = (*within, id(value))
    if isinstance(value, np.ndarray | np.generic):
        array = np.asarray(value)
        held = array.tolist() if array.dtype.hasobject else array.tobytes()
        yield from _parts((str(array.dtype), array.shape, held), within, seen)
    elif isinstance(value, Mapping):
        for pair in value.items():
            yield from _parts(pair, within, seen)
    elif isinstance(value, set | frozenset):
        yield from sorted(b"".join(_parts(each, within, {**seen})) for each in value)
    elif isinstance(value, list | tuple):
        yield str(len(value)).encode()
        for each in value:
            yield from _parts(each, within, seen)
    else:
        yield from _parts(_told(value), within, seen)


def _told(value: Any) -> Any:
    """Plainer values that tell what a value is.

    Args:
        value: A function, module, class or object.

    Returns:
        What `_parts` takes.

    Raises:
        UsageError: If nothing tells.
    """
    if isinstance(value, CodeType):
        return (
            value.co_code,
            value.co_consts,
            value.co_names,
            value.co_varnames,
            value.co_freevars,
        )
    if isinstance(value, MethodType):
        return (value.__func__, value.__self__)
    if isinstance(value, partial):
        return (value.func, value.args, value.keywords)
    if isinstance(value, staticmethod | classmethod):
        return value.__func__
    if isinstance(value, property):
        return (value.fget, value.fset)
    home = getattr(value, "__module__", None) or ""
    name = getattr(value, "__qualname__", None)
    if isinstance(value, ModuleType):
        home, name = value.__name__, ""
    if name is not None and _is_installed(home):
        package = sys.modules.get(home.partition(".")[0])
        owner = getattr(value, "__self__", None)
        held = None if isinstance(owner, ModuleType) else owner
        return (home, name, getattr(package, "__version__", ""), held)
    if isinstance(value, FunctionType):
        return _of_function(value)
    if isinstance(value, type):
        return _of_class(value)
    if isinstance(value, ModuleType):
        return {n: each for n, each in vars(value).items() if not n.startswith("__")}
    return _of_object(value, name)


def _of_object(value: Any, name: str | None) -> Any:
    """Plainer values that tell what an object is; its name, if any, is not that of a function.

    Args:
        value: The object.
        name: What it is called in its module; None if it has no name.

    Returns:
        What `_parts` takes.

    Raises:
        UsageError: If nothing tells.
    """
    if hasattr(value, "__wrapped__"):
        return (type(value), value.__wrapped__)
    if dataclasses.is_dataclass(value):
        named = {each.name: getattr(value, each.name) for each in dataclasses.fields(value)}
        return (type(value), named)
    known = callable(value) or not _is_installed(type(value).__module__)
    if known and name is None and hasattr(value, "__dict__"):
        return (type(value), vars(value))
    try:
        return pickle.dumps(value, protocol=4)
    except Exception as error:  # Whatever pickling meets.
        raise UsageError(
            f"{printable(repr(value), 60)}: a sweep cannot tell whether this is the same when it "
            f"is called again ({printable(error)}); let measures use numbers, arrays and functions"
        ) from None


def _of_function(function: FunctionType) -> Any:
    """What a function of Python does."""
    codes = list(_codes(function.__code__))
    names = {name for code in codes for name in code.co_names}
    imports = [each.argval for c in codes for each in get_instructions(c) if each.opname == _IMPORT]
    held = {n: function.__globals__[n] for n in sorted(names) if n in function.__globals__}
    held |= {name: _imported(name) for name in sorted(imports)}
    used = {name: _reached(each, names, ()) for name, each in held.items()}
    cells = [_reached(cell.cell_contents, names, ()) for cell in function.__closure__ or ()]
    return (function.__code__, function.__defaults__, function.__kwdefaults__, cells, used)


def _of_class(kind: type) -> Any:
    """What a class does: its methods, and what else it has that is not made by Python."""
    told = (FunctionType, staticmethod, classmethod, property)
    own = {
        name: each
        for name, each in vars(kind).items()
        if isinstance(each, told) or (isinstance(each, _PLAIN) and not name.startswith("__"))
    }
    return (kind.__qualname__, kind.__bases__, own)


def _reached(value: Any, names: set[str], within: tuple[ModuleType, ...]) -> Any:
    """A value, of a module of the user's only what is used of it, since that may change.

    Args:
        value: The value.
        names: What is used.
        within: The modules that it was reached through.

    Returns:
        What tells it.
    """
    if not isinstance(value, ModuleType) or value in within or _is_installed(value.__name__):
        return value if not isinstance(value, ModuleType) else value.__name__
    has = sorted(names & vars(value).keys())
    return {name: _reached(vars(value)[name], names, (*within, value)) for name in has}


def _codes(code: CodeType) -> Iterator[CodeType]:
    """A code, and those that it holds."""
    yield code
    for each in code.co_consts:
        if isinstance(each, CodeType):
            yield from _codes(each)


def _imported(name: str) -> ModuleType | str:
    """A module that a function imports when it is called; of installed ones their names do."""
    if _is_installed(name):
        return name
    try:
        return import_module(name)
    except Exception as error:  # Whatever a module raises; names may be relative too.
        raise UsageError(
            f"measure: a sweep cannot tell what the module {printable(name)} does, which a "
            f"function imports ({printable(error)}); import it at the top of the function's module"
        ) from None


def _is_installed(module: str) -> bool:
    """Whether a module belongs to this package, to another one that is installed, or to Python."""
    top = module.partition(".")[0]
    if top in sys.stdlib_module_names or top == __name__.partition(".")[0]:
        return top != "__main__"
    file = getattr(sys.modules.get(module) or sys.modules.get(top), "__file__", None)
    return not {"site-packages", "dist-packages"}.isdisjoint(Path(file or "").parts)
