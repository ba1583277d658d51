"""What a driver is put through while faults befall it: a usual dialogue, whose results show what was lost."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from benchctl_instruments.errors import SafetyError
from benchctl_instruments.interfaces import Chamber, Digitizer, RateTable, TableLimits, TableState
from benchctl_instruments.simulated.bench import SimulatedBench

RATE_HZ, SLOW_HZ = 500.0, 4.0
STREAMED_S = 4.0
COUNTS_PER_DEG = 1000.0


class WrongError(AssertionError):
    """The driver told or did something that is not so, without an error."""


def put_chamber_through(chamber: Chamber, bench: SimulatedBench) -> int:
    """Identify, limit, start, cool, read, warm, stop; the number of scans lost is none, for a chamber."""
    truth = bench.world.chamber
    chamber.identify()
    chamber.set_limits(-40.0, 80.0)
    chamber.go_to(-20.0)
    chamber.start()
    bench.clock.sleep(600.0)
    reading = chamber.read()
    _expect("air", reading.temperature_c, truth.air_c(), 0.2)
    _expect("set point", reading.setpoint_c, -20.0, 0.06)
    _expect("set point", truth.setpoint_c(), -20.0, 0.06)
    _same("running", truth.running(), True)
    chamber.go_to(35.0)
    _expect("set point", chamber.read().setpoint_c, 35.0, 0.06)
    _expect("set point", truth.setpoint_c(), 35.0, 0.06)
    chamber.stop()
    _same("running", truth.running(), False)
    return 0


def put_table_through(table: RateTable, bench: SimulatedBench) -> int:
    """Identify, limit, enable, turn, stop, go to an angle, disable."""
    truth = bench.world.table
    for axis in getattr(bench.rate_table._controller, "_axes", ()):
        axis.homed = True  # as its operator left it: an Ensemble goes to no angle before
    table.identify()
    table.set_limits(TableLimits(rate_dps=100.0, acceleration_dps2=200.0))
    table.enable()
    table.go_to_rate(40.0)
    bench.clock.sleep(5.0)
    _expect("rate", table.read().rate_dps, 40.0, 0.2)
    _expect("true rate", truth.motion().rate_dps, 40.0, 0.2)
    _same("state", _watched(table), TableState.MOVING)
    table.stop()
    bench.clock.sleep(5.0)
    _expect("rate", table.read().rate_dps, 0.0, 0.05)
    _same("state", _watched(table), TableState.AT_REST)
    table.go_to_angle(10.0)
    bench.clock.sleep(30.0)
    angle_deg = table.read().angle_deg
    _expect("angle", math.remainder(angle_deg - 10.0, 360.0), 0.0, 0.1)
    table.disable()
    _same("state", table.state(), TableState.DISABLED)
    return 0


def put_digitizer_through(digitizer: Digitizer, bench: SimulatedBench) -> int:
    """Identify, read, stream while the table turns, stop, read; how many scans are missing from the stream."""
    truth, clock = bench.world.table, bench.clock
    truth.close_loop()
    truth.demand_rate(50.0)
    clock.sleep(2.0)
    digitizer.identify()
    _expect("gyro", digitizer.read_once().gyro_v, 2.5, 0.2)
    if not getattr(digitizer, "counts_encoder", True):
        return _put_slow_through(digitizer, bench)
    start = digitizer.start_stream(RATE_HZ)
    begin_s = clock.now()
    indices: list[int] = []
    counts: list[int] = []
    while not indices or indices[-1] < STREAMED_S * RATE_HZ:
        clock.sleep(0.5)
        due = int((clock.now() - begin_s) * RATE_HZ) - 128
        while (indices[-1] + 1 if indices else 0) < due:
            block = digitizer.read_stream(due - (indices[-1] + 1 if indices else 0), 0.5)
            indices += range(block.first_index, block.first_index + len(block.gyro_v))
            counts += block.encoder_count.tolist()
            _expect("gyro", float(block.gyro_v.mean()), 2.5, 0.2)
    digitizer.stop_stream()
    turned_deg = np.array(counts) / COUNTS_PER_DEG
    fitted = np.polynomial.Polynomial.fit(np.array(indices) / start.rate_hz, turned_deg, 1)
    _expect("rate from counts and indices", float(fitted.convert().coef[1]), 50.0, 0.1)
    _expect(
        "angle where nothing is missing",
        float(np.abs(fitted(np.array(indices) / start.rate_hz) - turned_deg).max()),
        0.0,
        0.2,
    )
    _expect("gyro", digitizer.read_once().gyro_v, 2.5, 0.2)
    return indices[-1] + 1 - len(indices)


def _put_slow_through(digitizer: Digitizer, bench: SimulatedBench) -> int:
    """Stream while the table turns at another rate after 4 s, stop, read; how many scans are missing."""
    start = digitizer.start_stream(SLOW_HZ)
    volts: dict[int, float] = {}
    for second in range(1, 9):
        bench.clock.sleep(1.0)
        block = digitizer.read_stream(1, 2.0)
        volts |= {block.first_index + index: float(volt) for index, volt in enumerate(block.gyro_v)}
        if second == 4:
            bench.world.table.demand_rate(-50.0)
            bench.clock.sleep(1.0)
    digitizer.stop_stream()
    _expect("rate", start.rate_hz, SLOW_HZ, 1e-9)
    for index, volt in volts.items():
        if not 4.0 <= index / SLOW_HZ <= 5.0 + 2.0:  # it turned round, and a driver that repeats takes its time
            _expect(f"gyro in scan {index}", volt, 2.5 if index / SLOW_HZ < 4.0 else -2.5, 0.2)
    _expect("gyro", digitizer.read_once().gyro_v, -2.5, 0.2)
    return max(volts) + 1 - len(volts)


PUT_THROUGH: dict[str, Any] = {
    "chamber": put_chamber_through,
    "rate_table": put_table_through,
    "digitizer": put_digitizer_through,
}


def _watched(table: RateTable) -> TableState:
    """The state; one that ends a campaign is an error, as the campaign's supervisor makes it one."""
    state = table.state()
    if state in (TableState.FAULT, TableState.DISABLED):
        raise SafetyError(f"rate_table: {state.value}; find out why, then reset the interlock at the controller")
    return state


def _expect(what: str, got: float, wanted: float, tolerance: float) -> None:
    if not abs(got - wanted) <= tolerance:
        raise WrongError(f"{what}: {got:g} and not {wanted:g}")


def _same(what: str, got: object, wanted: object) -> None:
    if got != wanted:
        raise WrongError(f"{what}: {got} and not {wanted}")
