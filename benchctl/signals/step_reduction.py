"""Reduce one step to block means, part by part, so that it need not fit into memory.

Each part continues the previous one: samples after its last block, and the angles that the smoother needs near them,
are kept and put before the next part. Sampling interval, smoother and delay are determined from the first part. The
settling of a table at constant rate is searched for once per segment: a later disturbance stays in the data, where
robust fits can detect it.

`Blocks` are the block means of one segment.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from benchctl.recordings.model import BenchFacts, Meta, Step, StepInfo
from benchctl.signals.rate import (
    Smoother,
    choose_smoother,
    derivative_of,
    mean_derivative_of,
    places_of_rate,
    rates_at,
    unwrap_deg,
)
from benchctl.signals.segments import Segment, SegmentReader
from benchctl_instruments.arrays import BoolArray, FloatArray

Numbers = npt.NDArray[Any]
"""Real or complex."""

MOTION_BLOCK_S = 0.04
BLOCKS_PER_CYCLE = 32
REST_BLOCK_S = 0.25
CONSTANT_BLOCK_DEG = 15.0
CONSTANT_BLOCK_S = 0.1
ARCSEC_PER_DEG = 3600.0

_MOVING_DPS = 0.5
_LARGEST_DELAY_S = 0.1
_DELAY_SAMPLES = 6000
_SHORTEST_DELAYED = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Blocks:
    """Block means, shape (n,); `encoder_basis` has shape (n, 4). `ReducedStep` describes each."""

    count: FloatArray
    time_s: FloatArray
    output_v: FloatArray
    rate_dps: FloatArray
    rate_at_stamp_dps: FloatArray
    rate_variance: FloatArray
    acceleration_dps2: FloatArray
    jerk_dps3: FloatArray
    encoder_basis: FloatArray


def samples_in_block(
    kind: str, frequency_hz: float | None, rate_dps: float, span_s: float, sample_rate_hz: float
) -> int:
    """Return the samples per block: at most 40 ms and 1/32 of a cycle in motion, about 15° at constant rates."""
    if kind == "static":
        seconds = REST_BLOCK_S
    elif kind == "constant_rate":
        seconds = min(max(CONSTANT_BLOCK_DEG / max(rate_dps, 1e-6), CONSTANT_BLOCK_S), span_s / 8)
    elif frequency_hz:
        seconds = min(MOTION_BLOCK_S, 1.0 / (BLOCKS_PER_CYCLE * frequency_hz))
    else:
        seconds = MOTION_BLOCK_S
    return max(1, int(seconds * sample_rate_hz))


def delay_of(segment: Segment, smoother: Smoother) -> float:
    """Return the delay of the output behind the rate, s, from the first few thousand samples; 0 if nothing moves.

    The rate is regressed on the output, its cube and its derivative, all through one smoother, and again at the delay
    found. The result is accurate to some 10 µs, enough as a point of expansion. The reverse regression is not used,
    because the derivative of the rate has more noise if the encoder is coarse.
    """
    few = slice(0, _DELAY_SAMPLES)
    angle, integral = segment.angle_deg[few], _integral(segment.output_v[few], smoother.sample_rate_hz)
    output, slope = np.zeros_like(angle), np.zeros_like(angle)
    smooth, where = derivative_of(integral, smoother)
    if not smooth.size:  # shorter than a window
        return 0.0
    output[where], slope[where] = smooth, derivative_of(integral, smoother, derivative=2)[0]
    usable = np.zeros(angle.size, dtype=np.bool_)
    usable[where] = np.convolve(segment.bad[few], np.ones(2 * smoother.half + 1), mode="valid") < 0.5
    if not usable.any():
        return 0.0
    output = output - output[usable].mean()
    peak = max(float(np.max(np.abs(output[usable]))), 1e-12)
    delay = 0.0
    for _ in range(4):
        rate, there = derivative_of(angle, smoother, delay_s=delay)
        good = usable[there]
        if int(good.sum()) < 32 or float(rate.std()) < _MOVING_DPS:
            return 0.0
        out = output[there]
        columns = np.stack([np.ones(rate.size), out, (out / peak) ** 2 * out, slope[there]], axis=1)[good]
        fit = np.linalg.lstsq(columns, rate[good], rcond=None)[0]
        step = float(fit[3] / fit[1]) if fit[1] else np.inf
        if not abs(delay + step) < _LARGEST_DELAY_S:
            return 0.0
        delay += step
        if abs(step) < 1e-6:
            break
    return delay


def _integral(output: FloatArray, sample_rate_hz: float) -> FloatArray:
    """Integrate equidistant samples by a spline, shape (n,); a sum of samples would be delayed."""
    stamps = np.arange(output.size) / sample_rate_hz
    return np.asarray(CubicSpline(stamps, output).antiderivative()(stamps), dtype=np.float64)


def _smoothed_alike(segment: Segment, smoother: Smoother) -> tuple[FloatArray, BoolArray]:
    """Return the output through the same filter as the rate, and flags of its bad samples, shape (n,) each.

    It is for motion of unknown band: the smoother's distortion of a reversal is then the same in both. The output is
    integrated by a spline and differentiated by the smoother.
    """
    smooth, where = derivative_of(_integral(segment.output_v, smoother.sample_rate_hz), smoother)
    output, bad = np.zeros_like(segment.output_v), np.ones_like(segment.bad)
    output[where] = smooth
    bad[where] = np.convolve(segment.bad, np.ones(2 * smoother.half + 1), mode="valid") > 0.5
    return output, bad


def block_means(
    segment: Segment, smoother: Smoother, *, kind: str, frequency_hz: float | None, delay_s: float
) -> Blocks | None:
    """Cut a segment into blocks and average; None if it is too short. Blocks with a bad sample are dropped."""
    moving = kind not in ("static", "constant_rate")
    where = places_in(segment, smoother, delay_s)
    samples = where.stop - where.start
    if samples < _SHORTEST_DELAYED:
        return None
    rate = np.empty(0) if kind == "static" else _rates(segment, smoother, where, delay_s)
    size = samples_in_block(
        kind,
        frequency_hz,
        float(np.median(np.abs(rate))) if kind == "constant_rate" else 0.0,
        samples / smoother.sample_rate_hz,
        smoother.sample_rate_hz,
    )
    output, bad = segment.output_v, segment.bad
    if moving and frequency_hz is None:
        output, bad = _smoothed_alike(segment, smoother)
    edges = np.linspace(0, samples, max(1, samples // size) + 1).astype(np.int64)
    lengths = np.diff(edges)
    keep = ~np.logical_or.reduceat(bad[where], edges[:-1])
    count = lengths.astype(np.float64)

    def mean(values: Numbers) -> Numbers:
        averaged: Numbers = (np.add.reduceat(values, edges[:-1]) / count)[keep]
        return averaged

    def mean_derivative(derivative: int, delay_s: float) -> FloatArray:
        found = mean_derivative_of(
            segment.angle_deg, where.start + edges, smoother, delay_s=delay_s, derivative=derivative
        )
        return found[keep]

    mean_rate = mean_derivative(1, delay_s)
    still = np.zeros(int(keep.sum()))
    variance, acceleration, jerk = still, still, still
    if moving:
        acceleration, jerk = mean_derivative(2, delay_s), mean_derivative(3, delay_s)
    if moving and frequency_hz is not None:
        # After equal smoothing, the output's curvature over a block is mostly the smoother's; the residual is noise.
        block_rate = np.add.reduceat(rate, edges[:-1]) / count
        variance = mean((rate - np.repeat(block_rate, lengths)) ** 2)
    return Blocks(
        count=count[keep],
        time_s=mean(segment.time_s[where]),
        output_v=mean(output[where]),
        rate_dps=mean_rate,
        rate_at_stamp_dps=mean_derivative(1, 0.0) if delay_s else mean_rate,
        rate_variance=variance,
        acceleration_dps2=acceleration,
        jerk_dps3=jerk,
        encoder_basis=np.zeros((still.size, 4))
        if kind == "static"
        else _encoder_basis(segment.angle_deg[where], rate, delay_s, mean),
    )


def places_in(segment: Segment, smoother: Smoother, delay_s: float) -> slice:
    """Return the samples of a segment that its blocks use: those with a rate both at their stamps and delayed."""
    here = places_of_rate(segment.angle_deg.size, smoother)
    there = places_of_rate(segment.angle_deg.size, smoother, delay_s)
    first, last = max(here.start, there.start), min(here.stop, there.stop)
    return slice(first, max(first, last))


def _rates(segment: Segment, smoother: Smoother, where: slice, delay_s: float) -> FloatArray:
    """Return the delayed rates at these samples of a segment."""
    rate, there = derivative_of(segment.angle_deg, smoother, delay_s=delay_s)
    return rate[where.start - there.start : where.stop - there.start]


def _encoder_basis(
    angle_deg: FloatArray, rate_dps: FloatArray, delay_s: float, mean: Callable[[Numbers], Numbers]
) -> FloatArray:
    """Return `ReducedStep.encoder_basis`; `mean` computes block means."""
    around = np.exp(1j * np.deg2rad(angle_deg - rate_dps * delay_s))
    moving = np.deg2rad(rate_dps) / ARCSEC_PER_DEG * around
    once, twice = mean(moving), 2 * mean(moving * around)
    return np.stack([once.real, -once.imag, twice.real, -twice.imag], axis=1)


QUIET_BAND_HZ = 5.0
FREE_MOTION_BAND_HZ = 2.0
"""Band of the motion if a step in motion states no frequency."""

QUIET_KINDS = ("static", "constant_rate")
_SHORTEST = 32
_STAMPS = 1 << 16
"""Number of stamps from which the sampling interval is computed."""


class TemperatureLine:
    """Line fit by sums over parts, each about its own means, to avoid rounding errors with large stamps."""

    def __init__(self) -> None:
        self._sums: list[tuple[float, float, float, float, float]] = []

    def take(self, time_s: FloatArray, readings_c: FloatArray | None) -> None:
        """Add samples, (n,) each; None if there is no thermistor. Readings that are not finite are left out."""
        if readings_c is None:
            return
        good = np.isfinite(readings_c)
        if not good.all():
            time_s, readings_c = time_s[good], readings_c[good]
        if time_s.size:
            mean_s, centred = float(time_s.mean()), time_s - time_s.mean()
            about = float(centred @ centred), float(centred @ readings_c)
            self._sums.append((float(time_s.size), mean_s, float(readings_c.mean()), *about))

    def fitted(self) -> tuple[float, float]:
        """Return intercept at time 0 of the recording, °C, and slope, °C/s; NaN and 0 for fewer than two readings."""
        if sum(part[0] for part in self._sums) < 2:
            return np.nan, 0.0
        count, mean_s, mean_c, squares, products = np.array(self._sums).T
        middle_s, middle_c = np.average(mean_s, weights=count), np.average(mean_c, weights=count)
        apart = count * (mean_s - middle_s)
        slope = float((products.sum() + apart @ (mean_c - middle_c)) / (squares.sum() + apart @ (mean_s - middle_s)))
        return float(middle_c - slope * middle_s), slope


class StepReduction:
    """Reads the parts of a step in order and collects its block means.

    Attributes
    ----------
    blocks
        Block means of each segment, oldest first.
    interval_s, smoother, delay_s
        Determined from the first part.
    unsettled
        Number of samples before the table had settled.
    temperature
        Line through the thermistor's readings.
    """

    def __init__(self, first: Step, meta: Meta) -> None:
        self.blocks: list[Blocks] = []
        self.interval_s = float(np.median(np.diff(first["time_s"][:_STAMPS])))
        self.smoother = _smoother_for(first, meta, self.interval_s)
        self.delay_s: float | None = 0.0 if first.info.kind in QUIET_KINDS else None
        self.unsettled = 0
        self.temperature = TemperatureLine()
        self._info, self._meta = first.info, meta
        self._reader = SegmentReader(self.interval_s, meta)
        self._goes_on = False
        self._turned_deg = 0.0
        self._whole = self._begun = 0

    @property
    def masked(self) -> int:
        """Number of samples that were clipped, filled in or not finite."""
        return self._reader.masked

    def take(self, part: Step, *, last: bool) -> None:
        """Read the next part, which may be the first; `last`: no other part follows."""
        self.temperature.take(part["time_s"], part.channels.get("gyro_temp_c"))
        segments = self._reader.take(part, last=last)
        found = list(self._settled(segments))
        if self.delay_s is None and found:
            self.delay_s = delay_of(max((one for one, _ in found), key=lambda one: one.samples), self.smoother)
        for segment, complete in found:
            self._average(segment, complete)
        self._reader.keep(None if last else self._not_done(segments[-1], found))

    def _average(self, segment: Segment, complete: bool) -> None:
        """Average a segment; at its end, drop blocks after the last complete revolution if there is one."""
        blocks = block_means(
            segment,
            self.smoother,
            kind=self._info.kind,
            frequency_hz=self._info.frequency_hz,
            delay_s=self.delay_s or 0.0,
        )
        if blocks is not None:
            self.blocks.append(blocks)
        if complete:
            self._whole = len(self.blocks)
        elif segment.ends and self._whole > self._begun:
            del self.blocks[self._whole :]
        if segment.ends:
            self._whole = self._begun = len(self.blocks)

    def _settled(self, segments: Sequence[Segment]) -> Iterator[tuple[Segment, bool]]:
        """Yield segments in which the table has settled, and whether each ends after a complete revolution."""
        kind, half = self._info.kind, self.smoother.half
        for segment in segments:
            goes_on, self._goes_on = self._goes_on and segment.first == 0, False
            if segment.samples < _SHORTEST and not goes_on:
                continue
            angle = segment.angle_deg
            first, end, complete = 0, angle.size, kind != "constant_rate"
            if kind in QUIET_KINDS:
                settled = 0 if goes_on else settled_from(angle, self.smoother, _angle_noise_deg(self._meta.bench))
                if settled is None or (settled > end - _SHORTEST and not goes_on):
                    self.unsettled += end
                    continue
                first, self.unsettled = settled, self.unsettled + settled
            if kind == "constant_rate":
                # The smoother loses samples at both ends; complete revolutions are counted between them.
                inside = angle[first + half : end - half]
                if not goes_on:
                    self._turned_deg = 0.0
                if inside.size:
                    count, self._turned_deg, complete = whole_revolutions(inside, self._turned_deg)
                    end = first + count + 2 * half
            self._goes_on = True
            yield segment.cut(first, end), complete

    def _not_done(self, last: Segment, found: Sequence[tuple[Segment, bool]]) -> int | None:
        """Return where the next part continues: after the last block, with the angles near its end; None: nowhere."""
        if self._goes_on:
            segment, _ = found[-1]
            done = places_in(segment, self.smoother, self.delay_s or 0.0)
            return segment.first + int(done.stop - done.start)
        return last.first if last.samples < _SHORTEST else None


def _smoother_for(first: Step, meta: Meta, interval_s: float) -> Smoother:
    """Choose the smoother by the motion in the first part: its size, its largest frequency, the angle's resolution."""
    info, rate_hz = first.info, float(f"{1.0 / interval_s:.9g}")
    rate_rms = 1.0
    if info.kind not in QUIET_KINDS:
        turned = unwrap_deg(first["encoder_deg"][np.isfinite(first["encoder_deg"])])
        coarse = max(1, int(0.1 * rate_hz))
        rate_rms = float(np.std(turned[coarse:] - turned[:-coarse])) * rate_hz / coarse
    return choose_smoother(rate_hz, _band_hz(info, rate_hz), _angle_noise_deg(meta.bench) / max(rate_rms, 0.1))


def _band_hz(info: StepInfo, sample_rate_hz: float) -> float:
    """Return the band in which the rate must be accurate."""
    if info.kind in QUIET_KINDS:
        return min(QUIET_BAND_HZ, sample_rate_hz / 20)
    if info.frequency_hz is not None:
        return info.frequency_hz
    return min(FREE_MOTION_BAND_HZ, sample_rate_hz / 20)


def _angle_noise_deg(bench: BenchFacts) -> float:
    """Return the encoder's quantisation as a standard deviation, deg; 1″ if its counts are not known."""
    if bench.encoder_counts_per_rev > 0:
        return float(360.0 / bench.encoder_counts_per_rev / np.sqrt(12.0))
    return 1.0 / 3600.0


RELATIVE_TOLERANCE = 2e-3
"""Relative deviation that still counts as settled: above eccentricity and ripple, far below a spin-up."""

REST_TOLERANCE_DPS = 0.02
MARGIN_S = 0.1
"""Time left out after the table has settled, so that the gyro's own filter settles too."""

_FEWEST_RATES = 100


def settled_from(angle_deg: FloatArray, smoother: Smoother, angle_noise_deg: float) -> int | None:
    """Return the first sample from which the table keeps its rate, 0 if from the start; None if it never does.

    `angle_deg` are unwrapped angles. The settled rate is the median over the second half. Only the first half is
    searched, so that a later disturbance stays in the data, where robust fits can detect it.
    """
    where = places_of_rate(angle_deg.size, smoother)
    samples = where.stop - where.start
    if samples < 8:
        return None
    # The rate hardly changes within half a window of the smoother.
    every = max(1, min(smoother.half, samples // _FEWEST_RATES))
    rate = rates_at(angle_deg, np.arange(where.start, where.stop, every), smoother)
    second_half = rate[rate.size // 2 :]
    target = float(np.median(second_half))
    tolerance = max(RELATIVE_TOLERANCE * abs(target), REST_TOLERANCE_DPS, 8 * angle_noise_deg * smoother.noise_gain)
    if float(np.mean(np.abs(second_half - target) > tolerance)) > 0.1:
        return None
    off = np.flatnonzero(np.abs(rate[: rate.size // 2] - target) > tolerance)
    if off.size == 0:
        return 0
    return int((off[-1] + 1) * every + 2 * smoother.half + round(MARGIN_S * smoother.sample_rate_hz))


def whole_revolutions(angle_deg: FloatArray, turned_deg: float = 0.0) -> tuple[int, float, bool]:
    """Return how many samples make complete revolutions, from the first on; all of them if there is not even one.

    `turned_deg` is the part of a revolution that was turned before them. Also return the part of a revolution that is
    turned at the next sample, and whether there was a complete one.
    """
    travelled = turned_deg + np.abs(angle_deg - angle_deg[0])
    turns = int(travelled[-1] // 360.0)
    if turns == 0:
        step = float(travelled[-1] - travelled[0]) / max(angle_deg.size - 1, 1)
        return int(angle_deg.size), float(travelled[-1]) + step, False
    count = int(np.searchsorted(travelled, turns * 360.0))
    return count, float(travelled[count]) - turns * 360.0, True
