"""A chamber without physics and a clock without time, for the tests of the controllers and their drivers."""

from __future__ import annotations


class FakeChamber:
    """A `ChamberMachine` whose air is whatever the test says."""

    def __init__(self) -> None:
        self.air = 23.0
        self.setpoint = 20.0
        self.power = 0.0
        self.on = False
        self.switched = 0

    def air_c(self) -> float:
        return self.air

    def setpoint_c(self) -> float:
        return self.setpoint

    def set_setpoint(self, setpoint_c: float) -> None:
        self.setpoint = setpoint_c

    def power_percent(self) -> float:
        return self.power

    def running(self) -> bool:
        return self.on

    def run(self, on: bool) -> None:
        self.on = on
        self.switched += 1


class InstantClock:
    """A `Clock` whose sleeps take no time and are counted."""

    chunk_s = 1.0

    def __init__(self) -> None:
        self.slept_s = 0.0

    def now(self) -> float:
        return self.slept_s

    def sleep(self, seconds: float) -> None:
        self.slept_s += seconds
