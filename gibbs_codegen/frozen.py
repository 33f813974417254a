"""Frozen dataclasses that are made in a quarter of the time of `dataclass(frozen=True)`.

Before Python 3.13 `dataclasses` compiles six functions for each class: for all classes that
`generate` imports that was a tenth of its time. Here one is compiled, and the others are shared.
`dataclasses.replace`, `fields` and `asdict` know these classes, too.
"""

from __future__ import annotations

from dataclasses import MISSING, FrozenInstanceError, dataclass, field, fields
from operator import attrgetter
from typing import Any, NoReturn, TypeVar, dataclass_transform

_Class = TypeVar("_Class", bound=type)


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def frozen(made: _Class) -> _Class:
    """Make a class a dataclass whose fields are not assigned to; it compares and hashes by them."""
    every = fields(dataclass(init=False, repr=False, eq=False)(made))
    values = attrgetter(*[entry.name for entry in every] or ["__class__"])

    def equal(self: Any, other: Any) -> bool:
        same_class = other.__class__ is self.__class__
        return values(self) == values(other) if same_class else NotImplemented

    def hashed(self: Any) -> int:
        return hash(values(self))

    arguments, lines, defaults = ["self"], ["_of_self = self.__dict__"], dict[str, Any]()
    for entry in every:
        name, default = entry.name, f"default_{entry.name}"
        value = name
        if entry.default_factory is not MISSING:
            defaults[default] = entry.default_factory
            value = f"{default}() if {name} is {default} else {name}"
        elif entry.default is not MISSING:
            defaults[default] = entry.default
        arguments.append(f"{name}={default}" if default in defaults else name)
        lines.append(f"_of_self['{name}'] = {value}")
    lines += ["self.__post_init__()"] if hasattr(made, "__post_init__") else []
    # Of names of fields alone.
    exec("\n ".join([f"def __init__({', '.join(arguments)}):", *lines]), defaults)  # noqa: S102
    init = defaults["__init__"]
    init.__qualname__ = f"{made.__qualname__}.__init__"
    init.__annotations__ = {entry.name: entry.type for entry in every}
    functions = {"__init__": init, "__eq__": equal, "__hash__": hashed, "__repr__": _text}
    for name, function in {**functions, "__setattr__": _refuse, "__delattr__": _refuse}.items():
        if name not in vars(made):
            setattr(made, name, function)
    return made


def _text(self: Any) -> str:
    entries = ", ".join(f"{entry.name}={getattr(self, entry.name)!r}" for entry in fields(self))
    return f"{type(self).__qualname__}({entries})"


def _refuse(self: object, name: str, *_: object) -> NoReturn:
    raise FrozenInstanceError(f"{name} of {type(self).__name__} is not assigned to, nor deleted")
