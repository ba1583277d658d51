"""Block means of one unbroken span of samples: what is kept of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from benchctl.calibration.angle_rate import Smoother, derivative_of, mean_derivative_of, places_of_rate
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
_SHORTEST = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Span:
    """Unbroken samples, arrays of shape (n,): stamps, unwrapped angle, output, and which are not to be used."""

    time_s: FloatArray
    angle_deg: FloatArray
    output_v: FloatArray
    bad: BoolArray


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
    """How many samples make a block: at most 40 ms and 1/32 of a cycle in motion, about 15° at constant rates."""
    if kind == "static":
        seconds = REST_BLOCK_S
    elif kind == "constant_rate":
        seconds = min(max(CONSTANT_BLOCK_DEG / max(rate_dps, 1e-6), CONSTANT_BLOCK_S), span_s / 8)
    elif frequency_hz:
        seconds = min(MOTION_BLOCK_S, 1.0 / (BLOCKS_PER_CYCLE * frequency_hz))
    else:
        seconds = MOTION_BLOCK_S
    return max(1, int(seconds * sample_rate_hz))


def delay_of(span: Span, smoother: Smoother) -> float:
    """By how much the output follows the rate, s, from the first few thousand samples; 0 where nothing moves.

    The rate is regressed on the output, its cube and its derivative, all through one smoother, and again at the delay
    found: good to some 10 µs, which is enough for a point to expand about. Not the other way round: the
    derivative of the rate is the noisier one where the encoder is coarse.
    """
    few = slice(0, _DELAY_SAMPLES)
    angle, integral = span.angle_deg[few], _integral(span.output_v[few], smoother.sample_rate_hz)
    output, slope = np.zeros_like(angle), np.zeros_like(angle)
    smooth, where = derivative_of(integral, smoother)
    output[where], slope[where] = smooth, derivative_of(integral, smoother, derivative=2)[0]
    usable = np.zeros(angle.size, dtype=np.bool_)
    usable[where] = np.convolve(span.bad[few], np.ones(2 * smoother.half + 1), mode="valid") < 0.5
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
    """Integral of equidistant samples by a spline: what a sum of samples would be late with, shape (n,)."""
    stamps = np.arange(output.size) / sample_rate_hz
    return np.asarray(CubicSpline(stamps, output).antiderivative()(stamps), dtype=np.float64)


def _smoothed_alike(span: Span, smoother: Smoother) -> tuple[FloatArray, BoolArray]:
    """The output through the filter that the rate has passed, and which samples of it are bad, (n,) each.

    For motion whose band is not known: what the smoother takes from a reversal it then takes from both. The output is
    integrated by a spline and differentiated by the smoother.
    """
    smooth, where = derivative_of(_integral(span.output_v, smoother.sample_rate_hz), smoother)
    output, bad = np.zeros_like(span.output_v), np.ones_like(span.bad)
    output[where] = smooth
    bad[where] = np.convolve(span.bad, np.ones(2 * smoother.half + 1), mode="valid") > 0.5
    return output, bad


def block_means(
    span: Span, smoother: Smoother, *, kind: str, frequency_hz: float | None, delay_s: float
) -> Blocks | None:
    """Cut a span into blocks and average; None where it is too short. Blocks with a bad sample are dropped."""
    moving = kind not in ("static", "constant_rate")
    where = places_in(span, smoother, delay_s)
    samples = where.stop - where.start
    if samples < _SHORTEST:
        return None
    rate = np.empty(0) if kind == "static" else _rates(span, smoother, where, delay_s)
    size = samples_in_block(
        kind,
        frequency_hz,
        float(np.median(np.abs(rate))) if kind == "constant_rate" else 0.0,
        samples / smoother.sample_rate_hz,
        smoother.sample_rate_hz,
    )
    output, bad = span.output_v, span.bad
    if moving and frequency_hz is None:
        output, bad = _smoothed_alike(span, smoother)
    edges = np.linspace(0, samples, max(1, samples // size) + 1).astype(np.int64)
    lengths = np.diff(edges)
    keep = ~np.logical_or.reduceat(bad[where], edges[:-1])
    count = lengths.astype(np.float64)

    def mean(values: Numbers) -> Numbers:
        averaged: Numbers = (np.add.reduceat(values, edges[:-1]) / count)[keep]
        return averaged

    def mean_derivative(derivative: int, delay_s: float) -> FloatArray:
        found = mean_derivative_of(
            span.angle_deg, where.start + edges, smoother, delay_s=delay_s, derivative=derivative
        )
        return found[keep]

    mean_rate = mean_derivative(1, delay_s)
    still = np.zeros(int(keep.sum()))
    variance, acceleration, jerk = still, still, still
    if moving:
        acceleration, jerk = mean_derivative(2, delay_s), mean_derivative(3, delay_s)
    if moving and frequency_hz is not None:
        # Smoothed alike, the output's curvature over a block is mostly the smoother's own; the residual is noise.
        block_rate = np.add.reduceat(rate, edges[:-1]) / count
        variance = mean((rate - np.repeat(block_rate, lengths)) ** 2)
    return Blocks(
        count=count[keep],
        time_s=mean(span.time_s[where]),
        output_v=mean(output[where]),
        rate_dps=mean_rate,
        rate_at_stamp_dps=mean_derivative(1, 0.0) if delay_s else mean_rate,
        rate_variance=variance,
        acceleration_dps2=acceleration,
        jerk_dps3=jerk,
        encoder_basis=np.zeros((still.size, 4))
        if kind == "static"
        else _encoder_basis(span.angle_deg[where], rate, delay_s, mean),
    )


def places_in(span: Span, smoother: Smoother, delay_s: float) -> slice:
    """The samples of a span that its blocks are of: those at which rates stand, both at their stamps and delayed."""
    here = places_of_rate(span.angle_deg.size, smoother)
    there = places_of_rate(span.angle_deg.size, smoother, delay_s)
    first, last = max(here.start, there.start), min(here.stop, there.stop)
    return slice(first, max(first, last))


def _rates(span: Span, smoother: Smoother, where: slice, delay_s: float) -> FloatArray:
    """The rates, delayed, at these samples of a span."""
    rate, there = derivative_of(span.angle_deg, smoother, delay_s=delay_s)
    return rate[where.start - there.start : where.stop - there.start]


def _encoder_basis(
    angle_deg: FloatArray, rate_dps: FloatArray, delay_s: float, mean: Callable[[Numbers], Numbers]
) -> FloatArray:
    """See `ReducedStep.encoder_basis`; `mean` makes block means."""
    around = np.exp(1j * np.deg2rad(angle_deg - rate_dps * delay_s))
    moving = np.deg2rad(rate_dps) / ARCSEC_PER_DEG * around
    once, twice = mean(moving), 2 * mean(moving * around)
    return np.stack([once.real, -once.imag, twice.real, -twice.imag], axis=1)
