"""Segments of a step: evenly sampled runs without a gap, with the angle unwrapped and unusable samples flagged.

A step is read part by part, so that it need not fit into memory. Each part continues the previous one: the last samples
that were kept are put before it, and a segment cut by the end of a part is continued.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from benchctl.recordings.mapped import FILLED
from benchctl.recordings.model import Meta, Step
from benchctl.recordings.runs import gap_free
from benchctl.signals.rate import unwrap_deg
from benchctl_instruments.arrays import BoolArray, FloatArray

CHANNELS = ("time_s", "encoder_deg", "gyro_v", "gyro_temp_c", FILLED)
"""Channels that are read from a step, if present; the first three are required."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """Contiguous samples, arrays of shape (n,): stamps, unwrapped angle, output, and flags of unusable samples.

    `first` is the index of the first sample among those that its reader holds. `ends`: the segment is followed by a gap
    or by the end of the step.
    """

    time_s: FloatArray
    angle_deg: FloatArray
    output_v: FloatArray
    bad: BoolArray
    first: int
    ends: bool

    @property
    def samples(self) -> int:
        """Number of samples."""
        return int(self.time_s.size)

    def cut(self, first: int, last: int) -> Segment:
        """Return the samples from `first` up to, but not including, `last`."""
        rows = slice(first, last)
        return Segment(
            time_s=self.time_s[rows],
            angle_deg=self.angle_deg[rows],
            output_v=self.output_v[rows],
            bad=self.bad[rows],
            first=self.first + first,
            ends=self.ends,
        )


class _Samples(NamedTuple):
    """Samples with a known angle, arrays of shape (n,): stamps, angle as read, output, flags of bad samples."""

    time_s: FloatArray
    angle_deg: FloatArray
    output_v: FloatArray
    bad: BoolArray

    def begin_at(self, first: int) -> _Samples:
        """Return copies of the samples from `first` on, so that the original arrays can be freed."""
        time_s, angle_deg, output_v, bad = self
        return _Samples(time_s[first:].copy(), angle_deg[first:].copy(), output_v[first:].copy(), bad[first:].copy())

    def followed_by(self, others: _Samples) -> _Samples:
        """Concatenate both."""
        return _Samples(
            np.concatenate([self.time_s, others.time_s]),
            np.concatenate([self.angle_deg, others.angle_deg]),
            np.concatenate([self.output_v, others.output_v]),
            np.concatenate([self.bad, others.bad]),
        )


class SegmentReader:
    """Reads the parts of a step in order; `masked` counts the samples that were clipped, filled in or not finite."""

    def __init__(self, interval_s: float, meta: Meta) -> None:
        self.masked = 0
        self._interval_s, self._meta = interval_s, meta
        self._held: _Samples | None = None

    def take(self, part: Step, *, last: bool) -> list[Segment]:
        """Return the segments of the kept samples and the next part, at least one; `last`: no other part follows."""
        held = self._good(part)
        if self._held is not None:
            held = self._held.followed_by(held)
        self._held = held
        return [
            Segment(
                time_s=held.time_s[run],
                angle_deg=unwrap_deg(held.angle_deg[run]),
                output_v=held.output_v[run],
                bad=held.bad[run],
                first=run.start,
                ends=last or run.stop < held.time_s.size,
            )
            for run in gap_free(held.time_s, self._interval_s)
        ]

    def keep(self, first: int | None) -> None:
        """Keep the samples from this index on for the next part; None: keep none."""
        self._held = None if self._held is None or first is None else self._held.begin_at(first)

    def _good(self, part: Step) -> _Samples:
        """Return the samples with a known angle; an unknown angle makes a gap."""
        finite = np.isfinite(part["encoder_deg"])
        bad = ~usable(part, self._meta)
        self.masked += int(np.count_nonzero(bad | ~finite))
        time, angle, output = (part[name] for name in ("time_s", "encoder_deg", "gyro_v"))
        if bad.any():
            output = np.where(np.isfinite(output), output, 0.0)
        if not finite.all():
            time, angle, output, bad = time[finite], angle[finite], output[finite], bad[finite]
        return _Samples(time, angle, output, bad)


def usable(step: Step, meta: Meta) -> BoolArray:
    """Return which samples of the output are finite, not clipped and not filled in, shape (n,)."""
    output, filled = step["gyro_v"], step.channels.get(FILLED)
    good = np.isfinite(output) & ~clipped(output, meta)
    return good if filled is None else good & ~(filled > 0.5)


def clipped(output: FloatArray, meta: Meta) -> BoolArray:
    """Return which samples are at the converter's limits, or at the output's limit if the lab states one; (n,)."""
    limit = np.inf
    if meta.bench.adc_range_v > 0:
        codes = 2.0 ** (meta.bench.adc_bits - 1) if meta.bench.adc_bits else 2.0**15
        limit = meta.bench.adc_range_v * (1 - 2 / codes)
    stated = (meta.simulation or {}).get("output_limit_v")
    if isinstance(stated, int | float) and stated > 0:
        limit = min(limit, 0.999 * float(stated))
    return np.asarray(np.abs(output) >= limit)
