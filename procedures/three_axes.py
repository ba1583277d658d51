"""Scale factors, misalignment and biases of a unit of three axes, after Ferraris, Grimaldi and Parvis (1995)."""

from collections.abc import Iterator
from typing import Annotated

from benchctl.plan import POSITIVE, Range, Soak, Step, axis_mounts, levels, procedure, rates_between_zeros


@procedure(calibrates=True)
def three_axes(
    set_points_c: Annotated[tuple[float, ...], "chamber in every position, °C"] = (20.0,),
    soak_s: Annotated[float, "time at a set point, s; longer while the gyro still drifts", Range(0)] = 4800.0,
    rate_dps: Annotated[float, "highest rate, °/s", POSITIVE] = 100.0,
    rates: Annotated[int, "rates, evenly spaced, each in both directions", Range(1, 1000)] = 3,
    run_s: Annotated[float, "least duration of a run, s; whole revolutions", POSITIVE] = 30.0,
    zero_s: Annotated[float, "duration of a zero reading, s", POSITIVE] = 60.0,
    opposite: Annotated[bool, "each axis also down"] = True,
) -> Iterator[Step]:
    """Three axes: the operator turns the unit so that each axis is up or down; rates both ways between zero readings.

    `benchctl fit` computes the matrix of scale factors and misalignment, the biases and, with several set points, their
    dependence on temperature. The bench needs a digital gyro with `axes = 3`.
    """
    for mount in axis_mounts(opposite=opposite):
        yield mount
        for setpoint_c in set_points_c:
            yield Soak(setpoint_c=setpoint_c, hold_s=soak_s)
            yield from rates_between_zeros(levels(rate_dps, rates), at_least_s=run_s, zero_s=zero_s)
