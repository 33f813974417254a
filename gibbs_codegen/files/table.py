"""Tables of a TOML file as pydantic models: every fault in this package's words, and the schema.

A subclass of `Table` says what a table may hold: a field for each key, with its type, bounds,
default and description. Faults, suggestions and the JSON schema for editors follow from that.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping
from typing import Any, Self, get_args

from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic.functional_validators import ModelWrapValidatorHandler
from pydantic.json_schema import GenerateJsonSchema, JsonSchemaValue
from pydantic_core import ErrorDetails, core_schema

from gibbs_codegen.files.faults import FAULT, IN_NAME, Place, kind_of, not_one_of, refusal, shown

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
