"""The faults of the simulated machines behind the instruments: what a sensor, a drive or a crystal may do.

An operation is one look at the machine or one demand; it reads as `air`, `set point -20`, `motion`, `sample`. Looks
come as often as somebody looks, so windows of bench time say best when such a fault happens.
"""

from __future__ import annotations

import math
from typing import ClassVar, Literal

from pydantic import Field

from benchctl_instruments.simulated.faults.tables import FaultTable, Place, Positive


class MachineFault(FaultTable):
    """A fault of a machine; once it has come it lasts `for_s` of bench time."""

    for_s: float = Field(default=math.inf, gt=0)


class StuckReading(MachineFault):
    """What is read stays what it was: air, motion, or all that is sampled. The machine itself goes on."""

    kind: Literal["stuck_reading"] = "stuck_reading"


class OverRange(MachineFault):
    """The sensor reads `reads`: °C of the chamber's air, or volts at one of the digitizer's terminals."""

    places: ClassVar[tuple[Place, ...]] = ("chamber", "digitizer")

    kind: Literal["over_range"] = "over_range"
    reads: float = Field(default=1000.0, allow_inf_nan=False)
    terminal: Literal["gyro", "thermistor"] = "thermistor"


class StallsShort(MachineFault):
    """The chamber comes to a halt `short_c` before every set point that is demanded meanwhile."""

    places: ClassVar[tuple[Place, ...]] = ("chamber",)

    kind: Literal["stalls_short"] = "stalls_short"
    short_c: Positive = 5.0


class VelocityTrip(MachineFault):
    """The drive's own tachometer reads `reads_dps`."""

    places: ClassVar[tuple[Place, ...]] = ("rate_table",)

    kind: Literal["velocity_trip"] = "velocity_trip"
    reads_dps: float = Field(default=1e4, allow_inf_nan=False)


class EncoderJump(MachineFault):
    """The encoder's count is off by `counts` from an instant on."""

    places: ClassVar[tuple[Place, ...]] = ("digitizer",)

    kind: Literal["encoder_jump"] = "encoder_jump"
    counts: int = 50_000


class ClockDrift(FaultTable):
    """The digitizer's crystal is fast by `ppm` (slow where it is below 0), all the time: the schedule is not asked."""

    places: ClassVar[tuple[Place, ...]] = ("digitizer",)

    kind: Literal["clock_drift"] = "clock_drift"
    ppm: float = Field(default=20.0, gt=-1e5, lt=1e5)


AnyMachineFault = StuckReading | OverRange | StallsShort | VelocityTrip | EncoderJump | ClockDrift
