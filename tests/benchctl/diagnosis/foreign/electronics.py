"""From the gyro's answer to the numbers in the file: filter, clocks, noise, converter, and what happens to data."""

from __future__ import annotations

import numpy as np
from scipy import fft

from tests.benchctl.diagnosis.foreign.benches import Bench
from tests.benchctl.diagnosis.foreign.linear import FloatArray, at_places, low_pass
from tests.benchctl.diagnosis.foreign.motion import PAD_S, POINTS_PER_SAMPLE
from tests.benchctl.diagnosis.foreign.truth import Effects

DYNAMIC = frozenset({"mount_resonance", "sensor_bandwidth", "timing_offset", "clock_drift"})
"""Effects that must be computed between the samples as well."""


def sampled(effects: Effects, answer_v: FloatArray, time_s: FloatArray, sample_rate_hz: float) -> FloatArray:
    """The filtered output at the moments when the gyro's clock takes it; `time_s` are the samples' stamps."""
    dt = 1.0 / (sample_rate_hz * POINTS_PER_SAMPLE)
    if band := effects.get("sensor_bandwidth"):
        answer_v = low_pass(answer_v, band["cutoff_hz"], round(band["order"]), dt)
    taken = time_s * (1.0 + 1e-6 * effects.get("clock_drift", {}).get("ppm", 0.0))
    taken = taken - effects.get("timing_offset", {}).get("offset_s", 0.0)
    return at_places(answer_v, (taken + PAD_S) / dt)


def lines(effects: Effects, time_s: FloatArray, phase_rad: float) -> FloatArray:
    """Mains pick-up (V)."""
    mains = effects.get("mains_pickup")
    if mains is None:
        return np.zeros_like(time_s)
    return mains["amplitude_v"] * np.sin(2.0 * np.pi * mains["frequency_hz"] * time_s + phase_rad)


def noise(effects: Effects, noise_v: float, rate: FloatArray, bench: Bench, rng: np.random.Generator) -> FloatArray:
    """White noise, what grows with the rate, a wandering bias, 1/f (V); `rate` is the true rate at the samples."""
    white = noise_v * rng.standard_normal(rate.size)
    if grows := effects.get("noise_rate_dependent"):
        factor = grows["factor_at_full_rate"]
        white *= np.sqrt(1.0 + (factor**2 - 1.0) * (rate / bench.range_dps) ** 2)
    if walk := effects.get("bias_random_walk"):
        step = walk["v_per_sqrt_s"] / np.sqrt(bench.sample_rate_hz)
        white += np.cumsum(step * rng.standard_normal(rate.size))
    if flicker := effects.get("flicker_noise"):
        white += _one_over_f(flicker["v_rms_per_decade"], rate.size, rng)
    return white


def _one_over_f(v_rms_per_decade: float, count: int, rng: np.random.Generator) -> FloatArray:
    """Noise whose power is the same in every decade of frequency."""
    size = fft.next_fast_len(2 * count, real=True)
    spectrum = fft.rfft(rng.standard_normal(size))
    # White noise of unit rms has the one-sided density 2/rate; in cycles a sample that is wanted here is v²/(ln 10·f).
    frequency = np.arange(1, spectrum.size) / size
    spectrum[1:] *= v_rms_per_decade / np.sqrt(2.0 * np.log(10.0) * frequency)
    spectrum[0] = 0.0
    return np.asarray(fft.irfft(spectrum, size)[:count], dtype=np.float64)


def bent(effects: Effects, output_v: FloatArray) -> FloatArray:
    """What amplifier and converter do to the voltage itself: saturation, integral nonlinearity."""
    if clip := effects.get("saturation"):
        output_v = np.clip(output_v, -clip["limit_v"], clip["limit_v"])
    if inl := effects.get("adc_nonlinearity"):
        output_v = output_v + inl["inl_v"] * np.sin(2.0 * np.pi * output_v / inl["period_v"])
    return output_v


def converted(effects: Effects, output_v: FloatArray, bench: Bench) -> FloatArray:
    """In steps of the converter, clipped at the rated limit."""
    step = bench.lsb_v
    if coarse := effects.get("adc_coarse"):
        step = coarse["step_v"] if "step_v" in coarse else step * 2.0 ** coarse["bits_lost"]
    return np.clip(np.round(output_v / step) * step, -bench.limit_v, bench.limit_v)


def spiked(effects: Effects, output_v: FloatArray, rng: np.random.Generator) -> FloatArray:
    """With isolated spikes of either sign, normal with the deviation `scale_v`."""
    spikes = effects.get("outliers")
    if spikes is None:
        return output_v
    hit = rng.choice(output_v.size, max(1, round(spikes["fraction"] * output_v.size)), replace=False)
    output_v = output_v.copy()
    output_v[hit] += rng.normal(0.0, spikes["scale_v"], hit.size)
    return output_v


def held(effects: Effects, output_v: FloatArray, sample_rate_hz: float, rng: np.random.Generator) -> FloatArray:
    """With stretches in which the last value stands."""
    drops = effects.get("dropouts")
    if drops is None:
        return output_v
    lasts = max(2, round(drops["hold_s"] * sample_rate_hz))
    output_v = output_v.copy()
    slots = rng.choice(output_v.size // (4 * lasts), round(drops["count"]), replace=False)
    for first in slots * 4 * lasts + rng.integers(1, 2 * lasts, slots.size):
        output_v[first : first + lasts] = output_v[first - 1]
    return output_v
