"""A fault as a table of bench.toml: its place, kind and time; and the counting of operations.

An operation is one action on a place: a request on a link, a packet of a stream, one read of a machine. The same
operations at the same bench times cause the same faults, for any client and speed.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar, Generic, Literal, TypeVar

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator


@dataclass(frozen=True, slots=True, kw_only=True)
class Fired:
    """One fault that happened: bench time [s], where ("chamber", "digitizer_stream", ...), its kind, the operation."""

    bench_s: float
    where: str
    kind: str
    operation: str


Place = Literal["rate_table", "chamber", "digitizer", "digitizer_stream", "gyro"]
"""A link, named after its instrument; the digitizer's stream has its own link, `gyro` is a digital gyro."""

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]

LASTS = Field(gt=0, title="For", description="How long it lasts.", examples=[0.5])
"""The `for_s` of the kinds of faults that have one."""


class FaultTable(BaseModel):
    """Fields common to all kinds of faults; `kind` identifies the kind.

    It happens at the operations for which all conditions hold. `pattern`: their text contains a match; it depends on
    the wire, see `benchctl_instruments.simulated.faults.wires`. `from_s`, `to_s`: from this bench time on, and before
    that one. The others count only these: the `nth`, from 1; every nth if it is `every`; the first of these in each
    interval of `every_s`, counted from `from_s`; at most `times` times.

    Examples
    --------
    In bench.toml, on a simulated bench: every 50th request to read the process value of a Watlow F4T is not answered.

        [[faults]]
        on = "chamber"
        kind = "silence"
        pattern = "^03 0b 04"
        every = 50
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)  # no "3" for 3, no true for 1

    places: ClassVar[tuple[Place, ...]] = ("rate_table", "chamber", "digitizer")

    on: Place = Field(description="The link, or the instrument at its end.", examples=["chamber"])
    kind: str = Field(description="What goes wrong.", examples=["silence"])
    pattern: str = Field(
        default="", description="A regular expression that the request must hold.", examples=["^03 0b 04"]
    )
    from_s: float = Field(
        default=0.0, ge=0, title="From", description="Bench time from which it may happen.", examples=[60.0]
    )
    to_s: float = Field(
        default=math.inf, gt=0, title="To", description="Bench time up to which it may happen.", examples=[120.0]
    )
    nth: int | None = Field(
        default=None, ge=1, description="It happens to this one only, counted from 1.", examples=[3]
    )
    every: int | None = Field(default=None, ge=1, description="It happens to every so many.", examples=[50])
    every_s: Positive | None = Field(
        default=None, title="Every", description="It happens once in so long (bench time).", examples=[30.0]
    )
    times: int | None = Field(default=None, ge=1, description="It happens so often at most.", examples=[5])

    @field_validator("pattern")
    @classmethod
    def _is_a_pattern(cls, value: str) -> str:
        try:
            re.compile(value)
        except re.error as err:
            raise ValueError(f"{value!r} is no regular expression: {err}") from err
        return value

    @model_validator(mode="after")
    def _can_happen(self) -> FaultTable:
        if self.on not in self.places:
            raise ValueError(f"{self.kind} happens on {' or '.join(self.places)}, not on {self.on}")
        if not self.from_s < self.to_s:
            raise ValueError(f"from_s ({self.from_s:g}) must be before to_s ({self.to_s:g})")
        return self


class Schedule:
    """Counts operations for one fault. Not thread-safe.

    Attributes
    ----------
    fired
        How often the fault has happened.
    """

    def __init__(self, when: FaultTable) -> None:
        self.fired = 0
        self._when = when
        self._pattern = re.compile(when.pattern)
        self._counted = 0
        self._stretch = -1  # the last interval in which the fault happened

    def fires(self, operation: str, now_s: float) -> bool:
        """Count an operation, given its text and the bench time; return whether the fault happens at it."""
        when = self._when
        if not when.from_s <= now_s < when.to_s or not self._pattern.search(operation):
            return False
        self._counted += 1
        if when.nth is not None and self._counted != when.nth:
            return False
        if when.every is not None and self._counted % when.every:
            return False
        if when.times is not None and self.fired >= when.times:
            return False
        if when.every_s is not None:
            stretch = math.floor((now_s - when.from_s) / when.every_s)
            if stretch <= self._stretch:
                return False
            self._stretch = stretch
        self.fired += 1
        return True


FaultT = TypeVar("FaultT", bound=FaultTable)


class PendingFaults(Generic[FaultT]):
    """The faults of one link; if several are due at one operation, the first one happens.

    Parameters
    ----------
    where
        The link's name in the log.
    faults
        In the order in which they are checked; every one counts every operation.
    log
        The log of faults that have happened.
    """

    def __init__(self, where: str, faults: Sequence[FaultT], log: list[Fired]) -> None:
        self._where, self._log = where, log
        self._faults = [(fault, Schedule(fault)) for fault in faults]

    def due(self, operation: str, now_s: float) -> FaultT | None:
        """Return the fault that happens at an operation, given its text and the bench time, or None."""
        due = [fault for fault, schedule in self._faults if schedule.fires(operation, now_s)]
        if not due:
            return None
        self._log.append(Fired(bench_s=now_s, where=self._where, kind=due[0].kind, operation=operation))
        return due[0]
