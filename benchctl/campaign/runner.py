"""Run a plan: play its steps, bring the bench to rest in any case, close the recording with its true status."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Protocol

from benchctl.campaign.check import as_event, expiring, refuse_problems
from benchctl.campaign.differences import refuse_other_instruments
from benchctl.campaign.guard.keeper import Guard, NoGuard
from benchctl.campaign.opened import OpenBench
from benchctl.campaign.operator import require_operator, say, turn_question
from benchctl.campaign.page_operator import PageOperator
from benchctl.campaign.play import StepPlayer, await_operator, hold_if_asked, switch_on
from benchctl.campaign.provenance import describe, software
from benchctl.campaign.rest import AT_REST_DPS
from benchctl.campaign.resume import Past, soak_before, steps_to_play, whole_steps
from benchctl.campaign.safety import SafeState, Supervisor, bring_to_rest, refuse_bench_in_use
from benchctl.campaign.stop import StoppedError, StopRequest
from benchctl.campaign.stream import StepError
from benchctl.campaign.timing import plan_events, timeline
from benchctl.plan import Plan, Step, ThermalRamp
from benchctl.recordings.campaign_folder import CampaignWriter
from benchctl.recordings.model import Status
from benchctl_instruments.errors import BenchError, InstrumentError, SafetyError, UsageError
from benchctl_instruments.interfaces import TableLimits
from benchctl_instruments.links.wirelog import logger
from benchctl_instruments.rate_tables.manual import ManualTable


@dataclass(frozen=True, slots=True, kw_only=True)
class Moment:
    """State of a run: step `index` of `count` (from 1), activity in it, last measured values, bench time left."""

    index: int
    count: int
    label: str
    doing: str
    setpoint_c: float
    air_c: float
    gyro_c: float
    rate_dps: float
    left_s: float
    samples: int


class Progress(Protocol):
    """A listener to a run; called often, so it must be quick."""

    def __call__(self, moment: Moment) -> None:
        """Receive the present state of the run."""


def no_progress(moment: Moment) -> None:
    """A listener that does nothing."""


class Listener(Protocol):
    """A listener to the events of a run, which must be quick."""

    def __call__(self, kind: str, data: Mapping[str, object]) -> Iterable[str]:
        """Receive an event of the journal; return what went wrong with earlier messages, for the journal."""


def no_listener(kind: str, data: Mapping[str, object]) -> Iterable[str]:
    """A listener that does nothing."""
    return ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The outcome of a campaign.

    `recording` is the file with all steps, or the campaign's folder if that file could not be made. `error` is what
    ended the campaign early or prevents confirming that it is safe, or None; it is never a `UsageError`.
    """

    campaign: Path
    recording: Path
    status: Status
    planned: int
    whole: int
    samples: int
    bench_time_s: float
    wall_time_s: float
    safe: SafeState
    error: BenchError | None

    def raise_error(self) -> None:
        """Raise what ended the campaign early, if anything did; a note names the recording."""
        if self.error is not None:
            self.error.add_note(f"the recording of what was done: {self.recording}")
            raise self.error

    def values(self) -> dict[str, Any]:
        """Return the data of a campaign in `--json`, the same for every verb."""
        return {
            "recording": self.recording,
            "status": self.status,
            "steps": {"planned": self.planned, "whole": self.whole},
            "samples": self.samples,
            "bench_time_s": self.bench_time_s,
            "wall_time_s": self.wall_time_s,
        }


def run_campaign(
    plan: Plan,
    opened: OpenBench,
    folder: Path,
    *,
    stop: StopRequest | None = None,
    progress: Progress = no_progress,
    listener: Listener = no_listener,
    guard: Guard | None = None,
    past: Past | None = None,
) -> Outcome:
    """Run a plan on an open bench and record it in `folder`, or resume the campaign `past`.

    Once the run has begun to command the bench, the table is brought to rest and the chamber sent to its safe set
    point, each read back, before the recording is closed, whatever ends the run; the outcome states what ended it. A
    step is played again if the encoder shows another motion than demanded, or if too much of it is lost in gaps.
    Exceptions that are not `BenchError` are faults of this program: the bench is still brought to rest and the
    recording closed, then they propagate.

    Raises
    ------
    UsageError
        Before anything moves: the plan exceeds the bench's limits, needs an operator and there is none, the disk has no
        room for it, the folder cannot be written, or the instruments are not those of the `past`.
    InstrumentError
        Before anything is commanded: the table already turns or the digitizer already streams, for another program.
    LinkError
        Before anything is commanded: the digitizer's stream is not at the address in the bench file.
    """
    refuse_problems(plan, opened.bench, folder)
    to_play = steps_to_play(plan, past.infos if past else (), opened.bench.safe.chamber_c)
    by_hand = opened.bench.by_hand
    require_operator(plan.procedure, ((number, step) for _, number, step in to_play), opened.operator, by_hand=by_hand)
    if past is not None:
        refuse_other_instruments(past.meta, opened.identities)
    refuse_bench_in_use(opened)
    wall_s = time.monotonic()
    run = _Run(plan, opened, folder, stop or StopRequest(), progress, listener, guard or NoGuard(), past)
    run.play()
    return Outcome(
        campaign=folder,
        recording=run.recording,
        status=run.status,
        planned=len(plan.steps),
        whole=run.complete,
        samples=run.samples,
        bench_time_s=opened.clock.now() - opened.epoch_s,
        wall_time_s=time.monotonic() - wall_s,
        safe=run.safe,
        error=run.error,
    )


class AbortedError(BenchError):
    """A run that had begun ended early without a failure of the bench: a full disk, a demand out of range."""


class _Run:
    """The mutable state of one run."""

    def __init__(
        self,
        plan: Plan,
        opened: OpenBench,
        folder: Path,
        stop: StopRequest,
        progress: Progress,
        listener: Listener,
        guard: Guard,
        past: Past | None,
    ) -> None:
        self.plan, self.opened, self.stop, self.progress, self.guard = plan, opened, stop, progress, guard
        self._listener = listener
        self._to_play = [(number, number, step) for number, step in enumerate(plan.steps, 1)]
        self.complete = self.samples = 0
        filed: list[int] = []
        if past is None:
            self.writer = CampaignWriter(folder, describe(opened, plan, "running"))
        else:
            self.writer, infos = past.reopen()
            self._to_play = list(steps_to_play(plan, infos, self._start_c()))
            self.complete, self.samples = len(whole_steps(plan, infos)), sum(info.samples for info in infos)
            filed = [info.index for info in infos]
            self.event("resume", elapsed_s=opened.elapsed_s, day=past.day, whole=self.complete, software=software())
        if isinstance(opened.operator, PageOperator):
            self.event("started", by=opened.operator.who)
        for piece in plan_events(plan, opened.bench.limits, self._start_c()):
            self.event("plan", **piece)
        for certificate in expiring(plan, opened.bench, past.first if past else 1):
            self.event("certificate", **as_event(certificate))
        self.recording = folder
        self.status: Status = "aborted"
        self.error: BenchError | None = None
        self.safe = SafeState(rate_dps=None, chamber_setpoint_c=None, problems=())
        self._commands = False  # a bench that this run has not commanded is not brought to rest by it
        self._supervisor = Supervisor(opened, self.event, guard)
        self._player = StepPlayer(opened, self.writer, self._supervisor, stop, self._notify, self._start_c())
        self._index, self._ends_s = 0, [end_s for _, end_s, _ in timeline(plan, opened.bench.limits, self._start_c())]
        self._step_began_s = opened.clock.now()
        self._last_index = max((len(plan.steps), *(index for index, _, _ in self._to_play), *filed))
        self._may_be_off = past is not None and past.may_be_off

    def event(self, kind: str, **data: object) -> None:
        """Record an event with the bench's time."""
        bench_s = round(self.opened.clock.now() - self.opened.epoch_s, 3)
        self.writer.event(kind, bench_s=bench_s, **data)
        for message in self._listener(kind, data):
            self.writer.event("notify", bench_s=bench_s, says=message)

    def play(self) -> None:
        """Play all steps, then bring the bench to rest, then close the recording."""
        reason = "a fault of the program"
        try:
            with _recoveries_told(self.event), turned_by_operator(self._player):
                self._play_steps()
            self.status, reason = "complete", ""
        except StoppedError as err:
            self.status, self.error, reason = "interrupted", err, str(err)
        except BenchError as err:
            self.status, self.error, reason = "aborted", err, str(err)
        finally:
            if self._commands:
                self.safe = bring_to_rest(self.opened, self.guard.beat)
            if self.safe.confirmed or not self._commands:
                self.guard.done()
            self._close(reason)
            self._conclude()

    def _close(self, reason: str) -> None:
        try:
            if self._commands:
                self.event("safe", status=self.status, reason=reason, **asdict(self.safe))
            self.samples += self._player.close_torn()
            self.recording = self.writer.finish(self.status, reason)
        except BenchError as err:
            with suppress(BenchError):
                self.writer.release()  # the steps stay readable in the folder
            self.status = "aborted" if self.status == "complete" else self.status
            ended = str(self.error or err)
            self.error = AbortedError(ended if str(err) in ended else f"{ended}; {err}")

    def _conclude(self) -> None:
        if self.safe.problems:
            ended = f"{self.error}; " if self.error else ""
            promise = "" if self.safe.confirmed else self.guard.promise
            self.error = SafetyError(
                f"{ended}the bench is not known to be at rest: {'; '.join(self.safe.problems)}{promise}"
            )
        elif isinstance(self.error, UsageError):
            self.error = AbortedError(str(self.error))

    def _play_steps(self) -> None:
        self.stop.heed()
        self._prepare()
        if self._may_be_off:
            self._index = self._to_play[0][1]
            switch_on(self._player)
        for index, number, step in self._to_play:
            self._index = number
            hold_if_asked(self._player)
            try:
                self._play_step(index, number, step)
            except StepError:
                self._player.leave()
                self.samples += self._player.close_torn(self._free_index())
                if isinstance(step, ThermalRamp):
                    soak = soak_before(self.plan, number, self._start_c())
                    self._play_step(self._free_index(), number, soak)
                self._play_step(index, number, step)
        self._notify("coming to rest")
        if self.opened.bench.by_hand:
            self._player.rest(0.0)

    def _play_step(self, index: int, number: int, step: Step) -> None:
        self._step_began_s = self.opened.clock.now()
        self.event("step", index=index, number=number, name=step.label)
        info = self._player.play(index, step)
        self.writer.step_over(info)
        self.complete += index == number
        self.samples += info.samples

    def _free_index(self) -> int:
        """Return the next index after all that were played or stored."""
        self._last_index += 1
        return self._last_index

    def _prepare(self) -> None:
        limits, opened = self.opened.bench.limits, self.opened
        self.guard.arm(self.event)
        self._commands = True
        opened.table.set_limits(TableLimits(rate_dps=limits.rate_dps, acceleration_dps2=limits.acceleration_dps2))
        opened.chamber.set_limits(limits.coldest_c, limits.hottest_c)
        opened.table.enable()
        opened.chamber.go_to(self._start_c())  # the plan begins at this set point, whatever was set before
        opened.chamber.start()
        self.event(
            "prepared",
            planned=len(self.plan.steps),
            instruments={name: asdict(who) for name, who in opened.identities.items()},
        )

    def _start_c(self) -> float:
        return self.opened.bench.safe.chamber_c

    def _notify(self, doing: str) -> None:
        elapsed_s = self.opened.clock.now() - self._step_began_s
        began_s = self._ends_s[self._index - 2] if self._index > 1 else 0.0
        step_left_s = max(0.0, self._ends_s[self._index - 1] - began_s - elapsed_s)
        air, motion = self._supervisor.air, self._supervisor.motion
        self.progress(
            Moment(
                index=self._index,
                count=len(self.plan.steps),
                label=self.plan.steps[self._index - 1].label,
                doing=doing,
                setpoint_c=self._player.setpoint_c,
                air_c=air.temperature_c if air else float("nan"),
                gyro_c=self._player.gyro_c,
                rate_dps=motion.rate_dps if motion else 0.0,
                left_s=self._ends_s[-1] - self._ends_s[self._index - 1] + step_left_s,
                samples=self.samples + self._player.streamed,
            )
        )


class _Teller(logging.Handler):
    """Forwards every log record as an event."""

    def __init__(self, event: Callable[..., None]) -> None:
        super().__init__()
        self._event = event

    def emit(self, record: logging.LogRecord) -> None:
        """Forward a record."""
        self._event("recovered", says=record.getMessage())


@contextmanager
def _recoveries_told(event: Callable[..., None]) -> Iterator[None]:
    """Send every recovery to `event` while the block runs, as kind `recovered` with the link's message."""
    teller = _Teller(event)
    logger.addHandler(teller)
    try:
        yield
    finally:
        logger.removeHandler(teller)


ATTEMPTS = 3
"""Number of prompts for a rate that the encoder does not show."""

PATIENCE_CHUNKS = 40
"""Time after an answer until the encoder shows the rate, in chunks of the clock: 20 s if bench time is wall time."""


@contextmanager
def turned_by_operator(player: StepPlayer) -> Iterator[None]:
    """Send the commands of a manual table to the operator of the campaign while the block runs."""
    table = player.opened.table
    if not isinstance(table, ManualTable):
        yield
        return
    unsupervised = table.operator
    table.operator = lambda rate_dps: await_turn(player, rate_dps)
    try:
        yield
    finally:
        table.operator = unsupervised


def await_turn(player: StepPlayer, rate_dps: float) -> None:
    """Have the operator set a rate, or stop the table (0), until the encoder shows it.

    Raises
    ------
    InstrumentError
        The encoder shows another rate after `ATTEMPTS` questions.
    """
    clock, limits = player.opened.clock, player.opened.bench.limits
    tolerance_dps = limits.motion_tolerance_dps(rate_dps) if rate_dps else AT_REST_DPS
    expected, shown_dps = f"{rate_dps:+g} ± {tolerance_dps:.3g} deg/s", math.nan
    for attempt in range(ATTEMPTS):
        if attempt:
            say(f"the encoder shows {shown_dps:+.3f} deg/s, expected {expected}")
        await_operator(player, turn_question(rate_dps), lambda who, meanwhile: who.turn(rate_dps, meanwhile))
        for _ in range(PATIENCE_CHUNKS):
            player.wait(clock.chunk_s)
            shown_dps = motion.rate_dps if (motion := player.supervisor.motion) else math.nan
            if abs(shown_dps - rate_dps) <= tolerance_dps:
                return
            player.notify(f"waiting until the encoder shows {expected}")
    raise InstrumentError(
        f"rate_table: prompted {ATTEMPTS} times to {turn_question(rate_dps)}; the encoder shows {shown_dps:+.3f} "
        f"deg/s, expected {expected}; look at the table, at encoder_counts_per_rev and encoder_sign in [digitizer], "
        "and at limits.motion_error_percent"
    )
