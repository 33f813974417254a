"""Tables of a TOML file as pydantic models: every fault in this package's words, and the schema.

A subclass of `Table` says what a table may hold: a field for each key, with its type, bounds,
default and description. Faults, suggestions and the JSON schema for editors follow from that.
"""

from __future__ import annotations

import difflib
import math
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Self, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    GetCoreSchemaHandler,
    ValidationError,
    WrapValidator,
    model_validator,
)
from pydantic import GetJsonSchemaHandler as JsonHandler
from pydantic.functional_validators import ModelWrapValidatorHandler
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import (
    CoreSchema,
    ErrorDetails,
    InitErrorDetails,
    PydanticCustomError,
    core_schema,
)

# Keys and list places, from a table inwards.
Place = tuple[str | int, ...]

# Pydantic's types of what validators here raise: faults in words, and those in the name of an entry
# of a table rather than in its value.
FAULT, IN_NAME = "fault", "fault_in_name"
_KINDS = {str: "a string", list: "a list", dict: "a table", int: "a number", float: "a number"}


def fault(words: str, kind: str = FAULT) -> PydanticCustomError:
    """What a validator of one value raises; `kind` is `IN_NAME` if it is the name of an entry."""
    # In a message template braces would be read as fields.
    return PydanticCustomError(kind, "{words}", {"words": words})


def refusal(faults: Collection[tuple[Place, str]]) -> ValidationError:
    """What a validator raises that finds faults at several places, relative to its value."""
    details = [
        InitErrorDetails(type=fault(words), loc=place, input=None) for place, words in faults
    ]
    return ValidationError.from_exception_data("table", details)


def kind_of(value: object) -> str:
    """Kind of a TOML value in words, such as "a list"."""
    if isinstance(value, bool):
        return "a boolean"
    return _KINDS.get(type(value), "a date or time")


def shown(value: object) -> str:
    """A value of a file in at most 80 characters of ASCII, for a message."""
    if isinstance(value, list | dict):  # What is in it may be as deep or as long as it likes.
        return kind_of(value)
    if isinstance(value, int) and abs(value) > 10**20:
        return "a huge number"
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
    parts = [f"[{key}]" if isinstance(key, int) else f".{_shown_key(key)}" for key in place]
    return "".join(parts).removeprefix(".")


def _shown_key(key: str) -> str:
    return key if key.isidentifier() and len(key) <= 64 else ascii(key[:64])


# To look for what a key may have been meant to be takes time, and a flood of keys is no slip.
_MOST_SUGGESTIONS = 20
_LONGEST_KEY = 64
_NOUNS = {
    "bool_type": "true or false",
    "dict_type": "a table",
    "float_type": "a number",
    "int_type": "a whole number",
    "list_type": "a list",
    "model_type": "a table",
    "string_type": "a string",
}


class Table(BaseModel):
    """A table of a file. Values keep their types: a string or boolean is no number.

    Fields, and validators of fields, come in the order in which faults of one line are told.
    """

    model_config = ConfigDict(
        strict=True, extra="forbid", frozen=True, allow_inf_nan=False, hide_input_in_errors=True
    )

    @classmethod
    def mistaken(cls) -> tuple[str, frozenset[str]]:
        """Another kind of file that may be given by mistake, and keys that only it has."""
        return "", frozenset()

    @classmethod
    def synonyms(cls) -> Mapping[str, str]:
        """Keys of the table, by those of other tables that may be mistaken for them."""
        return {}

    @classmethod
    def key_faults(cls, values: Mapping[str, Any]) -> Iterator[tuple[str | Place, str]]:
        """Key, or place inside the table, and words of faults that are always told.

        That is even where entries of the table, here unchecked, have faults of their own.
        """
        return iter(())

    @classmethod
    def read(cls, values: Mapping[str, Any]) -> tuple[Self | None, list[tuple[Place, str]]]:
        """The table of a whole document, or None, and place and words of every fault.

        The document is the context of its tables' validators.
        """
        try:
            return cls.model_validate(values, context=values), []
        except ValidationError as error:
            details = error.errors(include_url=False)
            return None, [(found["loc"], found["ctx"]["words"]) for found in details]

    @classmethod
    def json_schema(cls) -> dict[str, Any]:
        """The JSON schema (draft 2020-12) of the file whose top table this is."""
        schema = cls.model_json_schema(schema_generator=_Schema)
        for table in schema["$defs"].values():
            del table["title"]  # It is the name of a class.
        return {"$schema": _Schema.schema_dialect, **schema}

    @model_validator(mode="wrap")
    @classmethod
    def _checked(cls, values: Any, handler: ModelWrapValidatorHandler[Self]) -> Self:
        faults: list[tuple[Place, str]] = []
        if isinstance(values, dict):
            for key, words in cls.key_faults(values):
                faults.append(((key,) if isinstance(key, str) else key, words))
        try:
            table = handler(values)
        except ValidationError as error:
            details = error.errors(include_url=False)
            if not faults and all(found["type"] == FAULT for found in details):
                raise  # What is in inner tables has been put into words there.
            unknown = sum(found["type"] == "extra_forbidden" for found in details)
            for found in details:
                place = found["loc"][:-1] if found["type"] == IN_NAME else found["loc"]
                faults.append((place, cls._words(found, unknown <= _MOST_SUGGESTIONS)))
        meant = {words.partition("; did you mean ")[2].rstrip("?") for _, words in faults}
        faults = [
            (place, words)  # A key that is misspelt is not missing as well.
            for place, words in faults
            if not (words.startswith("missing: ") and place[-1] in meant)
        ]
        if faults:
            raise refusal(faults)
        return table

    @classmethod
    def _words(cls, found: ErrorDetails, with_suggestion: bool) -> str:
        """What pydantic found, in words of this package.

        `with_suggestion`: whether to look for the key that an unknown one was meant to be.
        """
        kind, value = found["type"], found["input"]
        if "words" in found.get("ctx", {}):
            return str(found["ctx"]["words"])
        if kind == "extra_forbidden":
            return cls._unknown(str(found["loc"][-1]), with_suggestion)
        if kind == "missing":
            return f"missing: {cls.model_fields[str(found['loc'][-1])].description}"
        if kind == "literal_error":
            choices = get_args(cls.model_fields[str(found["loc"][-1])].annotation)
            if type(None) in choices:  # The key may be left out.
                choices = get_args(choices[0])
            return not_one_of(value, choices)
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        if kind == "finite_number" or (kind == "float_type" and is_number):
            return f"must be a finite number, not {shown(value)}"
        what = shown(value) if kind == "int_type" and is_number else kind_of(value)
        return f"must be {_NOUNS[kind]}, not {what}"

    @classmethod
    def _unknown(cls, key: str, with_suggestion: bool) -> str:
        known = list(cls.model_fields)
        near = [cls.synonyms()[key]] if key in cls.synonyms() else []
        if not near and with_suggestion and len(key) <= _LONGEST_KEY:
            near = difflib.get_close_matches(key, known, n=1)
        hint = f"did you mean {near[0]}?" if near else f"known keys: {', '.join(known)}"
        return f"unknown key; {hint}"


class _Schema(GenerateJsonSchema):
    """Schemas without what TOML has not, null, and without titles that repeat the keys."""

    def field_title_should_be_set(self, schema: object) -> bool:
        return False

    def nullable_schema(self, schema: core_schema.NullableSchema) -> JsonSchemaValue:
        return self.generate_inner(schema["schema"])

    def default_schema(self, schema: core_schema.WithDefaultSchema) -> JsonSchemaValue:
        found = super().default_schema(schema)
        return {key: value for key, value in found.items() if (key, value) != ("default", None)}

    def dict_schema(self, schema: core_schema.DictSchema) -> JsonSchemaValue:
        found = super().dict_schema(schema)
        if "patternProperties" in found:
            found["additionalProperties"] = False
        return found


@dataclass(frozen=True)
class Bounds:
    """Metadata of a number: its least and greatest value, and the unit and end of a message."""

    least: float = -math.inf
    most: float = math.inf
    unit: str = ""
    remedy: str = ""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
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


def list_of(value: object, length: int, what: str = "numbers") -> Any:
    """The value, if it is a list of so many `what`. Raises `PydanticCustomError` otherwise."""
    if not isinstance(value, list):
        raise fault(f"must be a list of {length} {what}, not {kind_of(value)}")
    if len(value) != length:
        raise fault(f"must have {length} {what}, not {len(value)}")
    return value


def listed(length: int, what: str = "numbers") -> BeforeValidator:
    """Metadata of a tuple that a file gives as a list of so many `what`."""
    return BeforeValidator(lambda value: tuple(list_of(value, length, what)))


def needed(is_right: Callable[[Any], bool], otherwise: str) -> AfterValidator:
    """Metadata of a value of the right type that must meet a condition.

    `otherwise` says what is wrong else, and what would be right.
    """

    def check(value: Any) -> Any:
        if not is_right(value):
            raise fault(otherwise)
        return value

    return AfterValidator(check)


@dataclass(frozen=True)
class Tables:
    """Metadata of the array of tables `key`: at most `most` of them, which are `what`.

    `form` says how to write them, if not as `[[key]]`.
    """

    key: str
    most: int
    what: str
    form: str = ""

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_before_validator_function(self._checked, handler(source))

    def __get_pydantic_json_schema__(self, schema: CoreSchema, handler: JsonHandler) -> Any:
        return handler(schema) | {"maxItems": self.most}

    def _checked(self, value: object) -> object:
        if not isinstance(value, list):
            form = self.form or f"an array of tables, [[{self.key}]]"
            raise fault(f"must be {form}, not {kind_of(value)}")
        return at_most(value, self.most, self.what)


def at_most(value: list[Any], most: int, what: str) -> list[Any]:
    """The list; its entries are looked at afterwards.

    Raises `PydanticCustomError` for more than `most` entries.
    """
    if len(value) > most:
        raise fault(f"{len(value)} {what}; give at most {most}")
    return value


def by_kind(*models: type[Table], default: str | None = None) -> WrapValidator:
    """Metadata of a table that is one of several, as its key `kind`, a literal in each, tells.

    `default` is the kind of a table without it; None where the key is required.
    """
    known = {get_args(model.model_fields["kind"].annotation)[0]: model for model in models}

    def choose(value: Any, _: object) -> Table:
        if not isinstance(value, dict):
            raise fault(f"must be a table, not {kind_of(value)}")
        kind = value.get("kind", default)
        if kind is None:
            raise refusal([(("kind",), f"missing; one of {', '.join(known)}")])
        if not isinstance(kind, str) or kind not in known:
            raise refusal([(("kind",), not_one_of(kind, known))])
        return known[kind].model_validate(value)

    return WrapValidator(choose)
