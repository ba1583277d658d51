"""Record a digital gyro's frames into a step, on the time axis of the scans, and count every missing frame.

A separate thread reads the gyro's blocks as they arrive, so that the run does not wait for them.

    time of sample i = time of sample 0 + i / rate

The gyro's frame numbers give i, its nominal rate the interval. A stamp is the time at which the last sample of a block
had reached the host, so each block gives an upper bound for the time of sample 0; the lowest bound is used. Its error
is the shortest delay of a frame (on a simulated bench, whose clock advances in jumps: up to one sample interval). Only
the blocks up to the first `settle` determine it, later ones change nothing: with a crystal error of 20 ppm, the end of
an hour's step is displaced by 0.07 s.

After a silence in which the frame numbers may have wrapped, the samples wait for the next `settle`: their own blocks
show how many wraps are missing. This is correct while a frame takes less than half a wrap to arrive. No sample is ever
placed before one that arrived earlier.
"""

from __future__ import annotations

import itertools
import math
import queue
import threading
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Protocol

import numpy as np

from benchctl.campaign.opened import OpenBench
from benchctl.campaign.safety import Supervisor
from benchctl.campaign.stream import StreamRecorder
from benchctl.recordings.campaign_folder import StepWriter
from benchctl.recordings.model import AXIS_CHANNELS, FRAME_CHANNELS, StepInfo
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.errors import BenchError, LinkError
from benchctl_instruments.interfaces import Clock, Gyro, GyroBlock, GyroCounts

UNKNOWN = 256.0
"""Added to the status of a sample that its gyro marks as invalid, so that the status is never 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frames:
    """Frames with their sample times on the clock of the stamps; every array of shape (n,), oldest first.

    `rates_dps` are those of all axes, shape (n, 3). `status` is 0 if the gyro marks the sample as valid, otherwise 256
    + the gyro's status. `missing` is the number of samples missing just before each one.
    """

    time_s: FloatArray
    rate_dps: FloatArray
    rates_dps: FloatArray
    temp_c: FloatArray
    status: FloatArray
    missing: IntArray


@dataclass(slots=True)
class _Stretch:
    """Blocks, or parts of them, between two gaps of unknown length."""

    zero_s: float = math.inf
    blocks: list[tuple[GyroBlock, slice]] = field(default_factory=list)


class FrameTimes:
    """Computes the sample times of frames from blocks and the stamps of their last samples.

    Parameters
    ----------
    rate_hz
        The gyro's nominal rate.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._zero_s: float | None = None
        self._shift = 0  # samples in complete wraps that are missing from the gyro's numbers
        self._unsettled: list[_Stretch] = []
        self._placed: list[Frames] = []
        self._next_index: int | None = None

    @property
    def is_settled(self) -> bool:
        """Whether something has arrived, and everything that has arrived is placed in time."""
        return self._zero_s is not None and not self._unsettled

    @property
    def reached_s(self) -> float:
        """The time after the last placed sample; -inf if there is none."""
        if self._zero_s is None or self._next_index is None:
            return -math.inf
        return self._zero_s + self._next_index / self._rate_hz

    def feed(self, block: GyroBlock, stamp_s: float) -> None:
        """Add a block whose last sample had arrived at `stamp_s`."""
        deaf = {gap.index for gap in block.gaps if not gap.exact}
        for first, last in itertools.pairwise(sorted({0, block.sequence.size} | deaf)):
            if first in deaf or (self._zero_s is None and not self._unsettled):
                self._unsettled.append(_Stretch())
            part = slice(first, last)
            if self._zero_s is not None and not self._unsettled:
                self._place(block, part, self._zero_s)
                continue
            stretch = self._unsettled[-1]
            stretch.zero_s = min(stretch.zero_s, stamp_s - float(block.sequence[last - 1]) / self._rate_hz)
            stretch.blocks.append((block, part))

    def settle(self, latest_zero_s: float = math.inf) -> None:
        """Place all waiting samples in time, from what has arrived so far.

        If the stream fell silent at once, every block may be delayed: `latest_zero_s` is the latest possible time of
        the first sample of the stream, whatever the stamps show.
        """
        # Later stretches can only have missed more samples, so their bound also holds for the earlier ones.
        bounds_s = np.minimum.accumulate([stretch.zero_s for stretch in self._unsettled][::-1])[::-1]
        stretches, self._unsettled = self._unsettled, []
        for stretch, bound_s in zip(stretches, bounds_s.tolist(), strict=True):
            if self._zero_s is None:
                self._zero_s = min(bound_s, latest_zero_s)
            else:
                wrap = stretch.blocks[0][0].wrap
                missed = (bound_s - self._zero_s) * self._rate_hz - self._shift
                self._shift += max(0, round(missed / wrap)) * wrap
            for block, part in stretch.blocks:
                self._place(block, part, self._zero_s)

    def take(self, until_s: float) -> Frames:
        """Return and remove all frames that were sampled before a time."""
        waiting, self._placed = self._placed, []
        taken = [_of(frames, frames.time_s < until_s) for frames in waiting]
        left = [_of(frames, frames.time_s >= until_s) for frames in waiting]
        self._placed = [frames for frames in left if frames.time_s.size]
        return _joined(taken)

    def _place(self, block: GyroBlock, part: slice, zero_s: float) -> None:
        index = block.sequence[part] + self._shift
        before = index[0] - 1 if self._next_index is None else self._next_index - 1
        self._next_index = int(index[-1]) + 1
        self._placed.append(
            Frames(
                time_s=zero_s + index / self._rate_hz,
                rate_dps=block.rate_dps[part],
                rates_dps=block.rates_dps[part],
                temp_c=block.temperature_c[part],
                status=np.where(block.valid[part], 0.0, UNKNOWN + block.status[part]),
                missing=np.diff(index, prepend=before) - 1,
            )
        )


def _of(frames: Frames, those: BoolArray) -> Frames:
    return Frames(
        time_s=frames.time_s[those],
        rate_dps=frames.rate_dps[those],
        rates_dps=frames.rates_dps[those],
        temp_c=frames.temp_c[those],
        status=frames.status[those],
        missing=frames.missing[those],
    )


def _joined(parts: list[Frames]) -> Frames:
    return Frames(
        time_s=np.concatenate([np.empty(0), *(part.time_s for part in parts)]),
        rate_dps=np.concatenate([np.empty(0), *(part.rate_dps for part in parts)]),
        rates_dps=np.concatenate([np.empty((0, 3)), *(part.rates_dps for part in parts)]),
        temp_c=np.concatenate([np.empty(0), *(part.temp_c for part in parts)]),
        status=np.concatenate([np.empty(0), *(part.status for part in parts)]),
        missing=np.concatenate([np.empty(0, np.int64), *(part.missing for part in parts)]),
    )


LOOK_S = 0.1
"""Wall time that one read waits, and within which the thread ends."""

MOST_BLOCKS = 1024
"""Maximum number of waiting blocks. At this number the line is not read; the gyro's numbers show what is lost."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Heard:
    """A block, and the clock's time at which it had arrived completely."""

    block: GyroBlock
    stamp_s: float


class FramePump:
    """Reads a gyro's stream from its own creation until `stop`.

    `began_s` is the clock just before the gyro received the start command, `runs_s` just after it confirmed. `rate_hz`
    is the rate that the gyro reports, `silence` the reason why the last read brought nothing. Raises as
    `Gyro.start_stream`.
    """

    def __init__(self, gyro: Gyro, clock: Clock, rate_hz: float) -> None:
        self._gyro, self._clock = gyro, clock
        self.began_s = clock.now()
        self.rate_hz = gyro.start_stream(rate_hz)
        self.runs_s = clock.now()
        self.silence = "nothing came yet"
        self._heard: queue.Queue[Heard] = queue.Queue(MOST_BLOCKS)
        self._failure: Exception | None = None
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._read, name="gyro's frames", daemon=True)
        self._thread.start()

    def take(self, wait_s: float) -> list[Heard]:
        """Return all blocks that have arrived since the last call; if none, wait `wait_s` of wall time for the next.

        Raises the error that ended the reading, if there was one; a silent line is no such error.
        """
        taken: list[Heard] = []
        try:
            taken.append(self._heard.get(timeout=wait_s) if wait_s > 0.0 else self._heard.get_nowait())
            while True:
                taken.append(self._heard.get_nowait())
        except queue.Empty:
            if not taken and self._failure is not None:
                raise self._failure from None
            return taken

    def stop(self) -> None:
        """Stop reading; the state of the gyro is not changed. Safe to call twice."""
        self._stopping.set()
        self._thread.join()

    def _read(self) -> None:
        while not self._stopping.is_set():
            try:
                heard = Heard(block=self._gyro.read_stream(1, LOOK_S), stamp_s=self._clock.now())
            except LinkError as err:
                self.silence = str(err)
                self._stopping.wait(LOOK_S / 10.0)  # a disconnected line fails immediately, again and again
            except Exception as err:
                self._failure = err
                return
            else:
                self._put(heard)

    def _put(self, heard: Heard) -> None:
        while not self._stopping.is_set():
            try:
                self._heard.put(heard, timeout=LOOK_S)
            except queue.Full:
                continue
            return


PATIENCE_S = 0.25
"""Wall time to wait for frames that are due; the digitizer buffers its scans for longer."""

LAST_PATIENCE_S = 2.0
"""The same after the end of the scans, when nothing else waits."""

LONGEST_S = 1.0
"""Maximum bench time to wait while frames still arrive; a clock that does not advance meanwhile sets no limit."""

FRAME_TEMPERATURE = "poll_frame_temp_c"
"""The further channel of a soak on a bench with a digital gyro."""

POLLED_EVERY_S = 30.0
"""Bench time between two readings of the gyro in a soak; the history of its temperature needs no more."""

AGO = 3
"""Samples: one frame in transit, and the one being sampled."""


class StepFrames(Protocol):
    """How a step handles frames, whether the bench has a digital gyro or not."""

    @property
    def written(self) -> int:
        """Number of recorded frames."""

    def counted(self, info: StepInfo) -> StepInfo:
        """Return a step's description with its frame counts."""

    def take(self, scans: StreamRecorder) -> None:
        """Record the frames that were sampled up to the last recorded scan."""

    def finish(self, scans: StreamRecorder) -> None:
        """Record the remaining frames, and stop the gyro's stream."""

    def close(self) -> None:
        """Record what has arrived of an interrupted step, and stop the gyro's stream; does nothing after `finish`."""


class NoFrames:
    """A step without a digital gyro."""

    written = 0

    def counted(self, info: StepInfo) -> StepInfo:
        """Return the description unchanged."""
        return info

    def take(self, scans: StreamRecorder) -> None:
        """Do nothing."""

    def finish(self, scans: StreamRecorder) -> None:
        """Do nothing."""

    def close(self) -> None:
        """Do nothing."""


class FrameRecorder:
    """Records the frames of one step; the gyro sends from the creation of this object on.

    The host's clock is converted to the time axis of the scans through the start of the digitizer's stream, which the
    host knows to within the time that starting takes: some milliseconds.
    """

    def __init__(self, opened: OpenBench, gyro: Gyro, rate_hz: float, supervisor: Supervisor, into: StepWriter) -> None:
        self._opened, self._gyro, self._supervisor, self._into = opened, gyro, supervisor, into
        self._sign = opened.bench.gyro.sign if opened.bench.gyro else 1
        self._channels = frame_channels(opened)
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
        """Return a step's description with its frame counts."""
        return replace(info, frames_lost=self.lost, frames_bad=self._counts.bad_frames)

    def take(self, scans: StreamRecorder) -> None:
        """Record the frames sampled up to the last recorded scan; raises `SafetyError` after too long a silence."""
        self._take(scans, PATIENCE_S)

    def finish(self, scans: StreamRecorder) -> None:
        """Record the remaining frames, and stop the gyro's stream."""
        self._take(scans, LAST_PATIENCE_S)
        self._pump.stop()
        self._is_over = True
        rate_hz, since_s = self._pump.rate_hz, scans.t_start if self._last_s is None else self._last_s
        missing = math.ceil((scans.t_end - since_s) * rate_hz - 1e-3) - (self._last_s is not None)
        if missing > 0:
            self._miss(since_s, missing, 1)
        self._supervisor.ask("gyro", self._gyro.stop_stream)

    def close(self) -> None:
        """Record what has arrived of an interrupted step, and stop the gyro's stream; does nothing after `finish`."""
        if self._is_over:
            return
        self._is_over = True
        self._pump.stop()
        try:
            if self._scans is not None:
                self._gather(self._scans, 0.0)
                self._write(self._scans)
            self._gyro.stop_stream()
        except BenchError as err:  # the bench is at rest by now, and the cause of the end is known
            self._supervisor.event("silence", instrument="gyro", says=str(err))

    def _take(self, scans: StreamRecorder, patience_s: float) -> None:
        self._scans = scans
        self._gather(scans, patience_s)
        self._write(scans)
        self._supervisor.ask("gyro", self._news)

    def _gather(self, scans: StreamRecorder, patience_s: float) -> None:
        """Collect what has arrived; wait for frames that are due, as long as more of them arrive."""
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
        """Whether frames that are needed are still in transit.

        To place the samples in time, the latest frames are needed; afterwards frames up to the last scan are enough.
        """
        if self._times.is_settled:
            return self._times.reached_s < self._host_s(scans, scans.t_end)
        return self._pump.began_s + (self._sequence + AGO) / self._pump.rate_hz < now_s

    def _host_s(self, scans: StreamRecorder, time_s: float) -> float:
        """Return the host's clock at a time of the recording."""
        return time_s - scans.t_start + scans.began_s

    def _write(self, scans: StreamRecorder) -> None:
        frames = self._times.take(self._host_s(scans, scans.t_end))
        time_s = frames.time_s - self._host_s(scans, 0.0)
        inside = time_s >= scans.t_start
        if not inside.any():
            return
        values = (time_s, self._sign * frames.rate_dps, frames.temp_c, frames.status, *frames.rates_dps.T)
        self._into.append({name: samples[inside] for name, samples in zip(self._channels, values, strict=False)})
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
        """Report damaged frames that were skipped."""
        bad, junk = counts.bad_frames - self._counts.bad_frames, counts.junk_bytes - self._counts.junk_bytes
        self._counts = counts
        if bad or junk:
            text = f"gyro: {bad} frames did not pass their check; {junk} bytes that made no good frame were left out"
            self._supervisor.event("recovered", says=text)

    def _tell_faults(self, faults: tuple[str, ...]) -> None:
        """Record a change in the faults that the gyro reports."""
        if faults != self._faults:
            self._faults = faults
            self._supervisor.event("gyro_fault", says=", ".join(faults) or "over")

    def _news(self) -> None:
        if self._heard_s > self._known_s:  # on a busy machine even the latest frame may have arrived a while ago
            self._known_s = self._heard_s
            return
        silent_s = self._opened.clock.now() - self._heard_s
        if silent_s > AGO / self._pump.rate_hz:
            why = self._pump.silence
            raise LinkError(f"no frame came for {silent_s:.3g} s; look at its supply and its line ({why})")


@dataclass(slots=True)
class PolledFrames:
    """The temperature that the bench's digital gyro states during a soak; `last_c` is NaN until it states one.

    The gyro is started for some frames and stopped again, at most every 30 s: those of complete soaks would be most of
    the recording, and no fit uses them.
    """

    opened: OpenBench
    supervisor: Supervisor
    last_c: float = math.nan
    _due_s: float = -math.inf

    def poll(self) -> dict[str, float]:
        """Return the channel of a poll, NaN while the gyro is not due or silent; empty if the bench has no such gyro.

        Raises `SafetyError` after too long a silence.
        """
        gyro, entry, now_s = self.opened.gyro, self.opened.bench.gyro, self.opened.clock.now()
        if gyro is None or entry is None:
            return {}
        ask = partial(_temperature_c, gyro, entry.frame_rate_hz, self.opened.clock)
        found_c = self.supervisor.ask("gyro", ask) if now_s >= self._due_s else None
        if found_c is None:
            return {FRAME_TEMPERATURE: math.nan}
        self.last_c, self._due_s = found_c, now_s + POLLED_EVERY_S
        return {FRAME_TEMPERATURE: found_c}


def _temperature_c(gyro: Gyro, rate_hz: float, clock: Clock) -> float:
    rate_hz = gyro.start_stream(rate_hz)
    try:
        clock.sleep(AGO / rate_hz)
        return float(gyro.read_stream(1, LAST_PATIENCE_S).temperature_c[-1])
    finally:
        gyro.stop_stream()


def frame_channels(opened: OpenBench) -> tuple[str, ...]:
    """Return the channels of a bench's digital gyro; empty if there is none."""
    if opened.gyro is None or opened.bench.gyro is None:
        return ()
    return (*FRAME_CHANNELS, *AXIS_CHANNELS) if opened.bench.gyro.axes == 3 else FRAME_CHANNELS


def frames_of(opened: OpenBench, supervisor: Supervisor, into: StepWriter) -> StepFrames:
    """Return a recorder of the bench's digital gyro, which sends from now on; `NoFrames` if there is no such gyro."""
    if opened.gyro is None or opened.bench.gyro is None:
        return NoFrames()
    return FrameRecorder(opened, opened.gyro, opened.bench.gyro.frame_rate_hz, supervisor, into)
