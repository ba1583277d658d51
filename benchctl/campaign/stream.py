"""The digitizer's stream into a step: scans to channels, gaps counted, nothing lost silently."""

from __future__ import annotations

import math

import numpy as np

from benchctl.campaign.interlocks import Range
from benchctl.campaign.opened import OpenBench
from benchctl.campaign.safety import Supervisor
from benchctl.recordings.campaign_folder import StepWriter
from instruments.interfaces import FloatArray, IntArray, ScanBlock

POLL_CHANNELS = ("poll_time_s", "poll_chamber_temp_c", "poll_chamber_setpoint_c")
STREAM_CHANNELS = ("time_s", "encoder_deg", "gyro_v", "gyro_temp_c", *POLL_CHANNELS)

IN_FLIGHT_SCANS = 128
"""Scans may wait in a packet that is not yet full: this many are not asked for until later."""

ENCODER_LOOK_S = 0.05
"""A rate is taken from the encoder over this time: a count of a coarse encoder is then no great rate."""


class StreamRecorder:
    """Records `duration_s` of the stream, which begins at once; the supervisor sees what is recorded."""

    def __init__(self, opened: OpenBench, supervisor: Supervisor, into: StepWriter, duration_s: float) -> None:
        self._opened, self._supervisor, self._into = opened, supervisor, into
        entry = opened.bench.digitizer
        self._start = opened.digitizer.start_stream(entry.sample_rate_hz)
        self._start_s = opened.elapsed_s + self._start.start_s
        self._begin_s = opened.clock.now()
        self._wanted = round(duration_s * self._start.rate_hz)
        self._next_index = 0
        self._degrees_per_count = entry.encoder_sign * 360.0 / entry.encoder_counts_per_rev
        self._gyro_celsius = entry.gyro_celsius
        self.gaps = self.samples = 0
        self.last_gyro_c = math.nan

    @property
    def t_start(self) -> float:
        """The first scan's instant, seconds since the start of the recording."""
        return self._start_s

    @property
    def t_end(self) -> float:
        """The instant after the last scan that was taken."""
        return self._start_s + self._next_index / self._start.rate_hz

    @property
    def wants_more(self) -> bool:
        """Whether scans are still missing."""
        return self._next_index < self._wanted

    @property
    def next_chunk_s(self) -> float:
        """How much bench time to let pass before the next `take`."""
        needed_s = (self._wanted + IN_FLIGHT_SCANS + 1) / self._start.rate_hz
        elapsed_s = self._opened.clock.now() - self._begin_s
        return max(1 / self._start.rate_hz, min(self._opened.clock.chunk_s, needed_s - elapsed_s))

    def take(self) -> None:
        """Take what is due by now and write it."""
        elapsed_s = self._opened.clock.now() - self._begin_s
        due = min(self._wanted, int(elapsed_s * self._start.rate_hz) - IN_FLIGHT_SCANS)
        while self._next_index < due:
            block = self._opened.digitizer.read_stream(
                due - self._next_index, timeout_s=self._opened.bench.limits.silence_s
            )
            self._write(block)

    def _write(self, block: ScanBlock) -> None:
        if block.first_index > self._next_index:
            missing = block.first_index - self._next_index
            self.gaps += 1
            self._supervisor.event("gap", time_s=self.t_end, scans=missing)
        keep = min(len(block.gyro_v), self._wanted - block.first_index)
        self._next_index = block.first_index + len(block.gyro_v)
        if keep <= 0:
            return
        index = np.arange(block.first_index, block.first_index + keep)
        gyro_v, gyro_c = block.gyro_v[:keep], self._gyro_celsius(block.thermistor_v[:keep])
        self.last_gyro_c = float(gyro_c[-1])
        self._next_index = min(self._next_index, self._wanted)
        self.samples += keep
        self._into.append(
            {
                "time_s": self._start_s + index / self._start.rate_hz,
                "encoder_deg": np.mod(block.encoder_count[:keep] * self._degrees_per_count, 360.0),
                "gyro_v": gyro_v,
                "gyro_temp_c": gyro_c,
            }
        )
        looks = {"gyro_v": gyro_v, "gyro_c": gyro_c, "encoder_dps": self._encoder_dps(block.encoder_count[:keep])}
        self._supervisor.see(**{name: _range(samples) for name, samples in looks.items() if samples.size})

    def _encoder_dps(self, count: IntArray) -> FloatArray:
        """Mean rates over `ENCODER_LOOK_S` each, of scans without a gap; none of fewer scans than that."""
        stride = max(1, round(ENCODER_LOOK_S * self._start.rate_hz))
        return np.diff(count[::stride]) * (self._degrees_per_count * self._start.rate_hz / stride)


def _range(samples: FloatArray) -> Range:
    return float(samples.min()), float(samples.max())
