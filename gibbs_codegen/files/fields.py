"""Types of what a key of a file may hold, for the fields of tables."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, get_args

from pydantic import AfterValidator, BeforeValidator, GetCoreSchemaHandler, WrapValidator
from pydantic import GetJsonSchemaHandler as JsonHandler
from pydantic_core import CoreSchema, core_schema

from gibbs_codegen.files.faults import fault, kind_of, not_one_of, refusal, shown
from gibbs_codegen.files.table import Table


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
