"""A chamber machine with faults: air that reads wrong, a loop that stalls before its set point."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from benchctl_instruments.simulated.faults.log import FaultLog
from benchctl_instruments.simulated.faults.machine_kinds import MachineFault, OverRange, StallsShort, StuckReading
from benchctl_instruments.simulated.faults.spells import spells
from benchctl_instruments.simulated.machines import ChamberMachine


class FaultyChamber:
    """A `ChamberMachine` around another one.

    Parameters
    ----------
    chamber
        The true one.
    faults
        What befalls it; those of other machines are none of its business.
    now
        Bench time.
    log
        Where to note what has happened.
    """

    def __init__(
        self, chamber: ChamberMachine, faults: Sequence[MachineFault], *, now: Callable[[], float], log: FaultLog
    ) -> None:
        self._chamber = chamber
        self._now = now
        self._stuck = spells("chamber", faults, StuckReading, log)
        self._over = spells("chamber", faults, OverRange, log)
        self._stalls = spells("chamber", faults, StallsShort, log)
        self._last_c = chamber.air_c()
        self._demanded_c = chamber.setpoint_c()

    def air_c(self) -> float:
        """Air temperature, as its sensor has it."""
        now_s = self._now()
        for over in self._over:
            if over.lasts("air", now_s):
                return over.fault.reads
        if not any(spell.lasts("air", now_s) for spell in self._stuck):
            self._last_c = self._chamber.air_c()
        return self._last_c

    def setpoint_c(self) -> float:
        """The set point as demanded."""
        return self._demanded_c

    def set_setpoint(self, setpoint_c: float) -> None:
        """A new set point; one that stalls is followed only so far."""
        self._demanded_c = setpoint_c
        reached_c, air_c = setpoint_c, self._chamber.air_c()
        for stall in self._stalls:
            if stall.lasts(f"set point {setpoint_c:g}", self._now()):
                short_c = min(stall.fault.short_c, abs(setpoint_c - air_c))
                reached_c = setpoint_c - math.copysign(short_c, setpoint_c - air_c)
        self._chamber.set_setpoint(reached_c)

    def power_percent(self) -> float:
        """Heating (+) or cooling (-) power."""
        return self._chamber.power_percent()

    def running(self) -> bool:
        """Whether it conditions."""
        return self._chamber.running()

    def run(self, on: bool) -> None:
        """Conditioning on or off."""
        self._chamber.run(on)
