"""A digest of values and functions that is the same in every process: of what they are, not where.

A function is its byte code with the constants, defaults, closed-over values and globals that it
uses; globals of its own module are taken with what they hold in turn, others by name and version.
"""

from __future__ import annotations

import dataclasses
import hashlib
import pickle
import sys
from collections.abc import Iterator, Mapping
from functools import partial
from types import BuiltinFunctionType, CodeType, FunctionType, MethodType, ModuleType
from typing import Any

import numpy as np

from gibbs_codegen.errors import UsageError, printable

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
    for part in _parts(values, ()):
        digest.update(len(part).to_bytes(8, "little") + part)
    return digest.hexdigest()


def _parts(value: Any, within: tuple[int, ...]) -> Iterator[bytes]:
    """What a value is, in pieces.

    Args:
        value: The value.
        within: Identities of what it is in, so that what holds itself comes to an end.

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
    within = (*within, id(value))
    if isinstance(value, np.ndarray | np.generic):
        array = np.asarray(value)
        held = array.tolist() if array.dtype.hasobject else array.tobytes()
        yield from _parts((str(array.dtype), array.shape, held), within)
    elif isinstance(value, Mapping):
        for pair in value.items():
            yield from _parts(pair, within)
    elif isinstance(value, set | frozenset):
        yield from sorted(b"".join(_parts(each, within)) for each in value)
    elif isinstance(value, list | tuple):
        yield str(len(value)).encode()
        for each in value:
            yield from _parts(each, within)
    else:
        yield from _parts(_told(value), within)


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
    if isinstance(value, FunctionType):
        return _of_function(value)
    if isinstance(value, MethodType):
        return (value.__func__, value.__self__)
    if isinstance(value, partial):
        return (value.func, value.args, value.keywords)
    if isinstance(value, ModuleType):
        return (value.__name__, getattr(value, "__version__", ""))
    if isinstance(value, BuiltinFunctionType | np.ufunc):
        return (getattr(value, "__module__", ""), value.__name__, getattr(value, "__self__", None))
    name = getattr(value, "__qualname__", None)
    if callable(value) and name is not None:  # A class, or a function in C.
        return (getattr(value, "__module__", ""), name)
    if dataclasses.is_dataclass(value):
        named = {each.name: getattr(value, each.name) for each in dataclasses.fields(value)}
        return (type(value), named)
    if callable(value) and hasattr(value, "__dict__"):
        return (type(value), type(value).__call__, vars(value))
    try:
        return pickle.dumps(value, protocol=4)
    except Exception as error:  # Whatever pickling meets.
        raise UsageError(
            f"{printable(repr(value), 60)}: a sweep cannot tell whether this is the same when it "
            f"is called again ({printable(error)}); let measures use numbers, arrays and functions"
        ) from None


def _of_function(function: FunctionType) -> Any:
    """What a function of Python does."""
    used = {
        name: _of_module(function.__globals__[name], function.__module__)
        for name in sorted(_names(function.__code__))
        if name in function.__globals__
    }
    cells = [cell.cell_contents for cell in function.__closure__ or ()]
    return (function.__code__, function.__defaults__, function.__kwdefaults__, cells, used)


def _names(code: CodeType) -> set[str]:
    """Names of globals, and of attributes, in a code and in those that it holds."""
    inner = [_names(each) for each in code.co_consts if isinstance(each, CodeType)]
    return set(code.co_names).union(*inner)


def _of_module(value: Any, module: str) -> Any:
    """A global of a function: as it is, or where it comes from if that is another module.

    Args:
        value: The global.
        module: Name of the function's module.

    Returns:
        What tells it.
    """
    home = getattr(value, "__module__", None)
    if not callable(value) or home is None or home == module:
        return value
    package = sys.modules.get(home.partition(".")[0])
    name = getattr(value, "__qualname__", type(value).__qualname__)
    return (home, name, getattr(package, "__version__", ""))
