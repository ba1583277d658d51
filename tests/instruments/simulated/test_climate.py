from __future__ import annotations

import math
import time

import numpy as np
import pytest

from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chamber import ChamberParameters
from benchctl_instruments.simulated.climate import ClimateChamber
from benchctl_instruments.simulated.clock import Timebase, VirtualClock


def chamber() -> tuple[VirtualClock, Timebase, ClimateChamber]:
    clock = VirtualClock()
    timebase = Timebase(clock, 2000.0)
    return clock, timebase, ClimateChamber(timebase, ChamberParameters(), 20.0)


def test_a_command_is_acknowledged_at_once() -> None:
    _, _, climate = chamber()
    assert (climate.setpoint_c(), climate.running()) == (20.0, False)
    climate.set_setpoint(-40.0)
    climate.run(True)
    assert (climate.setpoint_c(), climate.running()) == (-40.0, True)


def test_the_air_follows_the_ramp_and_the_gyro_follows_the_air() -> None:
    clock, _, climate = chamber()
    climate.set_setpoint(80.0)
    climate.run(True)
    clock.sleep(1200.0)
    # 20 min at 2 °C/min behind a lag of 1 min
    assert climate.air_c() == pytest.approx(20.0 + 40.0 - 2.0, abs=1e-6)
    assert climate.power_percent() > 0.0
    clock.sleep(20_000.0)
    gyro = climate.gyro(np.array([clock.now()]))
    assert (climate.air_c(), gyro.housing_c[0], gyro.coil_c[0]) == pytest.approx((80.0, 80.0, 80.0), abs=1e-6)


def test_a_set_point_that_changes_on_the_way_is_followed_from_there() -> None:
    clock, _, climate = chamber()
    climate.run(True)
    climate.set_setpoint(80.0)
    clock.sleep(600.0)
    before = climate.air_c()
    climate.set_setpoint(0.0)
    assert climate.air_c() == before
    clock.sleep(600.0)
    # 20 °C up, 20 °C down, one lag of 1 min behind
    assert climate.air_c() == pytest.approx(20.0 + 2.0, abs=0.01)


def test_switched_off_the_chamber_keeps_its_set_point_and_drifts_to_the_room() -> None:
    clock, _, climate = chamber()
    climate.set_setpoint(60.0)
    climate.run(True)
    clock.sleep(10_000.0)
    climate.run(False)
    clock.sleep(1800.0)
    assert climate.setpoint_c() == 60.0
    assert climate.power_percent() == 0.0
    assert climate.air_c() == pytest.approx(20.0 + 40.0 * math.exp(-1.0), rel=1e-6)


def test_temperatures_do_not_depend_on_who_asks_when() -> None:
    asked, unasked = chamber(), chamber()
    for clock, _, climate in (asked, unasked):
        climate.run(True)
        climate.set_setpoint(-30.0)
        for _ in range(50):
            clock.sleep(7.3)
            if climate is asked[2]:
                climate.air_c()
                climate.gyro(np.array([clock.now() - 0.01, clock.now()]))
        climate.set_setpoint(10.0)
        clock.sleep(1000.0)
    times = asked[0].now() - np.array([30.0, 12.3, 0.0])
    np.testing.assert_array_equal(asked[2].gyro(times).coil_c, unasked[2].gyro(times).coil_c)


def test_thirty_hours_cost_milliseconds() -> None:
    clock, _, climate = chamber()
    climate.run(True)
    climate.set_setpoint(85.0)
    before = time.process_time()
    clock.sleep(30 * 3600.0)
    assert climate.air_c() == pytest.approx(85.0)
    assert time.process_time() - before < 0.05


def test_temperatures_that_were_not_held_are_forgotten_and_said_to_be() -> None:
    clock, _, climate = chamber()
    for _ in range(3):
        climate.run(True)
        clock.sleep(1000.0)
        climate.run(False)
        clock.sleep(1000.0)
    with pytest.raises(UsageError, match=r"temperatures at 5\.000 s are forgotten"):
        climate.gyro(np.array([5.0]))


@pytest.mark.parametrize("coil_is_housing", [False, True])
def test_the_coils_derivative_is_that_of_its_temperature(coil_is_housing: bool) -> None:
    clock = VirtualClock()
    parameters = ChamberParameters(self_heating_c=4.0)
    climate = ClimateChamber(Timebase(clock, 2000.0), parameters, 20.0, coil_is_housing=coil_is_housing)
    climate.set_setpoint(60.0)
    climate.run(True)
    clock.sleep(900.0)
    gyro = climate.gyro(np.array([299.0, 300.0, 301.0, 899.5]))
    assert (gyro.coil_c == gyro.housing_c).all() == coil_is_housing
    central = (gyro.coil_c[2] - gyro.coil_c[0]) / 2.0
    assert central > 1e-3
    assert gyro.coil_rate_c_per_s[1] == pytest.approx(central, rel=1e-4)


def test_the_set_point_has_a_way_while_the_chamber_ramps_to_it_and_none_once_it_is_there() -> None:
    clock, timebase, climate = chamber()
    timebase.held_since_s = 0.0
    climate.run(True)
    climate.set_setpoint(40.0)
    clock.sleep(1000.0)
    climate.set_setpoint(30.0)
    clock.sleep(100.0)
    # 20 °C at 2 °C/min, then back
    air_c, way = climate.air(np.array([10.0, 590.0, 620.0, 990.0, 1050.0]))
    assert way.tolist() == [1.0, 1.0, 0.0, 0.0, -1.0]
    assert air_c[3] == pytest.approx(40.0, abs=0.1)
