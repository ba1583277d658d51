"""Numbers as events tell them."""

from __future__ import annotations

import math

import pytest

from benchctl.dashboard.data.run_state import number_of


@pytest.mark.parametrize("value", [None, "7", True, math.nan, math.inf, -math.inf, [], 10**400])
def test_what_is_no_number_that_can_be_shown_is_none(value: object) -> None:
    assert number_of(value) is None


def test_a_number_beyond_what_may_be_is_none() -> None:
    assert number_of(-11, 10.0) is None
    assert number_of(-10, 10.0) == -10.0
