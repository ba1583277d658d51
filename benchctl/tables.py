"""Strict pydantic models for the tables of our TOML files: no unknown keys, and no conversion between value types."""

from __future__ import annotations

import datetime
from types import NoneType, UnionType
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel, ConfigDict, ValidationInfo, field_validator

from benchctl.limits import shown

_NUMBERS = frozenset({int, float})
_WORDS = {bool: "true or false", int: "an integer", float: "a number", datetime.date: "a date, as in 2027-01-31"}


class Table(BaseModel):
    """A table without unknown keys, with finite numbers; numbers, booleans, dates and strings are not converted."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, protected_namespaces=())

    @field_validator("*", mode="before")
    @classmethod
    def _as_written(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse `true` or `"2"` for a number and `1` for a boolean, all of which pydantic would convert."""
        expected = scalars(cls.model_fields[info.field_name].annotation) if info.field_name else frozenset()
        for item in value if isinstance(value, list | tuple) else (value,):
            if _is_another(item, expected):
                words = " or ".join(word for kind, word in _WORDS.items() if kind in expected)
                raise ValueError(f"expected {words}, got {shown(item)}")
        return value


def scalars(annotation: Any) -> frozenset[type]:
    """Return the scalar types that a field accepts according to its annotation, including those within a list."""
    origin = get_origin(annotation)
    if origin is Literal:
        return frozenset(type(choice) for choice in get_args(annotation))
    if origin is Annotated:
        return scalars(get_args(annotation)[0])
    if origin in (Union, UnionType, tuple):
        return frozenset().union(*(scalars(part) for part in get_args(annotation) if part is not Ellipsis))
    return frozenset({annotation}) if annotation in (*_WORDS, str) else frozenset()


def _is_another(item: object, expected: frozenset[type]) -> bool:
    if not expected or isinstance(item, NoneType):
        return False
    if isinstance(item, bool):
        return bool not in expected
    if isinstance(item, int | float):
        return not expected & (_NUMBERS | {str})  # pydantic itself refuses a number for a string
    return isinstance(item, str) and not expected & {str, datetime.date}
