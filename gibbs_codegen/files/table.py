"""Tables of a TOML file as dataclasses: every fault in this package's words, and the schema.

A subclass of `Table` under `table` says once what a table may hold: a field for each key, with its
type, bounds, default and words. The reader of files, the JSON schema for editors, the pages of keys
and all messages follow from it, and so does the check of what is made in Python. Tables from a file
differ from those by the context of the validation, which is the file's document.
"""

from __future__ import annotations

import copy
import difflib
import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field, fields
from datetime import date, datetime, time
from fractions import Fraction
from functools import cache
from inspect import Parameter, Signature
from typing import Annotated, Any, ClassVar, Self, TypeVar, cast, dataclass_transform, get_args

import pydantic
import pydantic_core
from pydantic import GetCoreSchemaHandler as CoreHandler
from pydantic import GetJsonSchemaHandler as JsonHandler
from pydantic.dataclasses import dataclass as validated_dataclass
from pydantic.fields import FieldInfo
from pydantic.functional_validators import ModelWrapValidatorHandler
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import CoreSchema, core_schema

from gibbs_codegen.errors import UsageError, written

# Keys and list places, from a table inwards.
Place = tuple[str | int, ...]

# Pydantic's types of what validators here raise: faults in words, and those in the name of an entry
# of a table rather than in its value.
FAULT, IN_NAME = "fault", "fault_in_name"
_KINDS = {str: "a string", list: "a list", dict: "a table", int: "a number", float: "a number"}
_KINDS |= {bool: "a boolean"} | dict.fromkeys((datetime, date, time), "a date or time")


def fault(words: str, kind: str = FAULT) -> pydantic_core.PydanticCustomError:
    """The error of a validator of one value; `kind` is `IN_NAME` for the name of an entry."""
    # In a message template braces would be read as fields.
    return pydantic_core.PydanticCustomError(kind, "{words}", {"words": words})


def refusal(faults: Collection[tuple[Place, str]]) -> pydantic.ValidationError:
    """The error of a validator that finds faults at several places, relative to its value."""
    details = [
        pydantic_core.InitErrorDetails(type=fault(words), loc=place, input=None)
        for place, words in faults
    ]
    return pydantic.ValidationError.from_exception_data("table", details)


def kind_of(value: object) -> str:
    """Kind of a TOML value in words, such as "a list"; of others the name of the type."""
    return _KINDS.get(type(value), type(value).__name__)


def shown(value: object) -> str:
    """A value of a file in at most 80 characters of ASCII, for a message."""
    if isinstance(value, list | dict):  # What is in it may be as deep or as long as it likes.
        return kind_of(value)
    if isinstance(value, int) and abs(value) > 10**20:
        return "a huge number"
    if isinstance(value, float):
        return written(value)
    return ascii(value[:80] if isinstance(value, str) else value)[:80]


def not_one_of(value: object, choices: Collection[str]) -> str:
    """Words for a value that is none of those it may be, with the nearest one."""
    near = difflib.get_close_matches(value, choices, n=1) if isinstance(value, str) else []
    hint = f"; did you mean {near[0]!r}?" if near else ""
    return f"must be one of {', '.join(map(repr, choices))}, not {shown(value)}{hint}"


def key_path(place: Place) -> str:
    """Key path of a place from the top of the file, such as `link[0].mass`.

    A key that is no identifier, or is long, stands in quotes.
    """
    path = ""
    for key in place:
        if isinstance(key, int):
            path += f"[{key}]"
        else:
            path += f".{key if key.isidentifier() and len(key) <= _LONGEST_KEY else _quoted(key)}"
    return path.removeprefix(".")


# Characters of a key that a message shows.
_LONGEST_KEY = 64


def _quoted(key: str) -> str:
    """The begin of a key, in quotes, where characters that do not print take several."""
    shown = key[:_LONGEST_KEY]
    while len(ascii(shown)) > _LONGEST_KEY + 2:
        shown = shown[: len(shown) // 2]
    return ascii(shown)


# Values keep their types: a string or boolean is no number, and 2.0 no whole one.
_REAL = core_schema.float_schema(strict=True, allow_inf_nan=False)
_WHOLE, _FLAG = core_schema.int_schema(strict=True), core_schema.bool_schema(strict=True)
Real = Annotated[float, pydantic.GetPydanticSchema(lambda *_: _REAL)]
# Or infinite, or not a number.
AnyReal = Annotated[float, pydantic.GetPydanticSchema(lambda *_: _REAL | {"allow_inf_nan": True})]
_PLAIN = pydantic.BeforeValidator(lambda value: to_python(value))
Whole = Annotated[int, pydantic.GetPydanticSchema(lambda *_: _WHOLE), _PLAIN]
Flag = Annotated[bool, pydantic.GetPydanticSchema(lambda *_: _FLAG), _PLAIN]

# To look for what a key may have been meant to be takes time, and a flood of keys is no slip.
_MOST_SUGGESTIONS = 20
_MEANT = "did you mean "
_NOUNS = {
    "bool_type": "true or false",
    "dict_type": "a table",
    "float_type": "a number",
    "int_type": "a whole number",
    "list_type": "a list",
    "string_type": "a string",
    "tuple_type": "a list",
}
_CONFIG = pydantic.ConfigDict(
    extra="forbid",
    arbitrary_types_allowed=True,
    hide_input_in_errors=True,
    populate_by_name=True,
    defer_build=True,  # What checks a table is built when the first one is made.
)
AnyTable = TypeVar("AnyTable", bound="Table")


def key(words: str, name: str | None = None) -> Any:
    """Metadata of a field: what it is, with its unit, and its key where that is another name."""
    return pydantic.Field(description=words, validation_alias=name)


def entry(words: str, default: Any = None, **more: Any) -> Any:
    """A field that may be left out: what it is, with its unit, and its default, `dict` for none."""
    more |= {"default_factory": dict} if default is dict else {"default": default}
    return pydantic.Field(description=words, **more)


def named(words: str, *, default: Any, kw_only: bool) -> Any:
    """The same that is given by its name in Python; types are checked by its keywords."""
    return entry(words, default, kw_only=kw_only)


def optional(words: str, default: Any = None) -> Any:
    """A field of a table of a file that may be left out: what it is, with its unit."""
    return entry(words, default, kw_only=True)


@dataclass_transform(frozen_default=True, field_specifiers=(pydantic.Field, field, named))
def table(cls: type[AnyTable]) -> type[AnyTable]:
    """A frozen dataclass whose fields are the keys of a table; see `Table`."""
    made: Any = validated_dataclass(cls, frozen=True, config=_CONFIG)
    made.__init__.__signature__ = _signature(made)
    return cast(type[AnyTable], made)


def _signature(made: Any) -> Signature:
    """Arguments of a table, of which Python tells nothing before its checks are built."""
    arguments = [Parameter("self", Parameter.POSITIONAL_OR_KEYWORD)]
    for member in sorted(fields(made), key=lambda argument: bool(argument.kw_only)):
        kind = Parameter.KEYWORD_ONLY if member.kw_only else Parameter.POSITIONAL_OR_KEYWORD
        info = made.__pydantic_fields__[member.name]
        default = Parameter.empty if info.is_required() else info.default_factory or info.default
        arguments.append(Parameter(member.name, kind, default=default, annotation=member.type))
    return Signature(arguments)


@dataclass_transform(
    frozen_default=True, kw_only_default=True, field_specifiers=(pydantic.Field, field)
)
def file_table(cls: type[AnyTable]) -> type[AnyTable]:
    """As `table`, of what is made from files only: required keys may stand anywhere."""
    made: Any = validated_dataclass(cls, frozen=True, kw_only=True, config=_CONFIG)
    return cast(type[AnyTable], made)


@validated_dataclass(frozen=True, config=_CONFIG)
class Table:
    """A table of a file, or a part of what a file describes, made in Python.

    Fields, and validators of fields, come in the order in which faults of one line are reported. A
    table that is one of several has the name of its kind in a class variable `kind`. `title` is
    that of a file, for editors; `conditions` are what JSON schemas can say of keys together.
    """

    title: ClassVar[str | None] = None
    conditions: ClassVar[dict[str, Any] | None] = None
    # Another kind of file that may be given by mistake, and keys that only it has.
    mistaken: ClassVar[tuple[str, frozenset[str]]] = ("", frozenset())
    # Where else a key may belong, in words.
    elsewhere: ClassVar[str] = ""
    # Keys of the table, by those of other tables that may be mistaken for them.
    synonyms: ClassVar[Mapping[str, str]] = {}

    @classmethod
    def _key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str | Place, str]]:
        """Key, or place inside the table, and words of faults that are always reported.

        That is even where entries of the table, here unchecked, have faults of their own.
        """
        return iter(())

    def _faults(self) -> Iterator[tuple[Place, str]]:
        """Place and words of faults of entries that are right each by itself."""
        return iter(())

    def _completed(self) -> Self:
        """The table with what its keys leave to others, once it has no faults."""
        return self

    @classmethod
    def _missing(cls, key: str) -> str:
        """Words for a key that is required and missing: what it is."""
        words = cls._fields()[cls._names().get(key, key)].description
        return f"missing: {words}" if words else "missing"

    @classmethod
    def _fields(cls) -> dict[str, FieldInfo]:
        fields: dict[str, FieldInfo] = cls.__pydantic_fields__  # type: ignore[attr-defined]
        return fields

    @classmethod
    def _names(cls) -> dict[str, str]:
        """Names of the fields by their keys in a file."""
        return {str(info.validation_alias or name): name for name, info in cls._fields().items()}

    @classmethod
    def __get_pydantic_json_schema__(cls, schema: CoreSchema, handler: JsonHandler) -> Any:
        table_schema = handler(schema)
        title = {"title": cls.title} if cls.title else {}
        handler.resolve_ref_schema(table_schema).update((cls.conditions or {}) | title)
        return table_schema

    @pydantic.model_validator(mode="wrap")
    @classmethod
    def _checked(
        cls, values: Any, handler: ModelWrapValidatorHandler[Self], info: pydantic.ValidationInfo
    ) -> Self:
        if isinstance(values, cls):
            return values
        in_file = info.context is not None
        # Names of keys of a file, or of arguments in Python.
        names = cls._names()
        key_names = list(names if in_file else names.values())
        if isinstance(values, pydantic_core.ArgsKwargs):
            placed = [names[key] for key in names if not cls._fields()[names[key]].kw_only]
            if len(values.args) > len(placed):
                raise TypeError(
                    f"{cls.__name__} takes {len(placed)} values by their places, "
                    f"not {len(values.args)}"
                )
            values = dict(zip(placed, values.args, strict=False)) | (values.kwargs or {})
        elif not isinstance(values, dict):
            form = "a table" if in_file else f"{cls.__name__}(…)"
            raise fault(f"must be {form}, not {kind_of(values)}")
        elif hasattr(cls, "kind"):
            values = {key: value for key, value in values.items() if key != "kind"}
        faults: list[tuple[Place, str]] = []
        # In Python an argument may be what it is when left out, as of `replace`.
        empty = {name for name, info in cls._fields().items() if info.default_factory is dict}
        present = {
            key: value
            for key, value in values.items()
            if in_file or not (value is None or (key in empty and not value))
        }
        arguments = {key: value for key, value in values.items() if key in key_names}
        unknown = [key for key in values if key not in arguments]
        if in_file and hasattr(cls, "kind"):
            key_names.insert(0, "kind")
        meant = cls._meant(unknown, key_names)
        # What a misspelt key may mend is no fault.
        mended = {meant[key]: values[key] for key in meant} | present
        lasting = {*cls._key_faults(mended)} if meant else ()
        # Types of tables within are looked up among these names too, where `key` is a function.
        for at, words in cls._key_faults(present):
            if not meant or (at, words) in lasting:
                faults.append(((at,) if isinstance(at, str) else at, words))
        try:
            made = handler(pydantic_core.ArgsKwargs((), arguments))
        except pydantic.ValidationError as error:
            for detail in error.errors(include_url=False):
                place = detail["loc"][:-1] if detail["type"] == IN_NAME else detail["loc"]
                if place and not in_file:
                    place = (names.get(str(place[0]), place[0]), *place[1:])
                faults.append((place, cls._words(detail)))
        else:
            faults += [] if faults or unknown else made._faults()
        known_keys = ", ".join(key_names)
        for key in unknown:
            known = f"known keys: {known_keys}{cls.elsewhere}"
            hint = f"{_MEANT}{meant[key]}?" if key in meant else known
            faults.append(((key,), f"unknown key; {hint}"))
        misspelt = {
            (*place[:-1], words.partition(_MEANT)[2].rstrip("?"))
            for place, words in faults
            if words.startswith(f"unknown key; {_MEANT}")
        }
        faults = [
            (place, words)
            for place, words in faults
            if place not in misspelt or (len(place) == 1 and place[0] in values)
        ]
        if faults and in_file:
            raise refusal(faults)
        if faults:
            messages = (f"{key_path((cls.__name__, *place))}: {words}" for place, words in faults)
            raise UsageError("; ".join(messages))
        return made._completed()

    @classmethod
    def _words(cls, details: pydantic_core.ErrorDetails) -> str:
        """A fault that pydantic found, in words of this package."""
        kind, value = details["type"], details["input"]
        if "words" in details.get("ctx", {}):
            return str(details["ctx"]["words"])
        if kind == "missing":
            return cls._missing(str(details["loc"][-1]))
        if kind == "literal_error":
            name = str(details["loc"][-1])
            choices = get_args(cls._fields()[cls._names().get(name, name)].annotation)
            if type(None) in choices:  # The key may be left out.
                choices = get_args(choices[0])
            return not_one_of(value, choices)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if kind == "finite_number" or (kind == "float_type" and is_number):
            return f"must be a finite number, not {shown(value)}"
        value_text = shown(value) if kind == "int_type" and is_number else kind_of(value)
        return f"must be {_NOUNS[kind]}, not {value_text}"

    @classmethod
    def _meant(cls, unknown: Collection[str], key_names: list[str]) -> dict[str, str]:
        """The known keys that unknown ones were perhaps meant to be."""
        near = {key: [cls.synonyms[key]] for key in unknown if key in cls.synonyms}
        for key in unknown if len(unknown) <= _MOST_SUGGESTIONS else ():
            if key not in near and len(key) <= _LONGEST_KEY:
                near[key] = difflib.get_close_matches(key, key_names, n=1)
        return {key: names[0] for key, names in near.items() if names}


# A check of a table, or of a list of them.
reader: Callable[[Any], pydantic.TypeAdapter[Any]] = cache(pydantic.TypeAdapter)


def read_table(
    kind: type[AnyTable], values: Mapping[str, Any]
) -> tuple[AnyTable | None, list[tuple[Place, str]]]:
    """The table of a whole document, or None, and place and words of every fault.

    The document is the context of its tables' validators.
    """
    try:
        return reader(kind).validate_python(values, context=values), []
    except pydantic.ValidationError as error:
        details = error.errors(include_url=False)
        return None, [(detail["loc"], detail["ctx"]["words"]) for detail in details]


def default_at(holder: Table, key: str) -> Any:
    """The default of a table at a key of a file, or None; angles are 0, also in degrees."""
    return getattr(holder, holder._names().get(key, key), None)


def json_schema(kind: type[Table]) -> dict[str, Any]:
    """The JSON schema (draft 2020-12) of the file whose top table this is."""
    schema = pydantic.TypeAdapter(kind).json_schema(schema_generator=_Schema)
    for described in schema["$defs"].values():
        del described["title"]  # It is the name of a class.
    return {"$schema": _Schema.schema_dialect, **schema}


class _Schema(GenerateJsonSchema):
    """Schemas without what TOML has not, null, and without titles that repeat the keys."""

    def field_title_should_be_set(self, schema: object) -> bool:
        return False

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        inner = super().default_schema(schema)
        default = schema.get("default")
        if isinstance(default, Table) or default in (None, (), math.inf):
            inner.pop("default", None)
        elif isinstance(default, Fraction):
            inner["default"] = float(default)
        return inner

    def dict_schema(self, schema: core_schema.DictSchema) -> JsonSchemaValue:
        inner = super().dict_schema(schema)
        if "patternProperties" in inner:
            inner["additionalProperties"] = False
        return inner


@dataclass(frozen=True)
class Bounds:
    """Metadata of a number: its least and greatest value, and the unit and end of a message."""

    least: float = -math.inf
    most: float = math.inf
    unit: str = ""
    remedy: str = ""

    def __get_pydantic_core_schema__(self, source: Any, handler: CoreHandler) -> CoreSchema:
        return core_schema.no_info_wrap_validator_function(self._checked, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: JsonHandler) -> Any:
        limits = {"minimum": self.least, "maximum": self.most}
        return handler(schema) | {key: v for key, v in limits.items() if math.isfinite(v)}

    def _checked(self, value: Any, handler: core_schema.ValidatorFunctionWrapHandler) -> Any:
        number = handler(value)
        if self.least <= number <= self.most:
            return number
        if math.isinf(self.most):
            right = f"at least {self.least:g}"
        elif math.isinf(self.least):
            right = f"at most {self.most:g}"
        else:
            right = f"from {self.least:g} to {self.most:g}"
        raise fault(f"must be {right}{self.unit}, not {shown(value)}{self.remedy}")


class InSchema(pydantic.WithJsonSchema):
    """The part of a JSON schema for a value; old versions of pydantic add to the one they get."""

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: JsonHandler) -> Any:
        return copy.deepcopy(super().__get_pydantic_json_schema__(schema, handler))


@dataclass(frozen=True)
class OneOf:
    """Metadata of a string: what it may be, where that is known at run time only."""

    choices: tuple[str, ...]

    def __get_pydantic_core_schema__(self, source: Any, handler: CoreHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self._checked, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: JsonHandler) -> Any:
        return handler(schema) | {"enum": list(self.choices)}

    def _checked(self, value: object) -> object:
        if value not in self.choices:
            raise fault(not_one_of(value, self.choices))
        return value


def to_python(value: Any) -> Any:
    """A number, or a list, of what may be one of NumPy's, or a tuple."""
    if isinstance(value, tuple):
        return list(value)
    return value.tolist() if hasattr(value, "tolist") else value


def list_of(value: object, length: int, noun: str = "numbers") -> Any:
    """The value, if it is a list of so many `noun`. Raises `PydanticCustomError` otherwise."""
    value = to_python(value)
    if not isinstance(value, list):
        raise fault(f"must be a list of {length} {noun}, not {kind_of(value)}")
    if len(value) != length:
        raise fault(f"must have {length} {noun}, not {len(value)}")
    return value


def listed(length: int, noun: str = "numbers") -> pydantic.BeforeValidator:
    """Metadata of a tuple that a file gives as a list of so many `noun`."""
    return pydantic.BeforeValidator(lambda value: tuple(list_of(value, length, noun)))


def needed(is_right: Callable[[Any], bool], otherwise: str) -> pydantic.AfterValidator:
    """Metadata of a value of the right type that must meet a condition.

    `otherwise` says what is wrong else, and what would be right.
    """
    return rule(lambda value: None if is_right(value) else otherwise)


def rule(words_for: Callable[[Any], str | None]) -> pydantic.AfterValidator:
    """Metadata of a value that is refused with words, if there are any for it."""

    def check(value: Any) -> Any:
        if words := words_for(value):
            raise fault(words)
        return value

    return pydantic.AfterValidator(check)


@dataclass(frozen=True)
class Tables:
    """Metadata of the array of tables `key`: at most `most` of them, which are `noun`.

    `form` says how to write them, if not as `[[key]]`.
    """

    key: str
    most: int
    noun: str
    form: str = ""

    def __get_pydantic_core_schema__(self, source: Any, handler: CoreHandler) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self._checked, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: JsonHandler) -> Any:
        return handler(schema) | {"maxItems": self.most}

    def _checked(self, value: object) -> object:
        value = to_python(value)
        if not isinstance(value, list):
            form = self.form or f"an array of tables, [[{self.key}]]"
            raise fault(f"must be {form}, not {kind_of(value)}")
        return at_most(value, self.most, self.noun)


def at_most(value: list[Any], most: int, noun: str) -> list[Any]:
    """The list; its entries are looked at afterwards.

    Raises `PydanticCustomError` for more than `most` entries.
    """
    if len(value) > most:
        raise fault(f"{len(value)} {noun}; give at most {most}")
    return value


@dataclass(frozen=True)
class Kinds:
    """Metadata of what a file gives as one of several tables, as their key `kind` tells.

    `description` describes the kinds; `default` is the kind of a table without the key,
    None where it is required. In Python it is one of the tables or, where they are `functions` of
    time, anything that can be called as they can.
    """

    tables: tuple[type[Table], ...]
    description: str
    default: str | None = None
    functions: bool = True

    def __get_pydantic_core_schema__(self, source: Any, handler: CoreHandler) -> CoreSchema:
        any_table = core_schema.union_schema([handler.generate_schema(t) for t in self.tables])
        return core_schema.with_info_wrap_validator_function(self._chosen, any_table)

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: JsonHandler) -> Any:
        union = handler(schema)
        for table, reference in zip(self.tables, union["anyOf"], strict=True):
            described, kind = handler.resolve_ref_schema(reference), table.kind  # type: ignore[attr-defined]
            entry = {"const": kind, "description": self.description, "type": "string"}
            if kind == self.default:
                entry["default"] = kind
            elif "kind" not in described.get("required", ()):
                described["required"] = ["kind", *described.get("required", ())]
            described["properties"] = {"kind": entry} | described["properties"]
        return union

    def _chosen(self, value: Any, _: object, info: pydantic.ValidationInfo) -> Any:
        if info.context is None:
            if isinstance(value, self.tables) or (self.functions and callable(value)):
                return value
            names = " or ".join(table.__name__ for table in self.tables)
            functions = "a function of time, such as " if self.functions else ""
            raise fault(f"must be {functions}{names}, not {kind_of(value)}")
        if not isinstance(value, dict):
            raise fault(f"must be a table, not {kind_of(value)}")
        tables = {table.kind: table for table in self.tables}  # type: ignore[attr-defined]
        kind = value.get("kind", self.default)
        if kind is None:
            raise refusal([(("kind",), f"missing; one of {', '.join(tables)}")])
        if not isinstance(kind, str) or kind not in tables:
            raise refusal([(("kind",), not_one_of(kind, tables))])
        # Dataclasses of pydantic have their validator ready.
        validator = tables[kind].__pydantic_validator__  # type: ignore[attr-defined]
        return validator.validate_python(value, context=info.context)
