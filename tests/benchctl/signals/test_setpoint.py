"""The way of a chamber's set point is read off its air: when each ramp ends, whatever the air's lag."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest
import scipy.signal

from benchctl.recordings.model import StepInfo
from benchctl.signals.setpoint import way_of_setpoint

CORNERS = ((0.0, 20.0), (100.0, 20.0), (400.0, 50.0), (800.0, 50.0), (1100.0, 5.0), (1500.0, 5.0))
TIME_S = np.arange(0.0, 1500.0, 0.5)


def step(index: int, setpoint_c: float, t_start: float, t_end: float) -> StepInfo:
    return StepInfo(
        index=index, name="", kind="thermal_ramp", t_start=t_start, t_end=t_end, chamber_setpoint_c=setpoint_c
    )


STEPS = (step(0, 20.0, 0.0, 100.0), step(1, 50.0, 100.0, 800.0), step(2, 5.0, 800.0, 1500.0))


def air(lag_s: float) -> npt.NDArray[np.float64]:
    asked = np.interp(TIME_S, [at for at, _ in CORNERS], [celsius for _, celsius in CORNERS])
    share = -np.expm1(-0.5 / lag_s)
    lagging = scipy.signal.lfilter([share], [1.0, share - 1.0], asked - 20.0) + 20.0
    return np.asarray(lagging + np.random.default_rng(1).normal(0.0, 0.03, TIME_S.size))


@pytest.mark.parametrize("lag_s", [15.0, 60.0])
def test_it_rises_and_falls_as_long_as_each_ramp_takes(lag_s: float) -> None:
    way = way_of_setpoint(STEPS, TIME_S, air(lag_s))
    assert way is not None
    changes = TIME_S[1:][np.diff(way) != 0.0]
    assert changes.tolist() == pytest.approx([100.0, 400.0, 800.0, 1100.0], abs=1.5)
    assert [way[np.searchsorted(TIME_S, at)] for at in (50.0, 250.0, 600.0, 950.0)] == [0.0, 1.0, 0.0, -1.0]


def test_air_that_does_not_follow_the_set_point_tells_no_way() -> None:
    wandering = 20.0 + np.cumsum(np.random.default_rng(2).normal(0.0, 0.5, TIME_S.size))
    assert way_of_setpoint(STEPS, TIME_S, wandering) is None


def test_a_set_point_that_stands_has_no_way() -> None:
    assert way_of_setpoint(STEPS[:1], TIME_S, air(15.0)) is None
