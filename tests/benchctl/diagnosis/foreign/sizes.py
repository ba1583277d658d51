"""How large each effect of the vocabulary is on a believable unit, and what makes it `size` times as large."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from tests.benchctl.diagnosis.foreign.benches import Bench

Number = dict[str, float]
Draw = Callable[[np.random.Generator, Bench, float], Number]

_WARM_C = 40.0
"""A temperature's distance from T0 that every plan reaches (°C)."""


def _about(rng: np.random.Generator, low: float, high: float) -> float:
    """Between `low` and `high`, evenly in the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def _either(rng: np.random.Generator, low: float, high: float) -> float:
    """The same with either sign."""
    return _about(rng, low, high) * float(rng.choice((-1.0, 1.0)))


def _rate_nonlinearity(rng: np.random.Generator, bench: Bench, size: float) -> Number:
    full = bench.range_dps
    return {"c2": size * _either(rng, 0.02, 0.06) / full**2, "c4": size * _either(rng, 0.008, 0.025) / full**4}


def _scale_temperature(rng: np.random.Generator, bench: Bench, size: float) -> Number:
    return {"a1": size * _either(rng, 6e-5, 3e-4), "a2": size * _either(rng, 5e-7, 2.5e-6)}


def _thermal_hysteresis(rng: np.random.Generator, bench: Bench, size: float) -> Number:
    width = _about(rng, 2.0, 9.0)
    return {"width_c": width, "fraction_per_c": size * _either(rng, 6e-4, 2.5e-3) / width}


def _bias_temperature(rng: np.random.Generator, bench: Bench, size: float) -> Number:
    full = size * bench.full_scale_v
    return {
        "c1_v_per_c": full * _either(rng, 8e-4, 4e-3) / _WARM_C,
        "c2_v_per_c2": full * _either(rng, 5e-4, 2e-3) / _WARM_C**2,
    }


def _heading_dependent_bias(rng: np.random.Generator, bench: Bench, size: float) -> Number:
    order = int(rng.choice((1, 1, 2)))
    amplitude = size * bench.full_scale_v * _about(rng, 2e-4, 1.2e-3)
    return {"amplitude_v": amplitude, "phase_deg": rng.uniform(0.0, 360.0 / order), "order": order}


def _encoder_eccentricity(rng: np.random.Generator, bench: Bench, size: float) -> Number:
    order = int(rng.choice((1, 1, 2)))
    return {
        "amplitude_arcsec": size * _about(rng, 30.0, 120.0),
        "phase_deg": rng.uniform(0.0, 360.0 / order),
        "order": order,
    }


def _sensor_bandwidth(rng: np.random.Generator, bench: Bench, size: float) -> Number:
    return {"cutoff_hz": _about(rng, 12.0, 40.0) / size, "order": int(rng.integers(1, 3))}


def _mount_resonance(rng: np.random.Generator, bench: Bench, size: float) -> Number:
    # Below the resonance the rate is wrong by (f/f_mount)².
    return {"frequency_hz": _about(rng, 14.0, 40.0) / size**0.5, "damping": _about(rng, 0.03, 0.2)}


def _mains_pickup(rng: np.random.Generator, bench: Bench, size: float) -> Number:
    amplitude = size * bench.noise_v * _about(rng, 0.3, 2.0)
    mains_hz = 50.0 + rng.uniform(-0.08, 0.08)
    # As it stands in the samples: the mains themselves, folded at half the sample rate, or another line.
    folded = min(mains_hz, bench.sample_rate_hz - mains_hz)
    other = rng.uniform(11.0, 0.47 * bench.sample_rate_hz)
    return {"amplitude_v": amplitude, "frequency_hz": float(rng.choice((folded, other)))}


DRAWS: dict[str, Draw] = {
    "rate_nonlinearity": _rate_nonlinearity,
    "scale_temperature": _scale_temperature,
    "scale_asymmetry": lambda rng, bench, size: {"fraction": size * _either(rng, 5e-4, 4e-3)},
    "scale_rate_temperature_coupling": lambda rng, bench, size: {
        "coefficient": size * _either(rng, 1e-3, 5e-3) / (_WARM_C * bench.range_dps**2)
    },
    "scale_warm_up": lambda rng, bench, size: {
        "fraction": size * _either(rng, 2e-3, 8e-3),
        "tau_s": _about(rng, 200.0, 900.0),
    },
    "scale_ageing": lambda rng, bench, size: {"per_hour": size * _either(rng, 1e-3, 8e-3)},
    "thermal_hysteresis": _thermal_hysteresis,
    "saturation": lambda rng, bench, size: {"limit_v": bench.full_scale_v * (1.0 - size * rng.uniform(0.06, 0.25))},
    "dead_zone": lambda rng, bench, size: {"half_width_dps": size * _about(rng, 0.05, 0.5)},
    "rate_squared": lambda rng, bench, size: {
        "v_per_dps2": size * bench.full_scale_v * _either(rng, 5e-4, 4e-3) / bench.range_dps**2
    },
    "fringe_ambiguity": lambda rng, bench, size: {"fold_dps": bench.range_dps * (1.0 - size * rng.uniform(0.05, 0.25))},
    "bias_temperature": _bias_temperature,
    "bias_temperature_rate": lambda rng, bench, size: {
        "v_per_c_per_s": size * bench.full_scale_v * _either(rng, 5e-4, 3e-3) / 0.08
    },
    "warm_up": lambda rng, bench, size: {
        "amplitude_v": size * bench.full_scale_v * _either(rng, 5e-4, 3e-3),
        "tau_s": _about(rng, 150.0, 900.0),
    },
    "bias_drift": lambda rng, bench, size: {"v_per_hour": size * bench.full_scale_v * _either(rng, 5e-4, 3e-3)},
    "bias_random_walk": lambda rng, bench, size: {"v_per_sqrt_s": size * bench.noise_v * _about(rng, 0.04, 0.25)},
    "flicker_noise": lambda rng, bench, size: {"v_rms_per_decade": size * bench.noise_v * _about(rng, 0.15, 0.6)},
    "heading_dependent_bias": _heading_dependent_bias,
    "thermal_lag": lambda rng, bench, size: {"tau_s": size * _about(rng, 200.0, 900.0)},
    "angular_acceleration": lambda rng, bench, size: {
        "v_per_dps2": size * bench.k0_v_per_dps * _either(rng, 1e-3, 6e-3)
    },
    "mount_resonance": _mount_resonance,
    "sensor_bandwidth": _sensor_bandwidth,
    "mains_pickup": _mains_pickup,
    "adc_nonlinearity": lambda rng, bench, size: {
        "inl_v": size * bench.noise_v * _about(rng, 1.0, 5.0),
        "period_v": bench.full_scale_v * rng.uniform(0.15, 1.0),
    },
    "adc_coarse": lambda rng, bench, size: {"bits_lost": max(1, round(rng.integers(2, 6) + np.log2(size)))},
    "timing_offset": lambda rng, bench, size: {"offset_s": size * _either(rng, 1.5e-3, 1e-2)},
    "clock_drift": lambda rng, bench, size: {"ppm": size * _either(rng, 8.0, 80.0)},
    "encoder_eccentricity": _encoder_eccentricity,
    "encoder_interpolation": lambda rng, bench, size: {
        "amplitude_arcsec": size * _about(rng, 1.0, 6.0),
        "lines_per_rev": int(rng.choice((2048, 3600, 5000, 9000))),
    },
    "outliers": lambda rng, bench, size: {
        "fraction": size * _about(rng, 2e-4, 2e-3),
        "scale_v": _about(rng, 0.03, 0.4),
    },
    "dropouts": lambda rng, bench, size: {
        "count": max(1, round(size * rng.integers(5, 20))),
        "hold_s": rng.uniform(0.3, 2.0),
    },
    "noise_rate_dependent": lambda rng, bench, size: {
        "factor_at_full_rate": 1.0 + size * _about(rng, 0.4, 2.5),
    },
    "supply_sensitivity": lambda rng, bench, size: {
        "fraction_per_v": size * _either(rng, 5e-3, 4e-2),
        "v_per_v": size * bench.full_scale_v * _either(rng, 3e-3, 2e-2),
    },
}
"""Every effect of the vocabulary; the supply is recorded where it matters."""


def outsider(name: str, rng: np.random.Generator, bench: Bench, lasts_s: float) -> Number:
    """The numbers of an effect outside the vocabulary, large enough to be seen."""
    full = bench.full_scale_v
    accel = 600.0 / 145.0 * bench.range_dps
    drawn: dict[str, Callable[[], Number]] = {
        "rate_hysteresis": lambda: {
            "half_width_dps": bench.range_dps * rng.uniform(0.03, 0.15),
            "fraction": _either(rng, 0.002, 0.02),
        },
        "temperature_rate_squared": lambda: {"v_per_c2_per_s2": full * _either(rng, 2e-4, 1.5e-3) / 0.08**2},
        "angle_by_temperature": lambda: {
            "order": int(rng.integers(1, 4)),
            "per_c": _about(rng, 3e-5, 1.2e-4),
            "phase_rad": rng.uniform(0.0, 6.28),
        },
        "acceleration_squared": lambda: {"v_per_dps2_2": full * _either(rng, 5e-3, 3e-2) / accel**2},
        "acceleration_cubed": lambda: {"v_per_dps2_3": full * _either(rng, 5e-3, 3e-2) / accel**3},
        "bump": lambda: {
            "amplitude_v": full * _either(rng, 6e-4, 3e-3),
            "at_s": rng.uniform(0.15, 0.85) * lasts_s,
            "width_s": _about(rng, 15.0, 120.0),
        },
        "jump": lambda: {"amplitude_v": full * _either(rng, 4e-4, 2e-3), "at_s": rng.uniform(0.2, 0.8) * lasts_s},
        "swing": lambda: {"amplitude_v": full * _about(rng, 4e-4, 1.5e-3), "period_s": _about(rng, 60.0, 300.0)},
        "temperature_dip": lambda: {
            "fraction": _either(rng, 2e-3, 8e-3),
            "above_t0_c": rng.uniform(-35.0, 20.0),
            "width_c": _about(rng, 3.0, 8.0),
        },
        "rate_wave": lambda: {
            "amplitude_v": full * _about(rng, 4e-4, 2e-3),
            "period_dps": bench.range_dps * rng.uniform(0.2, 0.6),
            "phase_rad": rng.uniform(0.0, 6.28),
        },
    }
    return drawn[name]()
