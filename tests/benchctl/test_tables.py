import datetime
from typing import Any, Literal

import pytest
from pydantic import ValidationError

from benchctl.tables import Table, scalars


class _Example(Table):
    rate: float = 1.0
    count: int | None = None
    on: bool = False
    sign: Literal[1, -1] = 1
    word: Literal["stop", "hold"] = "stop"
    until: datetime.date | None = None
    numbers: tuple[float, ...] = ()


@pytest.mark.parametrize(
    ("field", "value", "says"),
    [
        ("rate", True, "expected a number, got True"),
        ("rate", "2", "expected a number, got '2'"),
        ("count", "2", "expected an integer, got '2'"),
        ("on", 1, "expected true or false, got 1"),
        ("on", "yes", "expected true or false, got 'yes'"),
        ("sign", True, "expected an integer, got True"),
        ("until", 20270131, "expected a date, as in 2027-01-31, got 20270131"),
        ("numbers", [1.0, "2"], "expected a number, got '2'"),
    ],
)
def test_no_kind_of_value_stands_for_another(field: str, value: Any, says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        _Example.model_validate({field: value})


def test_what_is_of_the_right_kind_is_taken() -> None:
    day = datetime.date(2027, 1, 31)
    taken = _Example.model_validate(
        {"rate": 3, "count": 4, "on": True, "sign": -1, "word": "hold", "until": day, "numbers": [1, 2.5]}
    )
    assert (taken.rate, taken.count, taken.numbers, taken.until) == (3.0, 4, (1.0, 2.5), day)
    assert _Example.model_validate({"until": "2027-01-31"}).until == day
    assert _Example.model_validate({"count": None}).count is None


def test_the_kinds_of_a_field_are_read_through_its_annotation() -> None:
    assert scalars(float | None) == {float}
    assert scalars(tuple[float, ...]) == {float}
    assert scalars(Literal["a", "b"]) == {str}
    assert scalars(dict[str, float]) == frozenset()
