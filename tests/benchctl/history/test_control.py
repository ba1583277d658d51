"""Control limits and the rule of runs."""

from __future__ import annotations

import pytest

from benchctl.history.flags import Control, control_of, outside, runs

FLOW_RATES = [49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1]
"""The worked example of the NIST/SEMATECH e-Handbook, 6.3.2.2."""


def test_the_limits_are_those_that_nist_prints_to_the_last_digit() -> None:
    control = control_of(FLOW_RATES)
    assert control is not None
    assert [f"{value:.4f}" for value in (control.low, control.centre, control.high)] == [
        "45.8159",
        "50.8100",
        "55.8041",
    ]
    assert outside(FLOW_RATES, control) == []


def test_fewer_than_eight_values_have_no_limits() -> None:
    assert control_of(FLOW_RATES[:7]) is None
    assert control_of(FLOW_RATES[:8]) is not None


def test_a_value_beyond_either_limit_is_found() -> None:
    control = Control(centre=0.0, low=-1.0, high=1.0)
    assert outside([0.0, 1.0, 1.1, -1.0, -1.1], control) == [2, 4]


@pytest.mark.parametrize("value", [0.1, -3.3e-7, 1.0e9 + 0.1, 0.0])
def test_equal_values_lie_on_their_limits_and_make_no_run(value: float) -> None:
    for count in range(8, 40):
        values = [value] * count
        control = control_of(values)
        assert control == Control(centre=value, low=value, high=value)
        assert outside(values, control) == []
        assert runs(values, control) == []


def test_eight_in_a_row_on_one_side_are_a_run_and_seven_are_none() -> None:
    control = Control(centre=0.0, low=-9.0, high=9.0)
    assert runs([1.0] * 7 + [-1.0] * 7, control) == []
    assert runs([-1.0] + [1.0] * 8 + [-1.0], control) == [(1, 8)]
    assert runs([1.0] * 9 + [-2.0] * 10, control) == [(0, 8), (9, 18)]
    assert runs([1.0] * 5 + [0.0] + [1.0] * 5, control) == []
