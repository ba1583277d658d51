"""Compare the table's motion with the demand of a step, using only the encoder count of the digitizer."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from benchctl.bench import Bench
from benchctl.plan import ConstantRate, Sine, Step, ThermalRamp
from benchctl_instruments.arrays import FloatArray, IntArray

LOOK_S = 0.05
"""Averaging time of a rate: over this time, one count of a coarse encoder is only a small rate."""

ERROR_SHARE = 0.025
"""Maximum contribution of encoder errors to an acceleration, as a share of the bench's limit: half of the margin."""

HELD_S = 0.5
"""Averaging time of a rate that is compared with the demand; a quarter of a sine's period if that is shorter."""

SETTLED_S = 1.0
"""Time allowed after a demand until a rate is held; a sine is allowed `RISE_CYCLES` periods more."""

RISE_CYCLES = 3.0
"""Two periods in which our drivers raise an amplitude, and up to one more until a controller ends this at a zero."""

AMPLITUDE_SHARE = 0.5
"""Allowed relative deviation of a sine's amplitude: a servo has limited bandwidth, and overshoots below it."""


class MeanRates:
    """Mean rates [deg/s] over consecutive windows of `window_scans`, which may be fractional.

    Counts are fed in blocks of any size. A rate across a gap is NaN.
    """

    def __init__(self, bench: Bench, rate_hz: float, window_scans: float) -> None:
        self._per_s = bench.digitizer.degrees_per_count * rate_hz
        self._window = window_scans
        self._windows = self._next_index = 0
        self._edge, self._edge_count = -1, math.nan  # where the last window ended

    def feed(self, first_index: int, count: IntArray) -> list[tuple[int, float]]:
        """Return, for each window that ends in this block, the index of its last scan and its rate."""
        if first_index != self._next_index:
            self._edge_count = math.nan
        self._next_index = first_index + len(count)
        found = []
        while (edge := int(self._windows * self._window)) < self._next_index:
            here = float(count[edge - first_index]) if edge >= first_index else math.nan
            found.append((edge, (here - self._edge_count) * self._per_s / (edge - self._edge)))
            self._edge, self._edge_count = edge, here
            self._windows += 1
        return found


class EncoderMotion:
    """Computes rates and accelerations from the counts of one stream, block by block.

    An acceleration is the change of the mean rate from one interval to the next, divided by the length T of the
    interval. It is a weighted mean of the true acceleration and never exceeds its peak. An angle error e, from rounding
    or from the encoder's accuracy, contributes up to 4·e/T²; T is long enough to keep this below `ERROR_SHARE` of the
    bench's limit. For 360,000 counts per revolution and 1500 deg/s², T is `LOOK_S`, and rounding contributes up to 0.8
    deg/s².

    Parameters
    ----------
    bench
        The bench with the encoder and the acceleration limit.
    rate_hz
        Scans per second.
    """

    def __init__(self, bench: Bench, rate_hz: float) -> None:
        self._degrees_per_count, self._rate_hz = bench.digitizer.degrees_per_count, rate_hz
        longer_s = math.sqrt(4.0 * _error_deg(bench) / (ERROR_SHARE * bench.limits.acceleration_dps2))
        self._rates = MeanRates(bench, rate_hz, max(1, round(LOOK_S * rate_hz)))
        self._stride = max(1, math.ceil(max(LOOK_S, longer_s) * rate_hz))
        self._tail = np.empty(0, dtype=np.int64)
        self._next_index = 0

    def rates_dps(self, first_index: int, count: IntArray) -> FloatArray:
        """Return mean rates over `LOOK_S` each, without those across a gap."""
        return np.array([rate for _, rate in self._rates.feed(first_index, count) if not math.isnan(rate)])

    def accelerations_dps2(self, first_index: int, count: IntArray) -> FloatArray:
        """Return the accelerations up to each of these scans; earlier scans are used if there is no gap between."""
        if first_index != self._next_index:
            self._tail = self._tail[:0]
        self._next_index = first_index + len(count)
        known, stride = np.concatenate((self._tail, count)), self._stride
        self._tail = known[-2 * stride :]
        bends = known[2 * stride :] - 2 * known[stride:-stride] + known[: -2 * stride]
        per_s = self._rate_hz / stride
        return bends.astype(np.float64) * (self._degrees_per_count * per_s * per_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Deviation:
    """A deviation from the demand at scan number `index`: of a rate, or of the `amplitude` of a sine."""

    index: int
    quantity: str
    demanded_dps: float
    measured_dps: float
    tolerance_dps: float


class HeldMotion:
    """Compares the encoder's rate with a step's demand, within `limits.motion_error_dps` and `_percent` of a bench.

    A constant rate, or rest, is compared window by window. The phase of a sine is not known, so its windows are
    compared with each other: the rate half a period later must be the opposite one, and a rate and the rate a quarter
    of a period before it must combine to the amplitude. The contribution of encoder errors to a rate is added to the
    tolerance.
    """

    def __init__(self, bench: Bench, step: Step, rate_hz: float) -> None:
        self._rate_dps, self._amplitude_dps, frequency_hz = demand_of(step)
        settle_s = float(getattr(step, "settle_s", 0.0))
        if self._amplitude_dps:
            period_s = 1.0 / frequency_hz
            parts = 4 * max(1, math.ceil(period_s / (4.0 * HELD_S)))
            window = period_s * rate_hz / parts
            half = parts // 2
            self._seen_share = float(np.sinc(1.0 / parts))  # share of the amplitude in means over a window
            settle_s += getattr(step, "settle_cycles", 0) * period_s
            settled_s = SETTLED_S + RISE_CYCLES * period_s
            between_edges = 2.0 * math.pi * frequency_hz / rate_hz  # windows end at scans: phase error [rad]
        else:
            window = min(HELD_S, 0.5 * step.streamed_s) * rate_hz
            half, self._seen_share, settled_s, between_edges = 0, 1.0, SETTLED_S, 0.0
        self._windows = MeanRates(bench, rate_hz, window) if window >= 2.0 else None
        self._from_index = max(0.0, settled_s - settle_s) * rate_hz + window
        self._before = deque([math.nan] * half, maxlen=half)  # the rates of the last half period
        limits, demand_dps = bench.limits, abs(self._rate_dps) + self._amplitude_dps
        share = limits.motion_error_percent / 100.0
        error_dps = between_edges * self._amplitude_dps + 2.0 * _error_deg(bench) * rate_hz / window
        self._tolerance_dps = limits.motion_tolerance_dps(demand_dps) + error_dps
        granted_dps = max(limits.motion_error_dps, max(AMPLITUDE_SHARE, share) * self._amplitude_dps)
        self._amplitude_tolerance_dps = granted_dps + math.sqrt(2.0) / self._seen_share * error_dps  # of two rates

    def look(self, first_index: int, count: IntArray) -> Deviation | None:
        """Return the first deviation in this block, or None."""
        found = self._windows.feed(first_index, count) if self._windows is not None else ()
        deviations = (self._held(index, rate) for index, rate in found if index >= self._from_index)
        return next(filter(None, deviations), None)

    def _held(self, index: int, rate_dps: float) -> Deviation | None:
        if not self._before.maxlen:
            return _deviation(index, "rate", self._rate_dps, rate_dps, self._tolerance_dps)
        opposite, quarter = self._before[0], self._before[self._before.maxlen // 2]
        self._before.append(rate_dps)
        amplitude_dps = math.hypot(rate_dps, quarter) / self._seen_share
        return _deviation(
            index, "amplitude", self._amplitude_dps, amplitude_dps, self._amplitude_tolerance_dps
        ) or _deviation(index, "rate", -opposite, rate_dps, 2.0 * self._tolerance_dps)


def _deviation(index: int, quantity: str, demanded: float, measured: float, tolerance: float) -> Deviation | None:
    if not abs(measured - demanded) > tolerance:  # NaN is not a deviation
        return None
    return Deviation(
        index=index, quantity=quantity, demanded_dps=demanded, measured_dps=measured, tolerance_dps=tolerance
    )


def demand_of(step: Step) -> tuple[float, float, float]:
    """Return the rate [deg/s], or a sine's peak rate [deg/s] and frequency [Hz], that a step demands; else 0."""
    if isinstance(step, Sine):
        return 0.0, abs(step.amplitude_dps), step.frequency_hz
    if isinstance(step, ThermalRamp) and step.swing_dps:
        return 0.0, abs(step.swing_dps), step.swing_hz
    return (step.rate_dps if isinstance(step, ConstantRate | ThermalRamp) else 0.0), 0.0, 0.0


def _error_deg(bench: Bench) -> float:
    return max(0.5 * abs(bench.digitizer.degrees_per_count), bench.digitizer.encoder_accuracy_arcsec / 3600.0)
