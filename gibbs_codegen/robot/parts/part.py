"""The base of all parts, and the numbers of a part that can be parameters of modules.

A field of a part is a key of a robot file, said once: type, bounds, default, unit and words, and
whether modules have it as a parameter. The reader of files, its messages, the JSON schema, the page
of keys, the text of a robot, names and units of parameters and the numbers that verification varies
follow. A part that is made in Python is not checked, so that robots that no file may describe can
be computed with: those that verification compares, and imported ones before they are written.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from functools import cache, partial
from typing import Any, ClassVar, NamedTuple, TypeVar, get_type_hints

from pydantic.fields import FieldInfo

from gibbs_codegen.files.table import Table

AnyPart = TypeVar("AnyPart", bound="Part")


@dataclass(frozen=True)
class Parameter:
    """Marks of a number, or of several, that can be parameters.

    `unit` is one of joints that turn "or" another of those that slide, where they differ.
    `ends` are those of the names of several numbers, which are counted from 1 without it; `name`
    stands for the key in names. `keeps_sign` and `no_zero` are what other robots are bound to in
    which the number varies: others are divided by what is no zero, or have no derivative there.
    `missing` is the value of a field that is None, and `of_entries` tells of several numbers that
    are not alike.
    """

    unit: str
    ends: tuple[str, ...] = ()
    name: str | None = None
    keeps_sign: bool = False
    no_zero: bool = False
    missing: float | None = None
    of_entries: tuple[Parameter, ...] = ()


class RobotNumber(NamedTuple):
    """A number of a robot that can be a parameter, and the field of its part."""

    key: str
    name: str
    value: float
    unit: str
    keeps_sign: bool
    no_zero: bool


def entry(words: str, default: Any = None, *, key: str | None = None, **more: Any) -> Any:
    """A key of a part: what it is, with its unit, and its default, ... where it is required.

    `key` is its name in a file, if not the field's; `written` is its default as a file has it, and
    `unsaid` what the field is where the key is left out, without being a default of the file.
    """
    options: dict[str, Any] = {"default": MISSING if default is ... else default}
    if "unsaid" in more:
        value = more.pop("unsaid")
        options = {"default_factory": lambda: value}
    if "written" in more:
        more["json_schema_extra"] = {"default": more.pop("written")}
    if "kw_only" in more:
        options["kw_only"] = more.pop("kw_only")
    return field(metadata={"description": words, "validation_alias": key, **more}, **options)


def number(words: str, default: Any = None, **more: Any) -> Any:
    """A key that can be a parameter; its words have its unit in braces, as {kg} or {N m or N}.

    The rest is as of `entry` and `Parameter`; `unit` is that of words that do not say it.
    """
    match = re.search(r"{(.*)}", words)
    marks = {mark.name: more.pop(mark.name) for mark in fields(Parameter) if mark.name in more}
    units: dict[str, Any] = {"unit": match[1] if match else None, "name": more.get("key")}
    if match:
        words = words.replace(match[0], match[1].replace("^2", "²"))
    return entry(words, default, parameter=Parameter(**units | marks), **more)


sized = partial(number, keeps_sign=True, no_zero=True)


def again(kind: type[Part], name: str, **more: Any) -> Any:
    """The field of another part once more, with another default if one is given."""
    first = kind.__dataclass_fields__[name]
    options: dict[str, Any] = {"default": first.default} | more
    return field(metadata=first.metadata, **options)


@dataclass(frozen=True, kw_only=True)
class Part(Table):
    """A part of a robot."""

    # Fields that are parameters only beside drives of a robot.
    of_drive: ClassVar[tuple[str, ...]] = ()
    # Numbers that can be parameters without being keys.
    derived: ClassVar[Mapping[str, Parameter]] = {}

    @classmethod
    def _fields(cls) -> dict[str, FieldInfo]:
        return _declared(cls)

    def parameters(self) -> dict[str, Parameter]:
        """Numbers that can be parameters and count for this part, by fields."""
        marks = parameters_of(type(self))
        return {key: mark for key, mark in marks.items() if key not in self.of_drive}


def _fields_of_kind(kind: type[Part]) -> dict[str, FieldInfo]:
    hints = get_type_hints(kind, include_extras=True)
    return {
        key.name: FieldInfo.from_annotated_attribute(hints[key.name], key) for key in fields(kind)
    }


def _parameters_of_kind(kind: type[Part]) -> dict[str, Parameter]:
    marks = {key.name: key.metadata.get("parameter") for key in fields(kind)}
    return {name: mark for name, mark in marks.items() if mark is not None}


_declared: Callable[[Any], dict[str, FieldInfo]] = cache(_fields_of_kind)
parameters_of: Callable[[Any], dict[str, Parameter]] = cache(_parameters_of_kind)


def changed_numbers(
    part: Part,
    prefix: str,
    change: Callable[[RobotNumber], Any],
    slides: bool = False,
    marks: Mapping[str, Parameter] | None = None,
) -> dict[str, Any]:
    """Changed numbers of a part, of those that can be parameters, by their fields.

    Names begin with the prefix. `slides` tells which of two units it is, `marks` which numbers, if
    not those of `Part.parameters`.
    """
    by_name: dict[str, Any] = {}

    def changed(key: str, name: str, value: float, mark: Parameter) -> Any:
        unit = mark.unit.split(" or ")[-1 if slides else 0]
        if name not in by_name:
            number = RobotNumber(key, name, value, unit, mark.keeps_sign, mark.no_zero)
            by_name[name] = change(number)
        return by_name[name]

    by_key: dict[str, Any] = {}
    for key, mark in (part.parameters() if marks is None else marks).items():
        value = getattr(part, key)
        value = mark.missing if value is None else value
        if value is None:
            continue
        name = _joined(prefix, key if mark.name is None else mark.name)
        if isinstance(value, tuple):
            ends = mark.ends or map(str, range(1, len(value) + 1))
            entries = zip(ends, value, mark.of_entries or (mark,) * len(value), strict=True)
            by_key[key] = tuple(changed(key, _joined(name, end), x, of) for end, x, of in entries)
        else:
            by_key[key] = changed(key, name, value, mark)
    return by_key


def _joined(*words: str) -> str:
    return "_".join(filter(None, words))


def all_keys(part: Part) -> dict[str, Any]:
    """The numbers of a part that can be parameters, by their keys in a file."""
    return {file_key(part, name): getattr(part, name) for name in part.parameters()}


def changed_keys(part: Part, *left_out: str) -> dict[str, Any]:
    """The keys of a part in a file that are not the defaults, but for some."""
    values = {key: getattr(part, key.name) for key in fields(part) if key.name not in left_out}
    return {file_key(part, key.name): x for key, x in values.items() if x != _default(key)}


def _default(key: Field[Any]) -> Any:
    return key.default if key.default_factory is MISSING else key.default_factory()


def file_key(part: Part, name: str) -> str:
    """The key in a file of a field."""
    return str(_declared(type(part))[name].validation_alias or name)


def taken(kind: type[AnyPart], part: Part) -> AnyPart:
    """A part of some kind, made of the fields of another that has them."""
    return kind(**{key.name: getattr(part, key.name) for key in fields(kind)})


def parameter_ends(*kinds: type[Part]) -> tuple[str, ...]:
    """Ends of names of parameters of parts of some kinds, but for those of drives."""
    return tuple(
        _joined(key if mark.name is None else mark.name, end)
        for kind in kinds
        for key, mark in (*parameters_of(kind).items(), *kind.derived.items())
        if key not in kind.of_drive
        for end in mark.ends or ("",)
    )
