"""Record the digitizer's stream into a step: scans to channels, gaps counted, nothing lost silently.

The stream outlives its own end: where it falls silent it is started anew, and its scans go on counting. A driver
reconnects by itself, and what it lost then is a gap. Beyond that nothing shows whether a stream goes on, so after a
question without an answer this is done at the next one:

| what came meanwhile                        | what is done                                                          |
|--------------------------------------------|-----------------------------------------------------------------------|
| scans of the same stream                   | they are taken: nothing is missing, or what their numbers show        |
| nothing, or it never brought a single scan | it is stopped and started anew: what lies between the two is a gap    |

The instants of the new stream are those that the digitizer states for it, on its own counter: scans before and behind
the gap share one clock, if not one grid. How often to ask is the caller's affair.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from typing import TypeVar

import numpy as np

from benchctl.campaign.encoder_motion import EncoderMotion, HeldMotion
from benchctl.campaign.interlocks import Range
from benchctl.campaign.opened import OpenBench
from benchctl.campaign.safety import FIND_OUT, RATE_MARGIN, Supervisor
from benchctl.plan import Step
from benchctl.recordings.campaign_folder import StepWriter
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import LinkError, SafetyError
from benchctl_instruments.interfaces import Clock, Digitizer, ScanBlock
from benchctl_instruments.links.wirelog import note_recovered

Instant = TypeVar("Instant", float, FloatArray)


class LastingStream:
    """The stream of a step, which begins at once.

    Parameters
    ----------
    digitizer
        No stream runs on it yet.
    clock
        Bench time: a stream that was started anew needs some of it for its first scans.
    rate_hz
        Scans a second.
    patience_s
        How long to wait for scans, wall time; twice, before a stream is started anew.
    first_scans_s
        Bench time in which the first scans of a stream arrive.
    beat
        Called between the parts of a recovery, each of which may take as long as a time-out.
    """

    def __init__(
        self,
        digitizer: Digitizer,
        clock: Clock,
        *,
        rate_hz: float,
        patience_s: float,
        first_scans_s: float,
        beat: Callable[[], None],
    ) -> None:
        self._digitizer, self._clock, self._beat = digitizer, clock, beat
        self._wanted_hz, self._patience_s, self._first_scans_s = rate_hz, patience_s, first_scans_s
        start = digitizer.start_stream(rate_hz)
        self.rate_hz = start.rate_hz
        self._first_s, self._first_index = start.start_s, 0  # of the present stream's first scan
        self._next_index = 0
        self._brought_some = False  # the present stream
        self._failure: LinkError | None = None  # why the last question had no answer

    def instant_s(self, index: Instant) -> Instant:
        """When scans were taken, on the digitizer's counter; for those of the latest block and what follows it."""
        return self._first_s + (index - self._first_index) / self.rate_hz

    def read(self, scans: int) -> ScanBlock:
        """At least `scans` scans; fewer before a gap, or where they come late or from a stream that was started anew.

        Raises `LinkError` where none came: then it may be asked again, as long as the caller has patience.
        """
        try:
            block = self._read(scans)
        except LinkError as err:
            self._failure = err
            raise
        self._brought_some = True
        self._next_index = self._first_index + block.first_index + len(block.gyro_v)
        return replace(block, first_index=self._first_index + block.first_index)

    def _read(self, scans: int) -> ScanBlock:
        failure = self._failure
        if failure is None:
            return self._digitizer.read_stream(scans, timeout_s=self._patience_s)
        if self._brought_some:
            with suppress(LinkError):
                late = self._digitizer.read_stream(1, timeout_s=self._patience_s)
                if len(late.gyro_v) >= scans:
                    self._failure = None
                return late
        self._start_anew()
        block = self._digitizer.read_stream(1, timeout_s=self._patience_s)
        self._failure = None
        note_recovered(str(failure), "its stream was started anew, what is missing is a gap")
        return block

    def _start_anew(self) -> None:
        self._brought_some = False  # what still waits in the digitizer is discarded
        self._beat()
        self._digitizer.stop_stream()
        self._beat()
        start = self._digitizer.start_stream(self._wanted_hz)
        passed = round((start.start_s - self._first_s) * self.rate_hz)
        self._first_index = max(self._next_index + 1, self._first_index + passed)  # its grid is another: never no gap
        self._first_s = start.start_s
        self._beat()
        self._clock.sleep(self._first_scans_s)


POLL_CHANNELS = ("poll_time_s", "poll_chamber_temp_c", "poll_chamber_setpoint_c")
STREAM_CHANNELS = ("time_s", "encoder_deg", "gyro_v", "gyro_temp_c", *POLL_CHANNELS)

IN_FLIGHT_SCANS = 128
"""Scans may wait in a packet that is not yet full: this many are not asked for until later."""

PATIENCE = 0.5
"""Scans are waited for so much of `silence_s`, then the table and the chamber are looked at again."""


LEAST_SHARE = 0.5
"""A step with a smaller share of its scans is not complete: the rest is gaps, in which nobody saw the motion."""


class StepError(SafetyError):
    """What was recorded is not what the step demands; it can be played again."""


class StreamRecorder:
    """Records the stream of a step, which begins at once; the supervisor sees what is recorded.

    `t_start` is the first scan's instant, seconds since the start of the recording.
    """

    def __init__(self, opened: OpenBench, supervisor: Supervisor, into: StepWriter, step: Step) -> None:
        self._opened, self._supervisor, self._into = opened, supervisor, into
        entry = opened.bench.digitizer
        self._stream = LastingStream(
            opened.digitizer,
            opened.clock,
            rate_hz=entry.sample_rate_hz,
            patience_s=PATIENCE * opened.bench.limits.silence_s,
            first_scans_s=min(opened.clock.chunk_s, (IN_FLIGHT_SCANS + 1) / entry.sample_rate_hz),
            beat=supervisor.guard.beat,
        )
        self._begin_s = opened.clock.now()
        self._wanted = round(step.streamed_s * self._stream.rate_hz)
        self._next_index = 0
        self._silent = False
        self.t_start = self.t_end
        self._degrees_per_count = entry.encoder_sign * 360.0 / entry.encoder_counts_per_rev
        self._motion = EncoderMotion(opened.bench, self._stream.rate_hz)
        self._held = HeldMotion(opened.bench, step, self._stream.rate_hz)
        self._gyro_celsius = entry.gyro_celsius
        self.gaps = self.samples = 0
        self.last_gyro_c = math.nan

    @property
    def began_s(self) -> float:
        """The host's clock when the stream had been started."""
        return self._begin_s

    @property
    def rate_hz(self) -> float:
        """Scans a second, as the digitizer states it."""
        return self._stream.rate_hz

    @property
    def t_end(self) -> float:
        """The instant after the last scan that was taken, seconds since the start of the recording."""
        return self._opened.elapsed_s + self._stream.instant_s(float(self._next_index))

    @property
    def wants_more(self) -> bool:
        """Whether scans are still missing."""
        return self._next_index < self._wanted

    @property
    def next_chunk_s(self) -> float:
        """How much bench time to let pass before the next `take`."""
        if self._silent:  # else a step whose time is over would be asked for without a pause
            return self._opened.clock.chunk_s
        needed_s = (self._wanted + IN_FLIGHT_SCANS + 1) / self._stream.rate_hz
        elapsed_s = self._opened.clock.now() - self._begin_s
        return max(1 / self._stream.rate_hz, min(self._opened.clock.chunk_s, needed_s - elapsed_s))

    def take(self) -> None:
        """Take what is due by now and write it; less while the digitizer is silent for a moment.

        Raises `StepError` where the encoder shows another motion than the step demands.
        """
        elapsed_s = self._opened.clock.now() - self._begin_s
        due = min(self._wanted, int(elapsed_s * self._stream.rate_hz) - IN_FLIGHT_SCANS)
        while self._next_index < due:
            block = self._supervisor.ask("digitizer", lambda: self._stream.read(due - self._next_index))
            self._silent = block is None
            if block is None:
                return
            self._write(block)

    def refuse_few_samples(self) -> None:
        """Raise `StepError` where gaps have left too little of a step that is over."""
        if self.samples < LEAST_SHARE * self._wanted:
            raise StepError(
                f"digitizer: {self.samples} of {self._wanted} scans of a step came, the rest is missing; look for what "
                "keeps this computer busy, and check the digitizer's cable"
            )

    def _write(self, block: ScanBlock) -> None:
        if block.first_index > self._next_index:
            missing = min(block.first_index, self._wanted) - self._next_index
            self.gaps += 1
            self._supervisor.event("gap", time_s=self.t_end, scans=missing)
        keep = min(len(block.gyro_v), self._wanted - block.first_index)
        self._next_index = min(block.first_index + len(block.gyro_v), self._wanted)
        if keep <= 0:
            return
        index = np.arange(block.first_index, block.first_index + keep, dtype=np.float64)
        gyro_v, gyro_c = block.gyro_v[:keep], self._gyro_celsius(block.thermistor_v[:keep])
        self.last_gyro_c = float(gyro_c[-1])
        self.samples += keep
        self._into.append(
            {
                "time_s": self._opened.elapsed_s + self._stream.instant_s(index),
                "encoder_deg": np.mod(block.encoder_count[:keep] * self._degrees_per_count, 360.0),
                "gyro_v": gyro_v,
                "gyro_temp_c": gyro_c,
            }
        )
        count = block.encoder_count[:keep]
        accelerations_dps2 = self._motion.accelerations_dps2(block.first_index, count)
        self._refuse_beyond(accelerations_dps2)
        looks = {
            "gyro_v": gyro_v,
            "gyro_c": gyro_c,
            "encoder_dps": self._motion.rates_dps(block.first_index, count),
            "encoder_dps2": accelerations_dps2,
        }
        self._supervisor.see(**{name: _range(samples) for name, samples in looks.items() if samples.size})
        self._refuse_other_motion(block.first_index, count)

    def _refuse_other_motion(self, first_index: int, count: IntArray) -> None:
        seen = self._held.look(first_index, count)
        if seen is None:
            return
        time_s = self._opened.elapsed_s + self._stream.instant_s(float(seen.index))
        says = (
            f"the encoder shows a {seen.quantity} of {seen.measured_dps:+.3f} deg/s at {time_s:.3f} s, "
            f"expected {seen.demanded_dps:+.3f} ± {seen.tolerance_dps:.3f}"
        )
        self._supervisor.event(
            "motion",
            says=says,
            time_s=round(time_s, 6),
            demanded_dps=round(seen.demanded_dps, 6),
            measured_dps=round(seen.measured_dps, 6),
            tolerance_dps=round(seen.tolerance_dps, 6),
        )
        raise StepError(f"rate_table: {says}; look whether another program commands it, and {FIND_OUT}")

    def _refuse_beyond(self, accelerations_dps2: FloatArray) -> None:
        limit_dps2 = self._opened.bench.limits.acceleration_dps2
        beyond = accelerations_dps2[np.abs(accelerations_dps2) > limit_dps2 * RATE_MARGIN]
        if beyond.size:
            raise SafetyError(
                f"rate_table: {beyond[0]:+.0f} deg/s² measured by the encoder, "
                f"the bench's limit is {limit_dps2:g} deg/s²; {FIND_OUT}"
            )


def _range(samples: FloatArray) -> Range:
    return float(samples.min()), float(samples.max())
