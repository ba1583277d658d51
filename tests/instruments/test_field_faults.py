"""What pydantic finds wrong, in the voice of all other messages."""

from typing import Annotated, Any, Literal

import pytest
from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator

from benchctl_instruments.field_faults import expectation, field_fault


class _Slow(BaseModel):
    kind: Literal["slow"]


class _Late(BaseModel):
    kind: Literal["late"]


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True, allow_inf_nan=False)

    rate: float = Field(default=1.0, gt=0)
    share: float = Field(default=1.0, ge=0, le=1)
    below: float = Field(default=0.0, lt=1)
    count: int = 1
    on: bool = True
    name: str = Field(default="x", min_length=1, max_length=3)
    sign: Literal[1, -1] = 1
    some: tuple[float, ...] = Field(default=(1.0,), min_length=1)
    more: dict[str, float] = {}
    fault: Annotated[_Slow | _Late, Field(discriminator="kind")] | None = None

    @field_validator("count")
    @classmethod
    def _even(cls, count: int) -> int:
        if count > 100:
            raise ValueError("expected at most a hundred")
        return count


def _said(**values: Any) -> str:
    with pytest.raises(ValidationError) as caught:
        _Table.model_validate(values)
    return field_fault(caught.value.errors(include_url=False, include_context=False)[0], repr)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"rate": "fast"}, "expected a number, got 'fast'"),
        ({"rate": 0.0}, "expected a number above 0, got 0.0"),
        ({"rate": float("inf")}, "expected a finite number, got inf"),
        ({"share": -0.5}, "expected a number of at least 0, got -0.5"),
        ({"share": 2.0}, "expected a number of at most 1, got 2.0"),
        ({"below": 1.0}, "expected a number below 1, got 1.0"),
        ({"count": 1.5}, "expected an integer, got 1.5"),
        ({"count": "1"}, "expected an integer, got '1'"),
        ({"count": 101}, "expected at most a hundred"),
        ({"on": "yes"}, "expected true or false, got 'yes'"),
        ({"name": 7}, "expected text, got 7"),
        ({"name": ""}, "expected text of at least 1 character, got ''"),
        ({"name": "long"}, "expected text of at most 3 characters, got 'long'"),
        ({"sign": 2}, "expected 1 or -1, got 2"),
        ({"some": ()}, "expected at least 1 item, got ()"),
        ({"some": 3.0}, "expected a list, got 3.0"),
        ({"more": []}, "expected a table, got []"),
        ({"fault": {"kind": "lat"}}, "expected kind to be one of 'slow', 'late', got 'lat'"),
        ({"fault": {}}, "kind is needed and is not there"),
        ({"colour": 1}, "there is no such field"),
        ({"fault": {"kind": "late"}, "nam": ""}, "there is no such field"),
    ],
)
def test_a_fault_is_said_as_what_was_expected_and_what_came(values: dict[str, Any], says: str) -> None:
    assert _said(**values) == says


def test_a_field_that_is_missing_is_said_to_be_needed() -> None:
    class Needs(BaseModel):
        rate: float

    with pytest.raises(ValidationError) as caught:
        Needs.model_validate({})
    assert field_fault(caught.value.errors()[0], repr) == "this field is needed and is not there"


def test_what_pydantic_may_say_in_future_is_passed_on_in_one_line_that_begins_small() -> None:
    assert expectation("Datetimes provided to this\nfield must have no zone.") == (
        "datetimes provided to this field must have no zone"
    )
