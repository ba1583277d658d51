"""All tests of a gyro in one campaign."""

import math
from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import (
    POSITIVE,
    PowerCycle,
    Range,
    Sine,
    Soak,
    Static,
    Step,
    ThermalRamp,
    across,
    levels,
    procedure,
    rate_cycle,
    rates_between_zeros,
    set_points,
    slow_swing,
    small_steps,
    turn_ons,
    whole_cycles,
)


@procedure()
def acceptance(
    room_c: Annotated[float, "reference temperature, °C"] = 20.0,
    coldest_c: Annotated[float, "coldest set point, °C"] = -40.0,
    hottest_c: Annotated[float, "hottest set point, °C"] = 60.0,
    points: Annotated[int, "set points on the way up; on the way down all but the ends", Range(1, 1000)] = 6,
    soak_s: Annotated[float, "time at the set point, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    off_s: Annotated[float, "time without supply before a turn-on, s", POSITIVE] = 1800.0,
    warm_s: Annotated[float, "rest after a turn-on, s", POSITIVE] = 1800.0,
    cycles: Annotated[int, "turn-ons for repeatability", Range(1, 1000)] = 5,
    top_rate_dps: Annotated[float, "top of the sweep at room temperature, °/s", POSITIVE] = 170.0,
    sweep_rates: Annotated[int, "rates of that sweep, up and down, in both directions", Range(1, 1000)] = 17,
    rate_dps: Annotated[float, "top rate after turn-ons and at other temperatures, °/s", POSITIVE] = 50.0,
    rates: Annotated[int, "rates there, each in both directions; best such as the sweep has too", Range(1, 1000)] = 5,
    steps_dps: Annotated[tuple[float, ...], "small rates, and changes of a rate, °/s", POSITIVE] = (
        0.002,
        0.005,
        0.01,
        0.02,
        0.05,
    ),
    base_dps: Annotated[float, "rate about which its changes are small, °/s"] = 10.0,
    small_run_s: Annotated[float, "duration of a small rate, s", POSITIVE] = 60.0,
    swing_dps: Annotated[float, "peak rate of the slow swing through zero, °/s", POSITIVE] = 0.1,
    sine_dps: Annotated[float, "peak rate of the sines, °/s", POSITIVE] = 30.0,
    frequencies_hz: Annotated[tuple[float, ...], "sines, Hz", POSITIVE] = (0.5, 1.0, 2.0, 4.0, 8.0, 16.0),
    acceleration_dps2: Annotated[float, "highest acceleration of the sines, °/s²", POSITIVE] = 800.0,
    rest_s: Annotated[float, "the long rest, for stability and noise, s", POSITIVE] = 3600.0,
    ramp_c_per_min: Annotated[float, "ramps at rest up and down, °C/min; 0: none", Range(0)] = 1.0,
    mount_across: Annotated[bool, "remount the unit across the table's axis, by the operator"] = True,
    run_s: Annotated[float, "least duration of a run, s; whole revolutions, whole periods", POSITIVE] = 30.0,
    zero_s: Annotated[float, "duration of a zero reading, s", POSITIVE] = 60.0,
) -> Iterator[Step]:
    """All tests of a gyro in one campaign, for `benchctl accept`: tests of the cold unit first, remounting last."""
    yield Soak(setpoint_c=room_c, hold_s=soak_s)
    yield PowerCycle(off_s=off_s)
    yield Static(duration_s=warm_s, settle_s=0.0)
    yield from rate_cycle(levels(top_rate_dps, sweep_rates), at_least_s=run_s, zero_s=zero_s)
    yield from small_steps(0.0, steps_dps, run_s=small_run_s)
    yield from small_steps(base_dps, steps_dps, run_s=small_run_s)
    yield slow_swing(swing_dps, 0.01, cycles=2)
    for hz in frequencies_hz:
        amplitude_dps = min(sine_dps, acceleration_dps2 / (2 * math.pi * hz))
        yield Sine(amplitude_dps=amplitude_dps, frequency_hz=hz, cycles=whole_cycles(hz, run_s))
    yield Static(duration_s=rest_s)
    grid = levels(rate_dps, rates)
    yield from turn_ons(grid, cycles, off_s=off_s, warm_s=warm_s, at_least_s=run_s, zero_s=zero_s)
    upward = set_points(coldest_c, hottest_c, points)
    for setpoint_c in (*upward, *upward[-2:0:-1]):
        yield Soak(setpoint_c=setpoint_c, hold_s=soak_s)
        yield from rates_between_zeros(grid, at_least_s=run_s, zero_s=zero_s)
    yield Soak(setpoint_c=room_c, hold_s=soak_s)
    if ramp_c_per_min > 0:
        top_c = min(room_c + 20.0, hottest_c)
        yield ThermalRamp(from_c=room_c, to_c=top_c, ramp_c_per_min=ramp_c_per_min)
        yield Soak(setpoint_c=top_c, hold_s=soak_s)
        yield ThermalRamp(from_c=top_c, to_c=room_c, ramp_c_per_min=ramp_c_per_min)
        yield Soak(setpoint_c=room_c, hold_s=soak_s)
    if mount_across:
        yield from across(levels(top_rate_dps, rates), at_least_s=run_s, zero_s=zero_s)
