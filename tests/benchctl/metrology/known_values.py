"""What each test must find of a made unit, by the definitions, without noise and by other code than the product's."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tests.benchctl.metrology.made_unit import EARTH_DPS, LATITUDE_DEG, ROOM_C, Made

PER_H = 3600.0
EARTH_VERTICAL_DPS = EARTH_DPS * np.sin(np.deg2rad(LATITUDE_DEG))


LINEARITY_PERCENT = 0.1
"""Of the input range: where the error of reading of a made unit passes it."""


def known_values(
    made: Made, rates: int, set_points_c: Sequence[float], frequency_hz: float, rest_s: float
) -> dict[str, float]:
    """By the tests' names, in the units in which they are stated.

    Of the acceptance procedure with so many rates in its sweep, these set points in their order, the lowest
    frequency of its sines, and the length of its rest.
    """
    unit = made.unit
    levels = unit.top_dps * np.arange(1, rates + 1) / rates
    first_scale, first_bias = made.turn_ons[0]
    k = unit.K_v_per_dps * (1.0 + first_scale)

    def output(rate: np.ndarray, leg: float) -> np.ndarray:
        curved = unit.straight(rate + EARTH_VERTICAL_DPS)
        share = (1.0 - (rate / unit.top_dps) ** 2) * (rate != 0.0)
        return k * (curved + 0.5 * leg * unit.hysteresis * unit.top_dps * share) + unit.U0_v + first_bias

    up = np.concatenate([levels, -levels])
    down = np.concatenate([levels[:-1], -levels[:-1]])
    rate = np.concatenate([[0.0], up, down])
    volts = np.concatenate([output(np.zeros(1), 0.0), output(up, 1.0), output(down, -1.0)])
    slope, intercept = np.polyfit(rate, volts, 1)
    low, high = np.abs(rate) <= 40.0, np.abs(rate) > 8.0
    low_slope, low_intercept = np.polyfit(rate[low], volts[low], 1)
    reading = 100.0 * np.abs((volts[high] - low_intercept) / (low_slope * rate[high]) - 1.0)
    plus, minus = (np.polyfit(rate[side], volts[side], 1)[0] for side in (rate > 0, rate < 0))
    cycles = np.array(made.turn_ons)
    cycle_slopes = unit.K_v_per_dps * (1.0 + cycles[:, 0])
    phase = np.arctan(frequency_hz / unit.cutoff_hz) + 2.0 * np.pi * frequency_hz * unit.delay_s
    warm_up = PER_H * unit.warm_up_v / slope
    return {
        "scale_factor": 1e3 * slope,
        "nonlinearity": 1e6 * np.max(np.abs(volts - slope * rate - intercept)) / np.max(np.abs(volts - intercept)),
        "nonlinearity_reading": np.max(reading),
        "asymmetry": 2e6 * abs(plus - minus) / (plus + minus),
        "input_range": _where_passed(np.abs(rate[high]), reading),
        "hysteresis_rate": 1e6 * unit.hysteresis * (1.0 - 1.0 / rates**2) * k / slope,
        "scale_factor_repeatability": 1e6 * np.std(cycle_slopes, ddof=1) / np.mean(cycle_slopes),
        "bias_repeatability": PER_H * np.std(cycles[:, 1], ddof=1) / slope,
        "hysteresis_temperature_scale": 1e6 * unit.thermal_scale,
        "hysteresis_temperature_bias": PER_H * unit.thermal_bias_v / slope,
        "bias_temperature_rate": 60.0 * unit.shupe_v_s_per_c / slope,
        "misalignment": 1e3 * unit.misalignment_rad,
        "bias_stability": PER_H
        / slope
        * np.hypot(unit.white_v_per_sqrt_hz / 10**0.5, unit.walk_v_per_sqrt_s * (rest_s / 6) ** 0.5),
        "angle_random_walk": 60.0 * unit.white_v_per_sqrt_hz / slope,
        "rate_random_walk": PER_H * 60.0 * unit.walk_v_per_sqrt_s / slope,
        "bandwidth": unit.cutoff_hz,
        "delay": 1e3 * phase / (2.0 * np.pi * frequency_hz),
        "warm_up_bias": warm_up,
        "warm_up_time": unit.warm_up_tau_s * np.log(warm_up / 10.0),
        # at rest the Earth's rate lies inside the dead zone, and the one or the other direction has further to go
        "threshold": PER_H * 2.0 * (unit.dead_dps + EARTH_VERTICAL_DPS + 0.5 * unit.hysteresis * unit.top_dps),
        "dead_zone": PER_H * 2.0 * unit.dead_dps,
        "bias": PER_H * ((unit.U0_v + first_bias + (made.walked_v or 0.0)) / slope - EARTH_VERTICAL_DPS),
        **_over_temperature(made, set_points_c, slope),
    }


def _where_passed(rates: np.ndarray, errors: np.ndarray) -> float:
    sizes = np.unique(rates)
    largest = np.maximum.accumulate([errors[rates == size].max() for size in sizes])
    first = int(np.argmax(largest > LINEARITY_PERCENT))
    share = (LINEARITY_PERCENT - largest[first - 1]) / (largest[first] - largest[first - 1])
    return float(sizes[first - 1] + share * (sizes[first] - sizes[first - 1]))


def _over_temperature(made: Made, set_points_c: Sequence[float], slope: float) -> dict[str, float]:
    unit, before_c = made.unit, ROOM_C
    (first_scale, first_bias), (last_scale, last_bias) = made.turn_ons[0], made.turn_ons[-1]
    scales, biases = [], []
    for celsius in set_points_c:
        leg, warm = (1.0 if celsius > before_c else -1.0), celsius - ROOM_C
        before_c = celsius
        if abs(warm) > 5.0:
            scale = 1.0 + last_scale + unit.scale_per_c * warm + 0.5 * leg * unit.thermal_scale
            bias = unit.bias_v_per_c * warm + unit.bias_v_per_c2 * warm**2 + 0.5 * leg * unit.thermal_bias_v
            scales.append(1e6 * abs(scale / (1.0 + first_scale) - 1.0) / abs(warm))
            biases.append(PER_H * abs(bias + last_bias - first_bias) / slope / abs(warm))
    return {"scale_factor_temperature": max(scales), "bias_temperature": max(biases)}
