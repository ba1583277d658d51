"""Supervise a bench's limits, and bring the bench to rest, whatever ended the run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeVar

from benchctl.campaign.guard.keeper import Guard, NoGuard
from benchctl.campaign.interlocks import Interlocks, Range
from benchctl.campaign.opened import OpenBench
from benchctl.campaign.rest import rest_within_s, send_home, stop_table, wait_for_rest
from benchctl_instruments.errors import BenchError, InstrumentError, LinkError, SafetyError
from benchctl_instruments.interfaces import ChamberReading, TableReading, TableState

FIND_OUT = "find out why before the next run"
"""Advice after a limit was exceeded."""

RATE_MARGIN = 1.05
"""Factor by which a measured rate or acceleration may exceed its limit, for ripple and overshoot of the servo."""

AIR_MARGIN_C = 3.0
"""The air may exceed the limits by this much: a chamber overshoots when it arrives."""

_LOOK_FOR_MOTION_S = 1.0
"""Bench time in which a table that no program uses is found to be at rest."""

OPERATOR_CHUNKS = 240
"""Time for an operator to stop a manual table, in chunks of the clock: 120 s if bench time is wall time."""

Event = Callable[..., None]
Answer = TypeVar("Answer")


@dataclass(slots=True)
class Supervisor:
    """Reads the table and the chamber; raises `SafetyError` if a limit is exceeded or readings fail for too long.

    All readings go to the interlocks, and each look sends the guard a beat.
    """

    opened: OpenBench
    event: Event
    guard: Guard = field(default_factory=NoGuard)
    air: ChamberReading | None = None
    motion: TableReading | None = None
    interlocks: Interlocks = field(init=False)
    _silent_since_s: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.interlocks = Interlocks(self.opened.bench.interlocks)

    def look_at_table(self) -> TableReading | None:
        """Return the present motion, or the last known one while the table is briefly silent."""
        table, limits = self.opened.table, self.opened.bench.limits
        reading = self.ask("rate_table", table.read)
        if reading is None:
            return self.motion
        if abs(reading.rate_dps) > limits.rate_dps * RATE_MARGIN:
            raise SafetyError(
                f"rate_table: {reading.rate_dps:+.2f} deg/s measured, the bench's limit is {limits.rate_dps:g} deg/s; "
                f"{FIND_OUT}"
            )
        if abs(reading.acceleration_dps2) > limits.acceleration_dps2 * RATE_MARGIN:
            raise SafetyError(
                f"rate_table: {reading.acceleration_dps2:+.0f} deg/s² measured, "
                f"the bench's limit is {limits.acceleration_dps2:g} deg/s²; {FIND_OUT}"
            )
        self.motion = reading
        self.see(
            rate_dps=_one(reading.rate_dps),
            acceleration_dps2=_one(reading.acceleration_dps2),
            angle_deg=_one(reading.angle_deg),
        )
        return reading

    def look_at_chamber(self) -> ChamberReading | None:
        """Return the present reading of the air, or the last known one while the chamber is briefly silent."""
        limits = self.opened.bench.limits
        reading = self.ask("chamber", self.opened.chamber.read)
        if reading is None:
            return self.air
        if reading.alarms:
            raise SafetyError(f"chamber: alarm: {', '.join(reading.alarms)}; clear it at the controller")
        if not limits.coldest_c - AIR_MARGIN_C <= reading.temperature_c <= limits.hottest_c + AIR_MARGIN_C:
            raise SafetyError(
                f"chamber: air at {reading.temperature_c:.1f} °C, "
                f"the bench's limits are {limits.coldest_c:g} to {limits.hottest_c:g} °C; {FIND_OUT}"
            )
        self.air = reading
        self.see(
            air_c=_one(reading.temperature_c),
            setpoint_c=_one(reading.setpoint_c),
            setpoint_error_c=_one(reading.temperature_c - reading.setpoint_c),
            power_percent=_one(reading.power_percent),
        )
        return reading

    def look_at_gyro(self) -> tuple[float, float] | None:
        """Return the gyro's temperature [°C] and volts; None while the digitizer is silent. Fails while it streams."""
        scan = self.ask("digitizer", self.opened.digitizer.read_once)
        if scan is None:
            return None
        gyro_c = self.opened.bench.digitizer.gyro_celsius(scan.thermistor_v)
        self.see(gyro_c=_one(gyro_c), gyro_v=_one(scan.gyro_v))
        return gyro_c, scan.gyro_v

    def check_state(self) -> None:
        """Raise `SafetyError` if the table has a fault or its servo is off."""
        state = self.ask("rate_table", self.opened.table.state)
        if state in (TableState.FAULT, TableState.DISABLED):
            raise SafetyError(f"rate_table: {state.value}; find out why, then reset the interlock at the controller")

    def ask(self, name: str, question: Callable[[], Answer]) -> Answer | None:
        """Return the answer, or None while an instrument is briefly silent; `SafetyError` if this lasts too long."""
        self.guard.beat()
        if self.guard.lost:
            raise SafetyError(self.guard.lost)
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

    def see(self, **looks: Range) -> None:
        """Check quantities, named as in bench.toml, against the interlocks; `SafetyError` if one demands a stop."""
        changes = self.interlocks.see(self.opened.clock.now(), looks)
        for change in changes:
            self.event("interlock", says=change.limit, on=change.on, value=change.value, action=change.interlock.action)
        for change in changes:
            if change.on and change.interlock.action == "stop":
                raise SafetyError(f"interlock {change.limit}: {change.value:.6g} was measured; {FIND_OUT}")


@dataclass(frozen=True, slots=True, kw_only=True)
class SafeState:
    """What was read back after the bench was brought to rest; `problems` is empty if everything was confirmed.

    `remarks` are failures that leave it at rest, such as a chamber at its safe set point whose air is not known.
    """

    rate_dps: float | None
    chamber_setpoint_c: float | None
    problems: tuple[str, ...]
    remarks: tuple[str, ...] = ()

    @property
    def confirmed(self) -> bool:
        """Whether table and chamber were read back; a stream that could not be stopped moves nothing."""
        return self.rate_dps is not None and self.chamber_setpoint_c is not None


def refuse_bench_in_use(opened: OpenBench) -> None:
    """Raise an error if a real bench shows signs of use by another program; nothing is commanded.

    This detects a program on another machine, which no lock reaches: a moving table with its servo on, or a streaming
    digitizer, is controlled by it, or was left so. A simulated bench in this process has no other user.
    """
    if opened.bench.simulated:
        return
    if opened.table.state() not in (TableState.DISABLED, TableState.FAULT):
        try:
            wait_for_rest(opened.table, opened.clock, _LOOK_FOR_MOTION_S, lambda: None)
        except SafetyError as err:
            raise InstrumentError(
                f"rate_table: turns at {opened.table.read().rate_dps:+.3f} deg/s before this run has commanded "
                "anything: another program uses it, or it was left in motion; wait for its end, or stop it at its "
                "controller, then run again"
            ) from err
    opened.digitizer.read_once()  # refused while it streams


def bring_to_rest(opened: OpenBench, beat: Callable[[], None] = lambda: None) -> SafeState:
    """Stop the stream and the table, send the chamber to its safe set point, and read both back; never raises.

    A failure of one instrument does not keep the others from being brought to rest. A manual table is waited for last,
    because its operator needs time. `beat` is called meanwhile.
    """
    problems: list[str] = []
    remarks: list[str] = []
    safe_c = opened.bench.safe.chamber_c
    rate_dps = None

    def stopped() -> float:
        return stop_table(opened.table, opened.clock, rest_s(opened), beat)

    if opened.bench.by_hand:
        _guarded([], "rate_table", opened.table.stop)
    else:
        rate_dps = _guarded(problems, "rate_table", stopped)
    beat()
    setpoint_c = _guarded(problems, "chamber", lambda: send_home(opened.chamber, safe_c, remarks.append))
    beat()
    if opened.bench.by_hand:
        rate_dps = _guarded(problems, "rate_table", stopped)
    _guarded(problems, "digitizer", opened.digitizer.stop_stream)
    return SafeState(rate_dps=rate_dps, chamber_setpoint_c=setpoint_c, problems=tuple(problems), remarks=tuple(remarks))


def rest_s(opened: OpenBench) -> float:
    """Return the bench time [s] within which this bench's table comes to rest, or is stopped by its operator."""
    by_itself_s = rest_within_s(opened.bench.limits.rate_dps, opened.bench.limits.acceleration_dps2)
    return by_itself_s + (OPERATOR_CHUNKS * opened.clock.chunk_s if opened.bench.by_hand else 0.0)


def _one(value: float) -> Range:
    return value, value


def _guarded(problems: list[str], name: str, act: Callable[[], Answer]) -> Answer | None:
    try:
        try:
            return act()
        except LinkError:
            return act()  # one lost reply must not leave the bench in motion
    except Exception as err:
        # Any error: the other instruments are still brought to rest.
        problems.append(f"{name}: {str(err).removeprefix(f'{name}: ') if isinstance(err, BenchError) else repr(err)}")
        return None
