"""The faults of the simulated machines (sensor, drive, crystal), and machines with these faults.

An operation is one read of the machine or one demand; its text is `air`, `set point -20`, `motion`, `sample`. The
number of reads depends on the client, so windows of bench time are the best way to schedule such a fault.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from typing import Annotated, ClassVar, Generic, Literal, TypeVar

import numpy as np
from pydantic import Field

from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.simulated.faults.schedule import LASTS, FaultTable, Fired, Place, Positive, Schedule
from benchctl_instruments.simulated.machines import AnalogInputs, ChamberMachine, TableMachine, TableMotion


class MachineFault(FaultTable):
    """A fault of a machine; once it has begun it lasts `for_s` of bench time."""

    for_s: Annotated[float, LASTS] = math.inf


class StuckReading(MachineFault):
    """Readings are frozen: air, motion, or all that is sampled. The machine itself continues."""

    kind: Literal["stuck_reading"] = "stuck_reading"


class OverRange(MachineFault):
    """The sensor reads `reads`: °C of the chamber's air, or volts at one of the digitizer's terminals."""

    places: ClassVar[tuple[Place, ...]] = ("chamber", "digitizer")

    kind: Literal["over_range"] = "over_range"
    reads: float = Field(default=1000.0, allow_inf_nan=False, description="°C of the air, or volts at a terminal.")
    terminal: Literal["gyro", "thermistor"] = Field(default="thermistor", description="Of the digitizer.")


class StallsShort(MachineFault):
    """The chamber stops `short_c` before every set point demanded during the fault."""

    places: ClassVar[tuple[Place, ...]] = ("chamber",)

    kind: Literal["stalls_short"] = "stalls_short"
    short_c: Positive = Field(
        default=5.0, title="Short", description="How far before the set point it comes to a halt."
    )


class VelocityTrip(MachineFault):
    """The drive's own tachometer reads `reads_dps`."""

    places: ClassVar[tuple[Place, ...]] = ("rate_table",)

    kind: Literal["velocity_trip"] = "velocity_trip"
    reads_dps: float = Field(default=1e4, allow_inf_nan=False, title="Reads", description="What the tachometer reads.")


class EncoderJump(MachineFault):
    """The encoder's count is off by `counts` from an instant on."""

    places: ClassVar[tuple[Place, ...]] = ("digitizer",)

    kind: Literal["encoder_jump"] = "encoder_jump"
    counts: int = Field(default=50_000, description="By how much the count is off.")


class ClockDrift(FaultTable):
    """The digitizer's crystal is fast by `ppm` (slow if negative), all the time, independent of the schedule."""

    places: ClassVar[tuple[Place, ...]] = ("digitizer",)

    kind: Literal["clock_drift"] = "clock_drift"
    ppm: float = Field(default=20.0, gt=-1e5, lt=1e5, title="Drift", description="How much too fast the crystal is.")


AnyMachineFault = StuckReading | OverRange | StallsShort | VelocityTrip | EncoderJump | ClockDrift


FaultT = TypeVar("FaultT", bound=MachineFault)


class Spell(Generic[FaultT]):
    """One fault of one machine. Thread-safe.

    Parameters
    ----------
    where
        The instrument's name in the log.
    fault
        The fault and its schedule.
    log
        The log of faults that have happened.

    Attributes
    ----------
    since_s
        Bench time of its last beginning: the start of its window if that is between two reads, otherwise that of a
        read.
    """

    def __init__(self, where: str, fault: FaultT, log: list[Fired]) -> None:
        self.fault = fault
        self.since_s = math.inf
        self._where = where
        self._schedule = Schedule(fault)
        self._log = log
        self._until_s = self._looked_s = -math.inf
        self._lock = threading.Lock()

    def lasts(self, operation: str, now_s: float) -> bool:
        """Count an operation on the machine at a bench time; return whether the fault is active."""
        with self._lock:
            if now_s >= self._until_s and self._schedule.fires(operation, now_s):
                self.since_s = self.fault.from_s if self._looked_s < self.fault.from_s else now_s
                self._until_s = now_s + self.fault.for_s
                fired = Fired(bench_s=now_s, where=self._where, kind=self.fault.kind, operation=operation)
                self._log.append(fired)
            self._looked_s = now_s
            return now_s < self._until_s


def spells(where: str, faults: Iterable[object], kind: type[FaultT], log: list[Fired]) -> list[Spell[FaultT]]:
    """Return those of a machine's faults that are of one kind."""
    return [Spell(where, fault, log) for fault in faults if isinstance(fault, kind)]


Samples = tuple[IntArray, FloatArray, FloatArray]


class FaultyInputs:
    """An `AnalogInputs` with faults around another one.

    A fault of the terminals that begins with its window begins at the scan of that instant, so that samples do not
    depend on how many scans are sampled together. If the crystal drifts, every time of this class is the digitizer's
    own: fast by `ppm` since bench time 0.

    Parameters
    ----------
    inputs
        The true ones.
    faults
        Their faults; those of other machines are ignored.
    log
        The log of faults that have happened.
    """

    def __init__(self, inputs: AnalogInputs, faults: Sequence[MachineFault | ClockDrift], *, log: list[Fired]) -> None:
        self._inputs = inputs
        self._pace = 1.0 + 1e-6 * sum(fault.ppm for fault in faults if isinstance(fault, ClockDrift))
        self._stuck = spells("digitizer", faults, StuckReading, log)
        self._over = spells("digitizer", faults, OverRange, log)
        self._jumps = spells("digitizer", faults, EncoderJump, log)
        self._before: tuple[int, float, float] | None = None  # the scan before this block

    def now(self) -> float:
        """Return the present instant, by the digitizer's crystal."""
        return self._inputs.now() * self._pace

    def wait_until(self, bench_time_s: float, timeout_s: float) -> bool:
        """Block until an instant by the digitizer's crystal is reached."""
        return self._inputs.wait_until(bench_time_s / self._pace, timeout_s)

    def hold_history(self, since_s: float | None) -> None:
        """Keep the motion since an instant by the digitizer's crystal."""
        self._inputs.hold_history(None if since_s is None else since_s / self._pace)

    def sample(self, first_s: float, interval_s: float, scans: int, *, start: int = 0) -> Samples:
        """Return count, gyro volts and thermistor volts, each of shape (scans,)."""
        samples = self._inputs.sample(first_s / self._pace, interval_s / self._pace, scans, start=start)
        times_s = first_s + interval_s * np.arange(start, start + scans, dtype=np.float64)
        self._jump(samples, times_s)
        self._go_over_range(samples, times_s)
        self._stick(samples, times_s)
        self._before = int(samples[0][-1]), float(samples[1][-1]), float(samples[2][-1])
        return samples

    def _jump(self, samples: Samples, times_s: FloatArray) -> None:
        for jump in self._jumps:
            if jump.lasts("sample", float(times_s[-1])):
                samples[0][times_s >= jump.since_s] += jump.fault.counts

    def _go_over_range(self, samples: Samples, times_s: FloatArray) -> None:
        for over in self._over:
            if over.lasts("sample", float(times_s[-1])):
                column = samples[1] if over.fault.terminal == "gyro" else samples[2]
                column[times_s >= over.since_s] = over.fault.reads

    def _stick(self, samples: Samples, times_s: FloatArray) -> None:
        for stuck in self._stuck:
            if stuck.lasts("sample", float(times_s[-1])):
                first = int(np.searchsorted(times_s, stuck.since_s))
                kept = self._before if first == 0 else tuple(column[first - 1].item() for column in samples)
                for column, value in zip(samples, kept or tuple(c[0].item() for c in samples), strict=True):
                    column[first:] = value


class FaultyChamber:
    """A `ChamberMachine` with faults around another one; parameters as for `FaultyInputs`, and `now`: bench time."""

    def __init__(
        self, chamber: ChamberMachine, faults: Sequence[MachineFault], *, now: Callable[[], float], log: list[Fired]
    ) -> None:
        self._chamber = chamber
        self._now = now
        self._stuck = spells("chamber", faults, StuckReading, log)
        self._over = spells("chamber", faults, OverRange, log)
        self._stalls = spells("chamber", faults, StallsShort, log)
        self._last_c = chamber.air_c()
        self._demanded_c = chamber.setpoint_c()
        self.power_percent, self.running, self.run = chamber.power_percent, chamber.running, chamber.run

    def air_c(self) -> float:
        """Return the air temperature, as its sensor reads it."""
        now_s = self._now()
        for over in self._over:
            if over.lasts("air", now_s):
                return over.fault.reads
        if not any(spell.lasts("air", now_s) for spell in self._stuck):
            self._last_c = self._chamber.air_c()
        return self._last_c

    def setpoint_c(self) -> float:
        """Return the set point as demanded."""
        return self._demanded_c

    def set_setpoint(self, setpoint_c: float) -> None:
        """Set a new set point; a stalling chamber follows it only partly."""
        self._demanded_c = setpoint_c
        reached_c, air_c = setpoint_c, self._chamber.air_c()
        for stall in self._stalls:
            if stall.lasts(f"set point {setpoint_c:g}", self._now()):
                short_c = min(stall.fault.short_c, abs(setpoint_c - air_c))
                reached_c = setpoint_c - math.copysign(short_c, setpoint_c - air_c)
        self._chamber.set_setpoint(reached_c)


class FaultyTable:
    """A `TableMachine` around another one, with faults of the measured motion; parameters as for `FaultyChamber`."""

    def __init__(
        self, table: TableMachine, faults: Sequence[MachineFault], *, now: Callable[[], float], log: list[Fired]
    ) -> None:
        self._table = table
        self._now = now
        self._stuck = spells("rate_table", faults, StuckReading, log)
        self._trips = spells("rate_table", faults, VelocityTrip, log)
        self._last = table.motion()
        self.close_loop, self.open_loop = table.close_loop, table.open_loop
        self.limits, self.set_limits = table.limits, table.set_limits
        self.demand_rate, self.demand_angle, self.demand_sine = table.demand_rate, table.demand_angle, table.demand_sine

    def motion(self) -> TableMotion:
        """Return the measured motion."""
        now_s = self._now()
        if not any(spell.lasts("motion", now_s) for spell in self._stuck):
            self._last = self._table.motion()
        for trip in self._trips:
            if trip.lasts("motion", now_s):
                return replace(self._last, rate_dps=trip.fault.reads_dps)
        return self._last
