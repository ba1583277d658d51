"""One supervisor knows the limits; one function brings the bench to rest, whatever ended the run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from benchctl.campaign.opened import OpenBench
from instruments.errors import BenchError, LinkError, SafetyError
from instruments.interfaces import ChamberReading, TableReading, TableState

RATE_MARGIN = 1.05
"""A measured rate or acceleration may pass its limit by this factor: ripple and overshoot of the servo, not a fault."""

AIR_MARGIN_C = 3.0
"""The air may pass the limits by this much: a chamber overshoots when it arrives."""

AT_REST_DPS = 0.05
"""A table slower than this is at rest: its controller's reading has noise."""

Event = Callable[..., None]
Answer = TypeVar("Answer")


@dataclass(slots=True)
class Supervisor:
    """Looks at the table and the chamber, and raises `SafetyError` where a limit is passed or news stay out."""

    opened: OpenBench
    event: Event
    air: ChamberReading | None = None
    motion: TableReading | None = None
    _silent_since_s: dict[str, float] = field(default_factory=dict)

    def look_at_table(self) -> TableReading | None:
        """The motion now, or the last one known while the table is silent for a moment."""
        table, limits = self.opened.table, self.opened.bench.limits
        reading = self.ask("rate_table", table.read)
        if reading is None:
            return self.motion
        if abs(reading.rate_dps) > limits.rate_dps * RATE_MARGIN:
            raise SafetyError(
                f"rate_table: {reading.rate_dps:+.2f} deg/s measured, the bench's limit is {limits.rate_dps:g} deg/s"
            )
        if abs(reading.acceleration_dps2) > limits.acceleration_dps2 * RATE_MARGIN:
            raise SafetyError(
                f"rate_table: {reading.acceleration_dps2:+.0f} deg/s² measured, "
                f"the bench's limit is {limits.acceleration_dps2:g} deg/s²"
            )
        self.motion = reading
        return reading

    def look_at_chamber(self) -> ChamberReading | None:
        """The air now, or the last reading known while the chamber is silent for a moment."""
        limits = self.opened.bench.limits
        reading = self.ask("chamber", self.opened.chamber.read)
        if reading is None:
            return self.air
        if reading.alarms:
            raise SafetyError(f"chamber: alarm: {', '.join(reading.alarms)}; clear it at the controller")
        if not limits.coldest_c - AIR_MARGIN_C <= reading.temperature_c <= limits.hottest_c + AIR_MARGIN_C:
            raise SafetyError(
                f"chamber: air at {reading.temperature_c:.1f} °C, "
                f"the bench's limits are {limits.coldest_c:g} to {limits.hottest_c:g} °C"
            )
        self.air = reading
        return reading

    def check_state(self) -> None:
        """Raise `SafetyError` where the table has faulted or its servo is off."""
        state = self.ask("rate_table", self.opened.table.state)
        if state in (TableState.FAULT, TableState.DISABLED):
            raise SafetyError(f"rate_table: {state.value}: reset the interlock at the controller and look why")

    def ask(self, name: str, question: Callable[[], Answer]) -> Answer | None:
        """The answer, or None while an instrument is silent for a moment; after too long, a `SafetyError`."""
        now_s = self.opened.clock.now()
        try:
            answer = question()
        except LinkError as err:
            silent_s = now_s - self._silent_since_s.setdefault(name, now_s)
            if silent_s > self.opened.bench.limits.silence_s:
                raise SafetyError(f"{name}: no news for {silent_s:.0f} s: {err}") from err
            self.event("silence", instrument=name, says=str(err))
            return None
        self._silent_since_s.pop(name, None)
        return answer


@dataclass(frozen=True, slots=True, kw_only=True)
class SafeState:
    """What was read back once the bench was brought to rest; `problems` is empty where all of it was confirmed."""

    rate_dps: float | None
    chamber_setpoint_c: float | None
    problems: tuple[str, ...]


def bring_to_rest(opened: OpenBench) -> SafeState:
    """Stop the stream and the table, send the chamber to its safe set point, and read both back; never raises.

    One instrument's failure does not keep the others from being brought to rest.
    """
    problems: list[str] = []
    rate_dps = _guarded(problems, "rate_table", lambda: _stop_table(opened))
    setpoint_c = _guarded(problems, "chamber", lambda: _send_home(opened))
    _guarded(problems, "digitizer", opened.digitizer.stop_stream)
    return SafeState(rate_dps=rate_dps, chamber_setpoint_c=setpoint_c, problems=tuple(problems))


def wait_for_rest(opened: OpenBench) -> float:
    """Wait until the table has come to rest, and return the rate that was read.

    Raises
    ------
    SafetyError
        Where it still turns long after it should have stopped.
    """
    limits = opened.bench.limits
    deadline_s = opened.clock.now() + 5.0 + 4 * limits.rate_dps / limits.acceleration_dps2
    while abs(rate_dps := opened.table.read().rate_dps) > AT_REST_DPS:
        if opened.clock.now() > deadline_s:
            raise SafetyError(f"rate_table: should have come to rest, but still turns at {rate_dps:+.3f} deg/s")
        opened.clock.sleep(0.05)
    return rate_dps


def _stop_table(opened: OpenBench) -> float:
    if opened.table.state() not in (TableState.DISABLED, TableState.FAULT):
        opened.table.stop()
    return wait_for_rest(opened)  # a table whose servo is off is stopped by its controller, or runs out


def _send_home(opened: OpenBench) -> float:
    opened.chamber.go_to(opened.bench.safe.chamber_c)
    return opened.chamber.read().setpoint_c


def _guarded(problems: list[str], name: str, act: Callable[[], Answer]) -> Answer | None:
    try:
        try:
            return act()
        except LinkError:
            return act()  # one lost reply must not leave the bench in motion
    except Exception as err:
        # Whatever it is, the other instruments are brought to rest all the same.
        problems.append(f"{name}: {err if isinstance(err, BenchError) else repr(err)}")
        return None
