"""Record a digital gyro's frames into a step, timed as the scans are; every missing frame is counted.

A separate thread reads the gyro's blocks as they come, so that the run does not wait for them.

    instant of sample i = instant of sample 0 + i / rate

The gyro's frame numbers give i, its nominal rate the interval. A stamp is the time at which the last sample of a
block had reached the host, so each block is an upper bound for the instant of sample 0, and the lowest bound counts.
Its error is the shortest delay of a frame (on a simulated bench, whose clock leaps: up to one sample interval). The
blocks up to the first `settle` determine it, later ones change nothing: a crystal that is off by 20 ppm puts the end
of an hour's step 0.07 s from its place.

After a silence in which the frame numbers may have wrapped, the samples wait for the next `settle`: their own blocks
show how many wraps are missing. That is right while a frame takes less than half a wrap to come; no sample is ever put
before one that came earlier.
"""

from __future__ import annotations

import itertools
import math
import queue
import threading
from dataclasses import dataclass, field, replace
from typing import Protocol

import numpy as np

from benchctl.campaign.opened import OpenBench
from benchctl.campaign.safety import Supervisor
from benchctl.campaign.stream import StreamRecorder
from benchctl.recordings.campaign_folder import StepWriter
from benchctl.recordings.model import FRAME_CHANNELS, StepInfo
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.errors import BenchError, LinkError
from benchctl_instruments.interfaces import Clock, Gyro, GyroBlock, GyroCounts

UNKNOWN = 256.0
"""What is added to the status of a sample for which its gyro does not vouch, so that it is never 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Frames:
    """Frames with their instants, by the clock of the stamps; every array of shape (n,), oldest first.

    `status` is 0 where the gyro vouches for the sample, otherwise 256 + its own. `missing` says how many samples are
    missing just before each.
    """

    time_s: FloatArray
    rate_dps: FloatArray
    temp_c: FloatArray
    status: FloatArray
    missing: IntArray


@dataclass(slots=True)
class _Stretch:
    """Blocks, or parts of them, between two places where the line was deaf."""

    zero_s: float = math.inf
    blocks: list[tuple[GyroBlock, slice]] = field(default_factory=list)


class FrameTimes:
    """Blocks and the stamps of their last samples in, frames with their instants out.

    Parameters
    ----------
    rate_hz
        The gyro's nominal rate.
    """

    def __init__(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz
        self._zero_s: float | None = None
        self._shift = 0  # samples in whole wraps that the gyro's numbers have missed
        self._unsettled: list[_Stretch] = []
        self._placed: list[Frames] = []
        self._next_index: int | None = None

    @property
    def is_settled(self) -> bool:
        """Whether the place of everything that has come is known, and something has come."""
        return self._zero_s is not None and not self._unsettled

    @property
    def reached_s(self) -> float:
        """The instant after the last sample whose place is known; -inf where there is none."""
        if self._zero_s is None or self._next_index is None:
            return -math.inf
        return self._zero_s + self._next_index / self._rate_hz

    def feed(self, block: GyroBlock, stamp_s: float) -> None:
        """Take a block whose last sample had come at `stamp_s`."""
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
        """Find the place of whatever has none yet, from what has come by now.

        Where the stream fell silent at once no block may be fresh: `latest_zero_s` is when its first sample must have
        been taken, whatever the stamps say.
        """
        # What comes later can only have missed more, so its bound holds for what came before it as well.
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
        """All frames that were sampled before an instant and have not been taken."""
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
                temp_c=block.temperature_c[part],
                status=np.where(block.valid[part], 0.0, UNKNOWN + block.status[part]),
                missing=np.diff(index, prepend=before) - 1,
            )
        )


def _of(frames: Frames, those: BoolArray) -> Frames:
    return Frames(
        time_s=frames.time_s[those],
        rate_dps=frames.rate_dps[those],
        temp_c=frames.temp_c[those],
        status=frames.status[those],
        missing=frames.missing[those],
    )


def _joined(parts: list[Frames]) -> Frames:
    return Frames(
        time_s=np.concatenate([np.empty(0), *(part.time_s for part in parts)]),
        rate_dps=np.concatenate([np.empty(0), *(part.rate_dps for part in parts)]),
        temp_c=np.concatenate([np.empty(0), *(part.temp_c for part in parts)]),
        status=np.concatenate([np.empty(0), *(part.status for part in parts)]),
        missing=np.concatenate([np.empty(0, np.int64), *(part.missing for part in parts)]),
    )


LOOK_S = 0.1
"""Wall time for which one read waits, and within which the thread ends."""

MOST_BLOCKS = 1024
"""Blocks that wait to be taken. Where there are so many the line is not read: what it loses the gyro's numbers tell."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Heard:
    """A block, and the clock's time at which the last of it had come."""

    block: GyroBlock
    stamp_s: float


class FramePump:
    """Reads a gyro's stream from when it is made until `stop`.

    `began_s` is the clock just before the gyro was asked to send, `runs_s` just after it agreed; `rate_hz` is what it
    says that it sends at, `silence` why nothing came when it was last listened to. Raises as `Gyro.start_stream`.
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
        """All that has come and was not taken; where that is nothing, it waits so long by the wall for the next.

        Raises what ended the reading, if something did: a line that is silent does not.
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
        """End the reading; the gyro itself is left as it is. Safe to call twice."""
        self._stopping.set()
        self._thread.join()

    def _read(self) -> None:
        while not self._stopping.is_set():
            try:
                heard = Heard(block=self._gyro.read_stream(1, LOOK_S), stamp_s=self._clock.now())
            except LinkError as err:
                self.silence = str(err)
                self._stopping.wait(LOOK_S / 10.0)  # a line that is gone says so at once, again and again
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
        """Report the faults that the gyro states, where they have changed."""
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
