"""Record the digitizer's stream into a step: convert scans to channels, count gaps, lose nothing silently.

A stream that falls silent is restarted, and its scans continue to be counted. A driver reconnects by itself, and what
it loses then is a gap. Otherwise nothing shows whether a stream is still running, so after a read without an answer the
next read does this:

| what arrived meanwhile                  | action                                                              |
|-----------------------------------------|---------------------------------------------------------------------|
| scans of the same stream                | they are used: nothing is missing, or what their numbers show       |
| nothing, or it never delivered any scan | it is stopped and restarted: what lies between the two is a gap     |

The times of the new stream are those that the digitizer reports for it, on its own counter: scans before and after the
gap share one clock, but not necessarily one grid. The caller decides how often to read.
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
    """The stream of a step, which begins immediately.

    Parameters
    ----------
    digitizer
        No stream runs on it yet.
    clock
        Bench time: a restarted stream needs some of it for its first scans.
    rate_hz
        Scans per second.
    patience_s
        Wall time to wait for scans; twice, before a stream is restarted.
    first_scans_s
        Bench time in which the first scans of a stream arrive.
    beat
        Called between the parts of a recovery, each of which may take as long as a timeout.
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
        self._brought_some = False  # whether the present stream delivered any scan
        self._failure: LinkError | None = None  # why the last read failed

    def instant_s(self, index: Instant) -> Instant:
        """Return when scans were taken, on the digitizer's counter; for scans of the latest block and after it."""
        return self._first_s + (index - self._first_index) / self.rate_hz

    def read(self, scans: int) -> ScanBlock:
        """Return at least `scans` scans; fewer before a gap, or if they are late or come from a restarted stream.

        Raises `LinkError` if none arrived: the caller may then read again, as long as it has patience.
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
        self._brought_some = False  # scans that still wait in the digitizer are discarded
        self._beat()
        self._digitizer.stop_stream()
        self._beat()
        start = self._digitizer.start_stream(self._wanted_hz)
        passed = round((start.start_s - self._first_s) * self.rate_hz)
        self._first_index = max(self._next_index + 1, self._first_index + passed)  # another grid: always a gap
        self._first_s = start.start_s
        self._beat()
        self._clock.sleep(self._first_scans_s)


POLL_CHANNELS = ("poll_time_s", "poll_chamber_temp_c", "poll_chamber_setpoint_c")
STREAM_CHANNELS = ("time_s", "encoder_deg", "gyro_v", "gyro_temp_c", *POLL_CHANNELS)

IN_FLIGHT_SCANS, SLOW_HZ = 128, 20.0
"""Scans that may wait in a packet that is not yet full: so many are not read until later. Below this rate a packet has
one scan."""

PATIENCE = 0.5
"""Share of `silence_s` to wait for scans before the table and the chamber are looked at again."""


LEAST_SHARE = 0.5
"""A step with a smaller share of its scans is not complete: in the gaps the motion was not observed."""


class StepError(SafetyError):
    """The recorded data do not show what the step demands; the step can be played again."""


class StreamRecorder:
    """Records the stream of a step, which begins immediately; the supervisor checks what is recorded.

    `t_start` is the time of the first scan, in seconds since the start of the recording.
    """

    def __init__(self, opened: OpenBench, supervisor: Supervisor, into: StepWriter, step: Step) -> None:
        self._opened, self._supervisor, self._into = opened, supervisor, into
        entry = opened.bench.digitizer
        self._in_flight = IN_FLIGHT_SCANS if entry.sample_rate_hz >= SLOW_HZ else 1
        self._stream = LastingStream(
            opened.digitizer,
            opened.clock,
            rate_hz=entry.sample_rate_hz,
            patience_s=PATIENCE * opened.bench.limits.silence_s,
            first_scans_s=min(opened.clock.chunk_s, (self._in_flight + 1) / entry.sample_rate_hz),
            beat=supervisor.guard.beat,
        )
        self._begin_s = opened.clock.now()
        self._wanted = round(step.streamed_s * self._stream.rate_hz)
        self._next_index = 0
        self._silent = False
        self.t_start = self.t_end
        self._degrees_per_count = entry.degrees_per_count
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
        """Scans per second, as reported by the digitizer."""
        return self._stream.rate_hz

    @property
    def t_end(self) -> float:
        """The time after the last scan that was read, in seconds since the start of the recording."""
        return self._opened.elapsed_s + self._stream.instant_s(float(self._next_index))

    @property
    def wants_more(self) -> bool:
        """Whether scans are still missing."""
        return self._next_index < self._wanted

    @property
    def next_chunk_s(self) -> float:
        """Bench time to wait before the next `take`."""
        if self._silent:  # else a step whose time is over would be read without a pause
            return self._opened.clock.chunk_s
        needed_s = (self._wanted + self._in_flight + 1) / self._stream.rate_hz
        elapsed_s = self._opened.clock.now() - self._begin_s
        return min(self._opened.clock.chunk_s, max(1 / self._stream.rate_hz, needed_s - elapsed_s))

    def take(self) -> None:
        """Read the scans that are due and write them; fewer while the digitizer is briefly silent.

        Raises `StepError` if the encoder shows another motion than the step demands.
        """
        elapsed_s = self._opened.clock.now() - self._begin_s
        due = min(self._wanted, int(elapsed_s * self._stream.rate_hz) - self._in_flight)
        while self._next_index < due:
            block = self._supervisor.ask("digitizer", lambda: self._stream.read(due - self._next_index))
            self._silent = block is None
            if block is None:
                return
            self._write(block)

    def refuse_few_samples(self) -> None:
        """Raise `StepError` if gaps have left too few samples in a step that is over."""
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
        deviation = self._held.look(first_index, count)
        if deviation is None:
            return
        time_s = self._opened.elapsed_s + self._stream.instant_s(float(deviation.index))
        text = (
            f"the encoder shows a {deviation.quantity} of {deviation.measured_dps:+.3f} deg/s at {time_s:.3f} s, "
            f"expected {deviation.demanded_dps:+.3f} ± {deviation.tolerance_dps:.3f}"
        )
        self._supervisor.event(
            "motion",
            says=text,
            time_s=round(time_s, 6),
            demanded_dps=round(deviation.demanded_dps, 6),
            measured_dps=round(deviation.measured_dps, 6),
            tolerance_dps=round(deviation.tolerance_dps, 6),
        )
        raise StepError(f"rate_table: {text}; look whether another program commands it, and {FIND_OUT}")

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
