"""Play one step: reach its state, settle, record; every wait checks the limits and stop requests.

During an operator's step the table is at rest, confirmed by reading back, and the bench is still supervised. A hold
between two steps waits, with the table at rest, until the interlocks that demand it are off.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from benchctl.campaign.frames import FRAME_TEMPERATURE, NoFrames, PolledFrames, StepFrames, frame_channels, frames_of
from benchctl.campaign.interlocks import Change
from benchctl.campaign.opened import OpenBench
from benchctl.campaign.operator import HOME_QUESTION, Meanwhile, Operator
from benchctl.campaign.rest import wait_for_rest
from benchctl.campaign.safety import Supervisor, rest_s
from benchctl.campaign.soak import SOAK_CHANNELS, SoakWatch, one_poll
from benchctl.campaign.stop import StopRequest
from benchctl.campaign.stream import STREAM_CHANNELS, StreamRecorder
from benchctl.plan import Ask, ConstantRate, Home, Mount, PowerCycle, Sine, Soak, Static, Step, ThermalRamp
from benchctl.plan.steps import Polled
from benchctl.recordings.campaign_folder import CampaignWriter, StepWriter
from benchctl.recordings.model import StepInfo
from benchctl.recordings.step_writer import CLOSING_S_PER_SCAN
from benchctl_instruments.errors import InstrumentError, SafetyError, UsageError
from benchctl_instruments.interfaces import Homes, Position

Notify = Callable[[str], None]
Act = Callable[[Operator, Meanwhile], None]


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """Start and end of a step's data, in seconds since the start of the recording, and the number of gaps in them."""

    t_start: float
    t_end: float
    gaps: int = 0


@dataclass(slots=True)
class StepPlayer:
    """Plays the steps of one campaign, in order, into one writer; `notify` receives the current activity.

    `setpoint_c`, `gyro_c`, `streamed` and `gaps` are the current state: set point, thermistor, scans of this step so
    far and gaps in them; `frames` are those of the step's digital gyro. `position` is how the unit is mounted.
    `sample_rate_hz` is the scan rate last reported by the digitizer, before its first stream that of the bench.
    """

    opened: OpenBench
    writer: CampaignWriter
    supervisor: Supervisor
    stop: StopRequest
    notify: Notify
    setpoint_c: float
    gyro_c: float = math.nan
    streamed: int = 0
    gaps: int = 0
    position: Position = "along"
    frames: StepFrames = field(default_factory=NoFrames)
    sample_rate_hz: float = field(init=False)
    _torn: tuple[StepWriter, StepInfo] | None = None

    def __post_init__(self) -> None:
        self.sample_rate_hz = self.opened.bench.digitizer.sample_rate_hz

    def play(self, index: int, step: Step) -> StepInfo:
        """Play a step and return its final description; an interrupted step stays open until `close_torn`."""
        match step:
            case Soak():
                further = (FRAME_TEMPERATURE,) if self.opened.gyro else ()
                return self._record(index, step, (*SOAK_CHANNELS, *further), lambda into: self._soak(step, into))
            case PowerCycle():
                return self._record(index, step, SOAK_CHANNELS, lambda into: power_cycle(self, step, into))
            case Mount():
                return self._record(index, step, SOAK_CHANNELS, lambda into: mount(self, step, into))
            case Ask():
                return self._record(index, step, SOAK_CHANNELS, lambda into: ask(self, step, into))
            case Home():
                return self._record(index, step, SOAK_CHANNELS, lambda into: home(self, into))
            case Static():
                self.rest(step.settle_s)
            case ConstantRate():
                self._turn(step.rate_dps, step.settle_s)
            case Sine():
                self._swing(step.amplitude_dps, step.frequency_hz, 2.0 + step.settle_cycles / step.frequency_hz)
            case ThermalRamp() if step.swing_dps:
                self._swing(step.swing_dps, step.swing_hz, step.settle_s)
            case ThermalRamp():
                self._turn(step.rate_dps, step.settle_s)
        channels = (*STREAM_CHANNELS, *frame_channels(self.opened))
        return self._record(index, step, channels, lambda into: self._stream(step, into))

    def close_torn(self, aside: int | None = None) -> int:
        """Close the interrupted step, if there is one, marked as cut; return the number of its samples.

        This takes a while, because the file is rewritten: bring the bench to rest first. `aside` is the index under
        which the step is stored as an attempt that fits do not use, so that the step can be played again.
        """
        if self._torn is None:
            return 0
        into, info = self._torn
        self.frames.close()
        info = self.frames.counted(info)
        if aside is not None:
            info = replace(info, index=aside, name=f"cut attempt of step {info.index}: {info.name}", role="none")
        self.supervisor.guard.beat(more_s=(self.streamed + self.frames.written) * CLOSING_S_PER_SCAN)
        cut = into.cut(info)
        self._torn, self.streamed = None, 0
        if aside is not None:
            self.supervisor.event("cut", index=cut.index, name=cut.name, samples=cut.samples)
        return cut.samples

    def leave(self) -> None:
        """Bring the table to rest and end the stream of a step that is not played to its end."""
        self.supervisor.check_state()
        self.rest(0.0)
        self.opened.digitizer.stop_stream()

    def wait(self, seconds: float) -> None:
        """Wait for some bench time, checking the table and stop requests at least every chunk."""
        clock = self.opened.clock
        end_s = clock.now() + seconds
        while (left_s := end_s - clock.now()) > 0:
            clock.sleep(min(left_s, clock.chunk_s))
            self.stop.heed()
            self.supervisor.look_at_table()

    def _record(self, index: int, step: Step, channels: Sequence[str], act: Callable[[StepWriter], Span]) -> StepInfo:
        info = self._describe(index, step)
        into = self.writer.begin_step(info, channels)
        self.gaps, self.frames = 0, NoFrames()
        try:
            span = act(into)
        except BaseException:
            self._torn = into, replace(self._with_rate(info), t_end=self.now_s(), gaps=self.gaps)
            raise
        self.supervisor.guard.beat(more_s=(self.streamed + self.frames.written) * CLOSING_S_PER_SCAN)
        self.streamed = 0
        info = self.frames.counted(self._with_rate(info))
        return into.close(replace(info, t_start=span.t_start, t_end=span.t_end, gaps=span.gaps, whole=True))

    def _with_rate(self, info: StepInfo) -> StepInfo:
        """Return the description of a streamed step with the scan rate that the digitizer reported."""
        return replace(info, sample_rate_hz=self.sample_rate_hz) if info.sample_rate_hz else info

    def _describe(self, index: int, step: Step) -> StepInfo:
        now_s = self.now_s()
        setpoint_c = step.setpoint_c if isinstance(step, Soak) else self.setpoint_c
        streams = not isinstance(step, Polled)
        position = step.position if isinstance(step, Mount) else self.position
        mounting = "" if position == "along" else position
        rate_dps = step.rate_dps if isinstance(step, ConstantRate | ThermalRamp) else None
        amplitude_dps, frequency_hz = _swing_of(step)
        return StepInfo(
            index=index,
            name=_name_of(step, setpoint_c, mounting),
            kind=step.kind,
            role="none" if mounting or isinstance(step, Polled) else step.role,
            whole=False,
            t_start=now_s,
            t_end=now_s,
            chamber_setpoint_c=step.to_c if isinstance(step, ThermalRamp) else setpoint_c,
            rate_dps=rate_dps if amplitude_dps is None else None,
            amplitude_dps=amplitude_dps,
            frequency_hz=frequency_hz,
            mounting=mounting,
            sample_rate_hz=self.sample_rate_hz if streams else None,
            frame_rate_hz=gyro.frame_rate_hz if streams and (gyro := self.opened.bench.gyro) else None,
        )

    def now_s(self) -> float:
        """Return the bench time since the start of the recording [s]."""
        return self.opened.clock.now() - self.opened.epoch_s

    def _soak(self, step: Soak, into: StepWriter) -> Span:
        self.rest(0.0)
        self.notify("going to the set point")
        self.opened.chamber.go_to(step.setpoint_c)
        watch = SoakWatch(step, from_c=self.setpoint_c, begin_s=self.now_s(), limits=self.opened.bench.limits)
        self.setpoint_c = step.setpoint_c
        frames = PolledFrames(self.opened, self.supervisor)
        while not watch.done:
            self.wait(6 * self.opened.clock.chunk_s)
            self.supervisor.check_state()
            air = self.supervisor.look_at_chamber()
            gyro = self.supervisor.look_at_gyro()
            if air is None or gyro is None:
                continue
            self.gyro_c, gyro_v = gyro
            more = {"poll_gyro_temp_c": self.gyro_c, "poll_gyro_v": gyro_v, **frames.poll()}
            watch.see(self.now_s(), air.temperature_c, self.gyro_c if math.isnan(frames.last_c) else frames.last_c)
            into.append_point(one_poll(self.now_s(), air, more))
            self.notify(watch.state)
        return Span(t_start=watch.begin_s, t_end=self.now_s())

    def _stream(self, step: Step, into: StepWriter) -> Span:
        self.notify("recording")
        self.frames = frames_of(self.opened, self.supervisor, into)
        recorder = StreamRecorder(self.opened, self.supervisor, into, step)
        begin_s = self.opened.clock.now()
        self.sample_rate_hz = recorder.rate_hz
        while recorder.wants_more:
            if isinstance(step, ThermalRamp):
                self._ramp(step, self.opened.clock.now() - begin_s)
            self.opened.clock.sleep(recorder.next_chunk_s)
            recorder.take()
            self.frames.take(recorder)
            self.gyro_c, self.streamed, self.gaps = recorder.last_gyro_c, recorder.samples, recorder.gaps
            self.stop.heed()
            self.supervisor.check_state()
            self.supervisor.look_at_table()
            if (air := self.supervisor.look_at_chamber()) is not None:
                into.append_point(one_poll(self.now_s(), air, {}))
            self.notify("recording")
        recorder.refuse_few_samples()
        # After an error in the loop the table is stopped before the stream: `bring_to_rest` stops both.
        self.opened.digitizer.stop_stream()
        self.frames.finish(recorder)
        if isinstance(step, ThermalRamp):
            self.setpoint_c = step.to_c
        return Span(t_start=recorder.t_start, t_end=recorder.t_end, gaps=recorder.gaps)

    def _ramp(self, step: ThermalRamp, elapsed_s: float) -> None:
        moved_c = math.copysign(step.ramp_c_per_min * elapsed_s / 60.0, step.to_c - step.from_c)
        arrived = abs(moved_c) >= abs(step.to_c - step.from_c)
        # no controller has finer steps, and a residue of 1e-14 instead of 0 looks like swapped register words
        self.opened.chamber.go_to(step.to_c if arrived else round(step.from_c + moved_c, 3))

    def rest(self, settle_s: float) -> None:
        """Stop the table, wait until it is at rest, and let it settle."""
        self.notify("coming to rest")
        self.opened.table.stop()
        wait_for_rest(self.opened.table, self.opened.clock, rest_s(self.opened), self.supervisor.guard.beat)
        self.wait(settle_s)

    def _turn(self, rate_dps: float, settle_s: float) -> None:
        self.notify("spinning up")
        limits = self.opened.bench.limits
        self.opened.table.go_to_rate(rate_dps)
        by_hand = self.opened.bench.by_hand
        deadline_s = self.opened.clock.now() + 10.0 + 4 * limits.rate_dps / limits.acceleration_dps2
        tolerance_dps = limits.motion_tolerance_dps(rate_dps) if by_hand else max(0.05, 0.002 * abs(rate_dps))
        while abs(self.opened.table.read().rate_dps - rate_dps) > tolerance_dps:
            if self.opened.clock.now() > deadline_s:
                reading = self.opened.table.read()
                raise InstrumentError(
                    f"rate_table: commanded to turn at {rate_dps:+g} deg/s, but turns at {reading.rate_dps:+.3f} deg/s "
                    "long after it should have arrived; look for a limit or a brake at the controller"
                )
            self.wait(0.05)
        self.wait(settle_s)

    def _swing(self, amplitude_dps: float, frequency_hz: float, settle_s: float) -> None:
        self.rest(0.5)
        self.notify("swinging up")
        self.opened.table.oscillate(amplitude_dps, frequency_hz)
        self.wait(settle_s)


def _name_of(step: Step, setpoint_c: float, mounting: str) -> str:
    if isinstance(step, Mount | Ask):
        return step.label
    temperature = "" if isinstance(step, Soak) else f" at {setpoint_c:+g}"
    return f"{step.label}{temperature}{mounting and f', {mounting}'}"


def _swing_of(step: Step) -> tuple[float | None, float | None]:
    """Return peak rate and frequency of a step in which the table swings; None, None for other steps."""
    if isinstance(step, Sine):
        return step.amplitude_dps, step.frequency_hz
    if isinstance(step, ThermalRamp) and step.swing_dps:
        return step.swing_dps, step.swing_hz
    return None, None


_SETTLE_S = 1.0
"""Waiting time after somebody touched the unit on the table."""


def power_cycle(player: StepPlayer, step: PowerCycle, into: StepWriter) -> Span:
    """Have the supply switched off and on; the span lasts from off to on."""
    clock = player.opened.clock
    _rest_confirmed(player)
    await_operator(player, "supply off", lambda who, meanwhile: who.power(False, meanwhile))
    off_s, end_s, polled = player.now_s(), clock.now() + step.off_s, False
    while clock.now() < end_s or not polled:
        player.notify("supply off")
        left_s = end_s - clock.now()
        player.wait(min(left_s, 6 * clock.chunk_s) if left_s > 0 else clock.chunk_s)
        polled |= _poll(player, into)
    _have_switched_on(player)
    return Span(t_start=off_s, t_end=player.now_s())


def mount(player: StepPlayer, step: Mount, into: StepWriter) -> Span:
    """Have the unit mounted."""
    span = _operator_step(player, step.label, into, lambda who, meanwhile: who.mount(step.position, meanwhile))
    player.position = step.position
    return span


def ask(player: StepPlayer, step: Ask, into: StepWriter) -> Span:
    """Have the requested action performed."""
    return _operator_step(player, step.says, into, lambda who, meanwhile: who.ask(step.says, meanwhile))


def home(player: StepPlayer, into: StepWriter) -> Span:
    """Have the operator permit it, then turn the table to its home mark; the bench is supervised meanwhile."""
    table = player.opened.table
    if not isinstance(table, Homes):
        raise UsageError(f"rate_table: {player.opened.bench.rate_table.model} has no home; leave out the step Home")

    def homed(who: Operator, meanwhile: Meanwhile) -> None:
        who.ask(HOME_QUESTION, meanwhile)
        table.home(look)

    def look() -> None:
        player.notify("turning to the home mark")
        player.wait(player.opened.clock.chunk_s)
        player.supervisor.check_state()
        player.supervisor.look_at_chamber()

    return _operator_step(player, HOME_QUESTION, into, homed)


def switch_on(player: StepPlayer) -> None:
    """Have the supply switched on, or confirmed to be on, before a run goes on."""
    _rest_confirmed(player)
    _have_switched_on(player)


def _have_switched_on(player: StepPlayer) -> None:
    await_operator(player, "supply on", lambda who, meanwhile: who.power(True, meanwhile))


def _operator_step(player: StepPlayer, action: str, into: StepWriter, act: Act) -> Span:
    """Have an action performed while the table is at rest, then record one poll."""
    _rest_confirmed(player)
    begun_s = player.now_s()
    await_operator(player, action, act)
    _rest_confirmed(player)
    while not _poll(player, into):
        player.wait(player.opened.clock.chunk_s)
    return Span(t_start=begun_s, t_end=player.now_s())


def _rest_confirmed(player: StepPlayer) -> None:
    """Wait until the table is at rest, read back, with its servo on and without a fault."""
    player.supervisor.check_state()
    player.rest(_SETTLE_S)


def await_operator(player: StepPlayer, action: str, act: Act) -> None:
    """Have an operator perform an action; the bench is supervised while the operator is waited for."""
    opened, supervisor = player.opened, player.supervisor
    began_s, waits = opened.clock.now(), False

    def meanwhile() -> None:
        nonlocal waits
        if not waits:
            supervisor.event("waiting", says=action, by=opened.operator.who)
        waits = True
        # the table's state is not checked: opening the chamber's door may cut the servo off
        player.notify(f"waiting for {opened.operator.who}: {action}")
        player.wait(opened.clock.chunk_s)
        supervisor.look_at_chamber()

    act(opened.operator, meanwhile)
    supervisor.event("operator", says=action, by=opened.operator.who, waited_s=round(opened.clock.now() - began_s, 3))


def _poll(player: StepPlayer, into: StepWriter) -> bool:
    """Record the readings of the chamber and of the gyro's terminals; return whether both have answered.

    No interlock is checked against the gyro, because its output is not valid without supply.
    """
    opened, supervisor = player.opened, player.supervisor
    air, scan = supervisor.look_at_chamber(), supervisor.ask("digitizer", opened.digitizer.read_once)
    if air is None or scan is None:
        return False
    player.gyro_c = opened.bench.digitizer.gyro_celsius(scan.thermistor_v)
    into.append_point(one_poll(player.now_s(), air, {"poll_gyro_temp_c": player.gyro_c, "poll_gyro_v": scan.gyro_v}))
    return True


def hold_if_asked(player: StepPlayer) -> None:
    """Read everything that is measured; if an interlock demands a hold, wait until none does.

    A bench without such interlocks is not read, which takes no time.

    Raises
    ------
    SafetyError
        An interlock has demanded a hold for longer than its `give_up_s`, counted from the beginning of the wait.
    """
    interlocks = player.supervisor.interlocks
    if not interlocks.may_hold:
        return
    _look_at_all(player)
    if not interlocks.holds:
        return
    clock, event = player.opened.clock, player.supervisor.event
    event("hold", on=True, says=_reasons(interlocks.holds))
    player.rest(0.0)
    began_s = clock.now()
    while holds := interlocks.holds:
        player.notify(f"on hold, {_reasons(holds)}")
        for change in holds:
            waited_s = clock.now() - max(began_s, change.now_s)
            if waited_s > (change.interlock.give_up_s or 0.0):
                raise SafetyError(
                    f"on hold for {waited_s:.0f} s: {change.limit} ({change.value:.6g} at first), and it is not over; "
                    "find out why, then run again"
                )
        player.wait(2 * clock.chunk_s)
        _look_at_all(player)
    event("hold", on=False, waited_s=round(clock.now() - began_s, 3))


def _look_at_all(player: StepPlayer) -> None:
    supervisor = player.supervisor
    supervisor.check_state()
    supervisor.look_at_table()
    supervisor.look_at_chamber()
    if (gyro := supervisor.look_at_gyro()) is not None:
        player.gyro_c, _ = gyro


def _reasons(holds: list[Change]) -> str:
    return ", ".join(change.limit for change in holds)
