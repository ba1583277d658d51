from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
import scipy.integrate
from hypothesis import given
from hypothesis import strategies as st

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chamber import (
    ChamberParameters,
    ChamberState,
    advance,
    power_percent,
    settled,
    switched,
)

CHAMBER = ChamberParameters()
ROOM = 23.0
COLD = switched(replace(settled(CHAMBER, ROOM), setpoint_c=-40.0), True)


def temperatures(state: ChamberState) -> tuple[float, float, float, float]:
    return state.air_c, state.housing_c, state.coil_c, state.profile_c


def test_a_chamber_left_alone_stays_at_the_rooms_temperature() -> None:
    assert temperatures(advance(CHAMBER, ROOM, settled(CHAMBER, ROOM), 1e6)) == pytest.approx((ROOM,) * 4)


def test_behind_a_long_ramp_each_temperature_lags_by_the_sum_of_its_lags() -> None:
    hot = switched(replace(settled(CHAMBER, ROOM), setpoint_c=1e6), True)
    slope = CHAMBER.ramp_c_per_min / 60.0
    state = advance(CHAMBER, ROOM, hot, 50_000.0)
    assert state.profile_c == pytest.approx(ROOM + slope * 50_000.0)
    behind = [state.profile_c - value for value in (state.air_c, state.housing_c, state.coil_c)]
    assert behind == pytest.approx([slope * 60.0, slope * 660.0, slope * 960.0], rel=1e-9)


def test_switched_off_the_air_relaxes_to_the_room() -> None:
    state = replace(settled(CHAMBER, ROOM), air_c=85.0)
    for seconds in (0.0, 600.0, 7200.0):
        air = advance(CHAMBER, ROOM, state, seconds).air_c
        assert air == pytest.approx(ROOM + 62.0 * math.exp(-seconds / 1800.0))


def test_switched_on_the_profile_starts_from_the_air() -> None:
    state = switched(replace(settled(CHAMBER, ROOM), air_c=50.0, setpoint_c=20.0), True)
    assert state.profile_c == 50.0
    assert switched(replace(state, profile_c=40.0), True).profile_c == 40.0


@pytest.mark.parametrize(("running", "setpoint"), [(True, -40.0), (True, 85.0), (False, 85.0)])
def test_the_course_solves_the_three_lags(running: bool, setpoint: float) -> None:
    chamber = replace(CHAMBER, self_heating_c=1.5)
    start = ChamberState(air_c=30.0, housing_c=26.0, coil_c=24.0, profile_c=30.0, setpoint_c=setpoint, running=running)
    slope = math.copysign(chamber.ramp_c_per_min / 60.0, setpoint - 30.0)
    ramp_s = (setpoint - 30.0) / slope
    air_lag_s = 60.0 if running else 1800.0

    def derivative(t: float, state: npt.NDArray[np.float64]) -> list[float]:
        drive = 30.0 + slope * min(t, ramp_s) if running else ROOM
        air, housing, coil = state
        return [(drive - air) / air_lag_s, (air + 1.5 - housing) / 600.0, (housing - coil) / 300.0]

    end = 4000.0
    solved = scipy.integrate.solve_ivp(
        derivative, (0.0, end), [30.0, 26.0, 24.0], method="DOP853", rtol=1e-11, atol=1e-11, max_step=20.0
    )
    assert temperatures(advance(chamber, ROOM, start, end))[:3] == pytest.approx(tuple(solved.y[:, -1]), abs=1e-6)


def test_an_hour_at_once_is_an_hour_second_by_second() -> None:
    state = COLD
    for _ in range(3600):
        state = advance(CHAMBER, ROOM, state, 1.0)
    assert temperatures(state) == pytest.approx(temperatures(advance(CHAMBER, ROOM, COLD, 3600.0)), abs=1e-9)


@given(
    cuts=st.lists(st.floats(0.0, 5000.0), min_size=1, max_size=8),
    setpoint=st.floats(-70.0, 180.0),
    running=st.booleans(),
)
def test_it_does_not_matter_how_time_is_cut(cuts: list[float], setpoint: float, running: bool) -> None:
    start = replace(COLD, setpoint_c=setpoint, running=running, air_c=40.0, housing_c=35.0)
    state = start
    for seconds in cuts:
        state = advance(CHAMBER, ROOM, state, seconds)
    assert temperatures(state) == pytest.approx(temperatures(advance(CHAMBER, ROOM, start, sum(cuts))), abs=1e-9)


@given(setpoint=st.floats(-70.0, 180.0), seconds=st.floats(0.0, 7200.0))
def test_the_air_never_moves_faster_than_the_ramp_nor_beyond_the_set_point(setpoint: float, seconds: float) -> None:
    start = replace(COLD, setpoint_c=setpoint)
    here, later = (advance(CHAMBER, ROOM, start, at).air_c for at in (seconds, seconds + 1.0))
    assert abs(later - here) <= CHAMBER.ramp_c_per_min / 60.0 + 1e-9
    assert min(ROOM, setpoint) - 1e-9 <= later <= max(ROOM, setpoint) + 1e-9


def test_the_heater_works_with_the_sign_of_the_task_and_rests_when_off() -> None:
    hot = switched(replace(settled(CHAMBER, ROOM), setpoint_c=85.0), True)
    assert power_percent(CHAMBER, ROOM, advance(CHAMBER, ROOM, hot, 600.0)) > 0.0
    assert power_percent(CHAMBER, ROOM, advance(CHAMBER, ROOM, COLD, 600.0)) < 0.0
    held = power_percent(CHAMBER, ROOM, advance(CHAMBER, ROOM, hot, 20_000.0))
    assert held == pytest.approx(0.6 * 62.0, rel=1e-6)
    assert power_percent(CHAMBER, ROOM, switched(hot, False)) == 0.0
    assert power_percent(replace(CHAMBER, hold_percent_per_c=100.0), ROOM, advance(CHAMBER, ROOM, hot, 900.0)) == 100.0


@pytest.mark.parametrize("wrong", [{"ramp_c_per_min": 0.0}, {"air_lag_s": -1.0}, {"coil_lag_s": 600.0}])
def test_an_impossible_chamber_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(UsageError):
        ChamberParameters(**wrong)
