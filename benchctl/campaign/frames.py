"""A digital gyro's frames into a step, timed as the scans are: what is missing is counted, nothing lost silently."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Protocol

from benchctl.campaign.frame_pump import FramePump
from benchctl.campaign.frame_times import FrameTimes
from benchctl.campaign.opened import OpenBench
from benchctl.campaign.safety import Supervisor
from benchctl.campaign.stream import StreamRecorder
from benchctl.recordings.campaign_folder import StepWriter
from benchctl.recordings.model import FRAME_CHANNELS, StepInfo
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import BenchError, LinkError
from benchctl_instruments.interfaces import Gyro, GyroCounts

PATIENCE_S = 0.25
"""Wall time to wait for frames that should have come: the digitizer buffers its scans for longer."""

LAST_PATIENCE_S = 2.0
"""The same once the scans are over, when nothing else waits."""

LONGEST_S = 1.0
"""Bench time to wait as long as some of them come; a clock that stands still meanwhile has no hurry."""

AGO = 3
"""Samples: a frame on its way, and the one that is just being taken."""


class StepFrames(Protocol):
    """What a step does about frames, whether the bench has a digital gyro or not."""

    @property
    def written(self) -> int:
        """How many frames it has recorded."""

    def counted(self, info: StepInfo) -> StepInfo:
        """A step's description with what is known of its frames."""

    def take(self, scans: StreamRecorder) -> None:
        """Record what was sampled up to the last scan that was taken."""

    def finish(self, scans: StreamRecorder) -> None:
        """Record the rest, and have the gyro send no more."""

    def close(self) -> None:
        """The step is torn: record what has come, have the gyro send no more; does nothing after `finish`."""


class NoFrames:
    """A step without a digital gyro."""

    written = 0

    def counted(self, info: StepInfo) -> StepInfo:
        """As it is."""
        return info

    def take(self, scans: StreamRecorder) -> None:
        """Nothing to record."""

    def finish(self, scans: StreamRecorder) -> None:
        """Nothing to record."""

    def close(self) -> None:
        """Nothing to record."""


class FrameRecorder:
    """Records the frames of one step, the gyro sending from when this is made.

    Instants by the host's clock become those of the scans through the start of the digitizer's stream, which the host
    knows to the time that starting takes: some milliseconds.
    """

    def __init__(self, opened: OpenBench, gyro: Gyro, rate_hz: float, supervisor: Supervisor, into: StepWriter) -> None:
        self._opened, self._gyro, self._supervisor, self._into = opened, gyro, supervisor, into
        self._sign = opened.bench.gyro.sign if opened.bench.gyro else 1
        self._pump = FramePump(gyro, opened.clock, rate_hz)
        self._times = FrameTimes(self._pump.rate_hz)
        self._counts = GyroCounts(samples=0, lost=0, bad_frames=0, junk_bytes=0)
        self._heard_s, self._sequence = self._pump.began_s, 0
        self._known_s = self._heard_s
        self._faults: tuple[str, ...] = ()
        self._scans: StreamRecorder | None = None
        self._last_s: float | None = None
        self._is_over = False
        self.written = self.lost = 0

    def counted(self, info: StepInfo) -> StepInfo:
        """A step's description with what is known of its frames."""
        return replace(info, frames_lost=self.lost, frames_bad=self._counts.bad_frames)

    def take(self, scans: StreamRecorder) -> None:
        """Record what was sampled up to the last scan that was taken; `SafetyError` where it is silent for too long."""
        self._take(scans, PATIENCE_S)

    def finish(self, scans: StreamRecorder) -> None:
        """Record the rest, and have the gyro send no more."""
        self._take(scans, LAST_PATIENCE_S)
        self._pump.stop()
        self._is_over = True
        rate_hz, since_s = self._pump.rate_hz, scans.t_start if self._last_s is None else self._last_s
        missing = math.ceil((scans.t_end - since_s) * rate_hz - 1e-3) - (self._last_s is not None)
        if missing > 0:
            self._miss(since_s, missing, 1)
        self._supervisor.ask("gyro", self._gyro.stop_stream)

    def close(self) -> None:
        """The step is torn: record what has come, have the gyro send no more; does nothing after `finish`."""
        if self._is_over:
            return
        self._is_over = True
        self._pump.stop()
        try:
            if self._scans is not None:
                self._gather(self._scans, 0.0)
                self._write(self._scans)
            self._gyro.stop_stream()
        except BenchError as err:  # the bench rests by now, and what ended the run is known
            self._supervisor.event("silence", instrument="gyro", says=str(err))

    def _take(self, scans: StreamRecorder, patience_s: float) -> None:
        self._scans = scans
        self._gather(scans, patience_s)
        self._write(scans)
        self._supervisor.ask("gyro", self._news)

    def _gather(self, scans: StreamRecorder, patience_s: float) -> None:
        """Take what has come; wait for what should have, as long as more of it comes."""
        now_s = self._opened.clock.now()
        faults: set[str] = set()
        while True:
            waits = self._is_behind(scans, now_s) and self._opened.clock.now() < now_s + LONGEST_S
            heard = self._pump.take(patience_s if waits else 0.0)
            for one in heard:
                self._times.feed(one.block, one.stamp_s)
                self._heard_s, self._sequence = one.stamp_s, int(one.block.sequence[-1])
                self._tell_damage(one.block.counts)
                faults.update(one.block.faults)
            if not heard:
                break
        self._tell_faults(tuple(sorted(faults)))
        self._times.settle(self._pump.runs_s if waits else math.inf)

    def _is_behind(self, scans: StreamRecorder, now_s: float) -> bool:
        """Whether frames that are wanted are still on their way.

        To settle a time line takes the freshest there are; then frames up to the last scan are enough.
        """
        if self._times.is_settled:
            return self._times.reached_s < self._host_s(scans, scans.t_end)
        return self._pump.began_s + (self._sequence + AGO) / self._pump.rate_hz < now_s

    def _host_s(self, scans: StreamRecorder, time_s: float) -> float:
        """The host's clock at an instant of the recording."""
        return time_s - scans.t_start + scans.began_s

    def _write(self, scans: StreamRecorder) -> None:
        frames = self._times.take(self._host_s(scans, scans.t_end))
        time_s = frames.time_s - self._host_s(scans, 0.0)
        inside = time_s >= scans.t_start
        if not inside.any():
            return
        values = (time_s, self._sign * frames.rate_dps, frames.temp_c, frames.status)
        self._into.append({name: samples[inside] for name, samples in zip(FRAME_CHANNELS, values, strict=True)})
        self.written += int(inside.sum())
        self._last_s = float(time_s[-1])
        self._tell_missing(frames.missing[inside], time_s[inside])

    def _tell_missing(self, missing: IntArray, time_s: FloatArray) -> None:
        if missing.any():
            self._miss(float(time_s[missing > 0][0]), int(missing.sum()), int((missing > 0).sum()))

    def _miss(self, time_s: float, frames: int, gaps: int) -> None:
        self.lost += frames
        self._supervisor.event("frames_lost", time_s=round(time_s, 6), frames=frames, gaps=gaps)

    def _tell_damage(self, counts: GyroCounts) -> None:
        """Say what was got over."""
        bad, junk = counts.bad_frames - self._counts.bad_frames, counts.junk_bytes - self._counts.junk_bytes
        self._counts = counts
        if bad or junk:
            says = f"gyro: {bad} frames did not pass their check; {junk} bytes that made no good frame were left out"
            self._supervisor.event("recovered", says=says)

    def _tell_faults(self, faults: tuple[str, ...]) -> None:
        """Say what the gyro says against itself, where that has changed."""
        if faults != self._faults:
            self._faults = faults
            self._supervisor.event("gyro_fault", says=", ".join(faults) or "over")

    def _news(self) -> None:
        if self._heard_s > self._known_s:  # on a busy machine even the freshest may have come a while ago
            self._known_s = self._heard_s
            return
        silent_s = self._opened.clock.now() - self._heard_s
        if silent_s > AGO / self._pump.rate_hz:
            why = self._pump.silence
            raise LinkError(f"no frame came for {silent_s:.3g} s; look at its supply and its line ({why})")


def frames_of(opened: OpenBench, supervisor: Supervisor, into: StepWriter) -> StepFrames:
    """What the bench's digital gyro sends from now on; nothing where it has none."""
    if opened.gyro is None or opened.bench.gyro is None:
        return NoFrames()
    return FrameRecorder(opened, opened.gyro, opened.bench.gyro.frame_rate_hz, supervisor, into)
