from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl_instruments.errors import UsageError
from benchctl_instruments.interfaces import TableLimits
from benchctl_instruments.rate_tables.constant_rate_table import KeptLimits, short_way_deg, wait_until
from tests.instruments.table_machine import CountedClock


@pytest.fixture
def limits() -> KeptLimits:
    return KeptLimits("rate table at x")


def test_nothing_moves_before_limits_are_known_but_standing_still_is_allowed(limits: KeptLimits) -> None:
    limits.check_rate(0.0)
    with pytest.raises(UsageError, match=r"at x: commanded to move before its limits were set.*set_limits\(\)"):
        limits.check_rate(0.1)
    with pytest.raises(UsageError, match="before its limits were set"):
        limits.known()


def test_rates_up_to_the_limit_pass_in_both_directions_and_none_beyond(limits: KeptLimits) -> None:
    limits.keep(TableLimits(rate_dps=300.0, acceleration_dps2=500.0))
    limits.check_rate(300.0)
    limits.check_rate(-300.0)
    with pytest.raises(UsageError, match=r"commanded -300.1 deg/s, the limit that was set is 300 deg/s"):
        limits.check_rate(-300.1)


@pytest.mark.parametrize("bad", [math.nan, math.inf, 0.0, -1.0])
def test_limits_that_mean_nothing_are_refused_and_the_old_ones_stay(limits: KeptLimits, bad: float) -> None:
    good = TableLimits(rate_dps=300.0, acceleration_dps2=500.0)
    limits.keep(good)
    for wrong in (TableLimits(rate_dps=bad, acceleration_dps2=1.0), TableLimits(rate_dps=1.0, acceleration_dps2=bad)):
        with pytest.raises(UsageError, match="expected a finite number above 0"):
            limits.keep(wrong)
    assert limits.known() == good


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_rate_that_is_no_number_is_refused(limits: KeptLimits, bad: float) -> None:
    with pytest.raises(UsageError, match="expected a finite number"):
        limits.check_rate(bad)


def test_a_stop_is_given_the_time_that_the_limits_allow_it(limits: KeptLimits) -> None:
    assert limits.longest_stop_s() == 30.0
    limits.keep(TableLimits(rate_dps=300.0, acceleration_dps2=100.0))
    assert 3.0 < limits.longest_stop_s() < 10.0


@given(st.floats(-1e5, 1e5), st.floats(-1e5, 1e5))
def test_the_short_way_is_at_most_half_a_turn_and_leads_there(from_deg: float, to_deg: float) -> None:
    way_deg = short_way_deg(from_deg, to_deg)
    assert -180.0 <= way_deg <= 180.0
    assert math.remainder(from_deg + way_deg - to_deg, 360.0) == pytest.approx(0.0, abs=1e-6)


def test_waiting_ends_with_what_is_waited_for_or_with_the_time() -> None:
    clock = CountedClock()
    assert wait_until(clock, lambda: clock.now() >= 0.3, 1.0)
    assert clock.now() == pytest.approx(0.3, abs=0.06)
    assert not wait_until(clock, lambda: False, 1.0)
    assert clock.now() == pytest.approx(1.3, abs=0.16)
