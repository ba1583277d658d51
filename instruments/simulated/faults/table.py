"""A table machine with faults: a tachometer that is stuck, or reads far too much."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from benchctl_instruments.simulated.faults.log import FaultLog
from benchctl_instruments.simulated.faults.machine_kinds import MachineFault, StuckReading, VelocityTrip
from benchctl_instruments.simulated.faults.spells import spells
from benchctl_instruments.simulated.machines import TableMachine, TableMotion


class FaultyTable:
    """A `TableMachine` around another one, whose motion is measured wrong at times.

    Parameters
    ----------
    table
        The true one.
    faults
        What befalls it; those of other machines are none of its business.
    now
        Bench time.
    log
        Where to note what has happened.
    """

    def __init__(
        self, table: TableMachine, faults: Sequence[MachineFault], *, now: Callable[[], float], log: FaultLog
    ) -> None:
        self._table = table
        self._now = now
        self._stuck = spells("rate_table", faults, StuckReading, log)
        self._trips = spells("rate_table", faults, VelocityTrip, log)
        self._last = table.motion()

    def motion(self) -> TableMotion:
        """The motion as it is measured."""
        now_s = self._now()
        if not any(spell.lasts("motion", now_s) for spell in self._stuck):
            self._last = self._table.motion()
        for trip in self._trips:
            if trip.lasts("motion", now_s):
                return replace(self._last, rate_dps=trip.fault.reads_dps)
        return self._last

    def close_loop(self) -> None:
        """Servo on."""
        self._table.close_loop()

    def open_loop(self) -> None:
        """Servo off."""
        self._table.open_loop()

    def limits(self) -> tuple[float, float]:
        """Rate [deg/s] and acceleration [deg/s²] limits."""
        return self._table.limits()

    def set_limits(self, rate_dps: float, acceleration_dps2: float) -> None:
        """New limits."""
        self._table.set_limits(rate_dps, acceleration_dps2)

    def demand_rate(self, rate_dps: float) -> None:
        """Turn at a constant rate."""
        self._table.demand_rate(rate_dps)

    def demand_angle(self, angle_deg: float) -> None:
        """Go to an unwrapped angle."""
        self._table.demand_angle(angle_deg)

    def demand_sine(self, amplitude_deg: float, frequency_hz: float, phase_deg: float, slew_deg_per_s: float) -> None:
        """Oscillate about the present angle."""
        self._table.demand_sine(amplitude_deg, frequency_hz, phase_deg, slew_deg_per_s)
