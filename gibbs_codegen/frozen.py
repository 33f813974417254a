"""Frozen dataclasses that are made in a third of the time of `dataclass(frozen=True)`.

Before Python 3.13 `dataclasses` compiles six functions for each class, one by one: for all classes
that `generate` imports that was a tenth of its time. Here three are compiled at once, and the
others are shared. `dataclasses.replace`, `fields` and `asdict` know these classes, too.
"""

from __future__ import annotations

from dataclasses import MISSING, FrozenInstanceError, dataclass, field, fields
from operator import attrgetter
from typing import Any, NoReturn, TypeVar, dataclass_transform

_Class = TypeVar("_Class", bound=type)
_TEXT = """
def __eq__(self, other):
    return {0} == {1} if other.__class__ is self.__class__ else NotImplemented
def __hash__(self):
    return hash({0})
def __init__({2}):
    {3}
"""


@dataclass_transform(frozen_default=True, field_specifiers=(field,))
def frozen(made: _Class) -> _Class:
    """Make a class a dataclass whose fields are not assigned to; it compares and hashes by them."""
    every = fields(dataclass(init=False, repr=False, eq=False)(made))
    arguments, lines = ["self"], ["pass"]
    names: dict[str, Any] = {"_assign": object.__setattr__}
    for entry in sorted(every, key=attrgetter("kw_only")):
        if entry.kw_only and "*" not in arguments:
            arguments.append("*")
        name, default, value = entry.name, f"_default_{entry.name}", entry.name
        if entry.default_factory is not MISSING:
            names[default] = entry.default_factory
            value = f"{default}() if {name} is {default} else {name}"
        elif entry.default is not MISSING:
            names[default] = entry.default
        arguments.append(f"{name}={default}" if default in names else name)
        lines.append(f"_assign(self, '{name}', {value})")
    lines += ["self.__post_init__()"] * hasattr(made, "__post_init__")
    own, others = ("".join(f"{x}.{e.name}, " for e in every) for x in ("self", "other"))
    text = _TEXT.format(f"({own})", f"({others})", ", ".join(arguments), "\n    ".join(lines))
    exec(text, names)  # noqa: S102 - of names of fields alone
    names["__init__"].__annotations__ = {entry.name: entry.type for entry in every}
    compiled = {name: names[name] for name in ("__init__", "__eq__", "__hash__")}
    for name, function in {**_SHARED, **compiled}.items():
        if name not in vars(made):
            setattr(made, name, function)
    return made


def _text(self: Any) -> str:
    entries = ", ".join(f"{entry.name}={getattr(self, entry.name)!r}" for entry in fields(self))
    return f"{type(self).__qualname__}({entries})"


def _refuse(self: object, name: str, *_: object) -> NoReturn:
    raise FrozenInstanceError(f"{name} of {type(self).__name__} is not assigned to, nor deleted")


_SHARED = {"__repr__": _text, "__setattr__": _refuse, "__delattr__": _refuse}
