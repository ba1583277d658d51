"""The table's true motion: what was commanded, through the servo, with cogging and a slow wander."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import signal

from tests.benchctl.diagnosis.foreign.linear import FloatArray, filtered
from tests.benchctl.diagnosis.foreign.plans import Steps

POINTS_PER_SAMPLE = 8
"""Points of the grid on which the motion is computed, a sample of the recording."""

PAD_S = 2.0
"""Rest before the first and after the last sample (s), for filters and clocks that look beyond."""

_RAMP_S, _ROUNDING_S = 0.5, 0.118
_SERVO_HZ, _SERVO_DAMPING = 25.0, 0.8
_WANDER_DPS, _WANDER_HZ = 0.003, 0.6


@dataclass(frozen=True, slots=True, kw_only=True)
class Cogging:
    """Ripple of the true rate, locked to the angle: rate × (1 + size·cos(order·θ + phase))."""

    order: int
    size: float
    phase_rad: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Motion:
    """Time (s), rate (°/s), acceleration (°/s²) and angle (°, not wrapped), each of shape (n,), every `dt_s`."""

    time_s: FloatArray
    rate_dps: FloatArray
    accel_dps2: FloatArray
    angle_deg: FloatArray
    dt_s: float

    def cut(self, values: FloatArray, sample_rate_hz: float) -> FloatArray:
        """What is known on this grid, at the recording's samples alone."""
        pad = round(PAD_S * sample_rate_hz) * POINTS_PER_SAMPLE
        return values[pad : values.size - pad : POINTS_PER_SAMPLE]

    def at_samples(self, sample_rate_hz: float) -> Motion:
        """The motion at the recording's samples alone."""
        return Motion(
            time_s=self.cut(self.time_s, sample_rate_hz),
            rate_dps=self.cut(self.rate_dps, sample_rate_hz),
            accel_dps2=self.cut(self.accel_dps2, sample_rate_hz),
            angle_deg=self.cut(self.angle_deg, sample_rate_hz),
            dt_s=self.dt_s * POINTS_PER_SAMPLE,
        )


def move(
    steps: Steps, sample_rate_hz: float, *, start_deg: float, cogging: Cogging, rng: np.random.Generator
) -> Motion:
    """The true motion during `steps`, on a grid of `POINTS_PER_SAMPLE` points a sample."""
    dt = 1.0 / (sample_rate_hz * POINTS_PER_SAMPLE)
    pad = round(PAD_S * sample_rate_hz) * POINTS_PER_SAMPLE
    count = round(steps[-1]["t_end"] * sample_rate_hz) * POINTS_PER_SAMPLE + 2 * pad
    time = (np.arange(count) - pad) * dt
    asked = _commanded(steps, time, pad, dt) + _wander(count, sample_rate_hz, rng)
    w = 2.0 * np.pi * _SERVO_HZ
    servo = [1.0, 2.0 * _SERVO_DAMPING * w, w * w]
    asked[0] = 0.0
    rate = filtered([w * w], servo, asked, dt)
    accel = filtered([w * w, 0.0], servo, asked, dt)
    turned = np.concatenate(([0.0], np.cumsum((asked[1:] + asked[:-1]) * (0.5 * dt))))
    angle = start_deg + turned - 2.0 * _SERVO_DAMPING / w * rate - accel / (w * w)
    # Rate × cos(order·angle) has an integral in closed form, so angle and rate agree exactly.
    at = np.deg2rad(cogging.order * angle) + cogging.phase_rad
    ripple, quarter_later = np.cos(at), np.sin(at)
    pull = cogging.size * np.deg2rad(cogging.order)
    return Motion(
        time_s=time,
        rate_dps=rate * (1.0 + cogging.size * ripple),
        accel_dps2=accel * (1.0 + cogging.size * ripple) - pull * rate**2 * quarter_later,
        angle_deg=angle + cogging.size / np.deg2rad(cogging.order) * quarter_later,
        dt_s=dt,
    )


def _commanded(steps: Steps, time: FloatArray, pad: int, dt: float) -> FloatArray:
    """The rate that the controller asks of the servo (°/s): rounded ramps between rates, sines as they are."""
    asked = np.zeros_like(time)
    before = 0.0
    for step in steps:
        first, last = (pad + round(step[edge] / dt) for edge in ("t_start", "t_end"))
        since = time[first:last] - step["t_start"]
        if "frequency_hz" in step:
            asked[first:last] = step["amplitude_dps"] * np.sin(2.0 * np.pi * step["frequency_hz"] * since)
            before = 0.0
            continue
        target = step.get("rate_dps", 0.0)
        asked[first:last] = before + (target - before) * _rounded_ramp(since)
        before = target
    return asked


def _rounded_ramp(since: FloatArray) -> FloatArray:
    """From 0 to 1 in `_RAMP_S`, its corners rounded over `_ROUNDING_S`."""

    def bend(at: float) -> FloatArray:
        late = np.maximum(since - at, 0.0)
        return 0.5 * late * late

    bends = bend(0.0) - bend(_RAMP_S) - bend(_ROUNDING_S) + bend(_RAMP_S + _ROUNDING_S)
    return bends / (_RAMP_S * _ROUNDING_S)


def _wander(count: int, sample_rate_hz: float, rng: np.random.Generator) -> FloatArray:
    """Slow noise of the rate (°/s), of first order, known at each sample and straight between them."""
    samples = count // POINTS_PER_SAMPLE + 2
    keeps = np.exp(-2.0 * np.pi * _WANDER_HZ / sample_rate_hz)
    kicks = rng.normal(0.0, _WANDER_DPS * np.sqrt(1.0 - keeps**2), samples)
    slow = signal.lfilter([1.0], [1.0, -keeps], kicks)
    return np.interp(np.arange(count) / POINTS_PER_SAMPLE, np.arange(samples), slow)
