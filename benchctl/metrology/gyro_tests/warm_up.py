"""Warm-up and thermal ramps: the error of the bias after a turn-on, its duration, and its dependence on dT/dt.

The rest after a turn-on is fitted by c + A·e^(−t/τ), t since the turn-on, with the noise estimated from rest. The unit
is warm when the exponential stays within a stated limit.

The coefficient of bias over the rate of temperature (Shupe) is measured by ramps at rest in both directions, after
removal of bias over temperature. The bias along all ramps is fitted by 1, ΔT, ΔT² and dT/dt together, with the noise
estimated from rest. A delay of the thermometer behind the coil has the same effect to first order, and is included in
the value.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from benchctl.calibration.noise_model import walk_covariance
from benchctl.calibration.uncertainty import K, Mixture
from benchctl.metrology.drift import likeliest, white_variance
from benchctl.metrology.names import UNITS
from benchctl.metrology.observations import Observations, celsius_of, column, dots, refused
from benchctl.metrology.propagation import Offsets, as_read, largest_of, nothing, propagated, scattered, single
from benchctl.metrology.result import Measured, Picture, Trace, Uncertainty, message
from benchctl.metrology.stretches import LEAST_V2
from benchctl.recordings.model import StepInfo
from benchctl.signals.segments import CHANNELS, usable
from benchctl_instruments.arrays import FloatArray

_NAMES = ("warm_up_time", "warm_up_bias")
_SHORTEST_S = 300.0
_MEANS = 120
_FEWEST_SAMPLES = 40
_SURE = 3.0
_DEG_PER_H = 3600.0


def warm_up_tests(obs: Observations) -> Iterator[Measured]:
    """Yield time and size, from the longest rest right after a turn-on."""
    after = [
        (on, rest)
        for on, rest in pairwise(obs.recording.infos)
        if on.kind == "power_cycle" and rest.kind == "static" and rest.whole and rest.t_end - rest.t_start > _SHORTEST_S
    ]
    if not after:
        yield from (refused(name, message("needs_power_on")) for name in _NAMES)
        return
    if obs.reference is None:
        yield from (refused(name, message("needs_scale_factor")) for name in _NAMES)
        return
    on, rest = max(after, key=lambda pair: pair[1].t_end - pair[1].t_start)
    yield from _found(obs, on, rest)


def _found(obs: Observations, on: StepInfo, rest: StepInfo) -> Iterator[Measured]:
    means = _means(obs, rest)
    if means is None:
        yield from (refused(name, message("needs_power_on")) for name in _NAMES)
        return
    time_s, bias, white = means
    time_s = time_s - on.t_end
    (c, amplitude, log_tau), covariance = _exponential(time_s, bias, white, obs)
    within, deviation = obs.settings.warm_deg_per_h, float(np.sqrt(covariance[1, 1]))
    scatter = scattered("scatter", covariance[1:, 1:], "scatter of the means, drift of the bias included")
    sure = abs(amplitude) > _SURE * deviation

    def warm_s(offsets: Offsets) -> FloatArray:
        size = np.abs(amplitude + offsets["scatter"][:, 0])
        tau_s = np.exp(log_tau + offsets["scatter"][:, 1])
        return np.asarray(tau_s * np.log(np.maximum(size / within, 1.0)))

    def off(offsets: Offsets) -> FloatArray:
        return np.asarray(amplitude + offsets["scatter"][:, :1])

    note = message("no_settling_seen")
    if sure:
        note = message("warm_up_law", amplitude=float(amplitude), tau_s=float(np.exp(log_tau)), within=within)
    law = c + amplitude * _decay(time_s, log_tau)
    common = {
        "notes": (note,),
        "temperature_c": celsius_of(rest.chamber_setpoint_c),
        "steps": (on.index, rest.index),
        "picture": Picture(
            x="time_since_on",
            x_unit="s",
            y="bias",
            y_unit="deg/h",
            traces=(
                Trace(label="readings", x=time_s, y=bias, standard=np.sqrt(white)),
                Trace(label="line", x=time_s, y=law, dots=False),
            ),
            left=(Trace(label="misfit", x=time_s, y=bias - law),),
            left_unit="deg/h",
            limited="x",
        ),
    }
    if not sure and abs(amplitude) + K * deviation > within:
        yield refused("warm_up_time", note)
    else:
        value = float(as_read(warm_s, [scatter])) if sure else 0.0
        early = value <= float(time_s[0])
        uncertainty = nothing() if early else propagated(warm_s, [scatter])
        yield _result("warm_up_time", float(time_s[0]) if early else value, uncertainty, early, common)
    yield _result("warm_up_bias", *largest_of(off, [scatter]), False, common)


def _result(name: str, value: float, uncertainty: Uncertainty, at_most: bool, common: dict[str, Any]) -> Measured:
    return Measured(
        name=name,
        unit=UNITS[name],
        value=value,
        uncertainty=uncertainty,
        bound="at most" if at_most else "",
        **common,
    )


def _means(obs: Observations, rest: StepInfo) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """Return times, biases [deg/h] and their variances due to noise; (n,) each. None if there are too few samples."""
    step = obs.recording.step(rest.index, CHANNELS)
    good = usable(step, obs.recording.meta)
    factor = _DEG_PER_H / obs.scale_v_per_dps
    time_s, bias = step["time_s"][good], factor * step["gyro_v"][good]
    if time_s.size < _FEWEST_SAMPLES:
        return None
    parts = np.array_split(np.arange(time_s.size), min(_MEANS, time_s.size // 2))
    return (
        np.array([time_s[part].mean() for part in parts]),
        np.array([bias[part].mean() for part in parts]),
        np.array([max(white_variance(bias[part]) / part.size, factor**2 * LEAST_V2) for part in parts]),
    )


def _decay(time_s: FloatArray, log_tau: float) -> FloatArray:
    """Return e^(−t/τ) averaged over equal means about their middles: times sinh(h)/h, h half a mean's length over τ."""
    half = 0.5 * float(np.median(np.diff(time_s))) / np.exp(log_tau)
    return np.asarray(np.exp(-time_s / np.exp(log_tau)) * np.sinh(half) / half)


def _exponential(
    time_s: FloatArray, bias: FloatArray, white: FloatArray, obs: Observations
) -> tuple[FloatArray, FloatArray]:
    """Return c, A and ln τ with their covariance, (3,) and (3, 3), under white noise and the likeliest bias walk.

    τ is bounded: a settling shorter than half a mean would be over before the first one, and could have any size.
    """
    noise = likeliest(obs.noises)
    walk = noise.walk * (_DEG_PER_H / obs.scale_v_per_dps) ** 2
    wide_s = float(np.median(np.diff(time_s)))
    wiener = walk_covariance(time_s - time_s[0] + wide_s, np.full(time_s.size, wide_s))
    root = np.linalg.cholesky(walk * wiener + noise.excess * np.diag(white))

    def misfit(parameters: FloatArray) -> FloatArray:
        c, amplitude, log_tau = parameters
        return np.asarray(np.linalg.solve(root, bias - c - amplitude * _decay(time_s, log_tau)))

    last = float(bias[-bias.size // 5 :].mean())
    length_s = float(time_s[-1] - time_s[0])
    starts = [(last, float(bias[0]) - last, float(np.log(length_s * share))) for share in (0.05, 0.2, 0.5)]
    bounds = ([-np.inf, -np.inf, np.log(wide_s / 2)], [np.inf, np.inf, np.log(5 * length_s)])
    best = min(
        (least_squares(misfit, start, bounds=bounds, x_scale="jac") for start in starts), key=lambda fit: fit.cost
    )
    slopes = np.asarray(best.jac)
    return best.x, np.linalg.pinv(slopes.T @ slopes)


_RAMPS = "bias_temperature_rate"
_MEAN_S = 30.0
_FEWEST_MEANS = 20
_PER_MINUTE = 60.0


def ramp_tests(obs: Observations) -> Iterator[Measured]:
    """Yield the coefficient of bias over the rate of temperature."""
    ramps = [(info, _ramp_means(obs, info)) for info in obs.recording.infos if _at_rest(info)]
    parts = [part for _, part in ramps if part is not None]
    directions = {np.sign(celsius[-1] - celsius[0]) for _, _, celsius, _, _ in parts}
    if not {1.0, -1.0} <= directions:
        yield refused(_RAMPS, message("needs_ramps"))
        return
    if obs.reference is None:
        yield refused(_RAMPS, message("needs_scale_factor"))
        return
    time_s, output_v, celsius, per_s, white_v2 = (np.concatenate([part[k] for part in parts]) for k in range(5))
    if time_s.size < _FEWEST_MEANS:
        yield refused(_RAMPS, message("needs_ramps"))
        return
    middle_c = celsius - celsius.mean()
    columns = np.stack([np.ones_like(middle_c), middle_c, middle_c**2, per_s], axis=1)
    factor = _DEG_PER_H / _PER_MINUTE / obs.scale_v_per_dps
    solution, variance = _regressed(obs, columns, output_v, time_s, white_v2)
    quantities = [
        scattered("scatter", np.array([[variance]]), "scatter along the ramps, drift of the bias included"),
        single("clock", 1e-6 * obs.stated.clock_ppm.standard, obs.stated.clock_ppm.says),
        single("converter's gain", 1e-6 * obs.stated.gain_ppm.standard, obs.stated.gain_ppm.says),
    ]

    def coefficient(offsets: Offsets) -> FloatArray:
        gain = 1.0 + offsets["converter's gain"][:, 0] + offsets["clock"][:, 0]
        return np.asarray(factor * (solution[3] + offsets["scatter"][:, 0]) * gain)

    without = output_v - columns[:, :3] @ solution[:3]
    yield Measured(
        name=_RAMPS,
        unit=UNITS[_RAMPS],
        value=float(as_read(coefficient, quantities)),
        uncertainty=propagated(coefficient, quantities),
        notes=(message("lag_included"),),
        temperature_c=float(celsius.mean()),
        steps=tuple(info.index for info, part in ramps if part is not None),
        picture=dots(
            column("temperature_rate", "degC/min", _PER_MINUTE * per_s),
            column("bias", "deg/h", _DEG_PER_H * without / obs.scale_v_per_dps),
            standard=_DEG_PER_H * np.sqrt(white_v2) / abs(obs.scale_v_per_dps),
        ),
    )


def _regressed(
    obs: Observations, columns: FloatArray, output_v: FloatArray, time_s: FloatArray, white_v2: FloatArray
) -> tuple[FloatArray, float]:
    """Return coefficients (p,) of the columns (n, p) and the variance of the last, over all walks that rest allows."""
    wiener = walk_covariance(time_s - time_s.min() + _MEAN_S, np.full(time_s.size, _MEAN_S))
    found, breads = [], []
    for noise, _ in obs.noises:
        root = np.linalg.cholesky(noise.walk * wiener + noise.excess * np.diag(white_v2))
        white, target = (np.linalg.solve(root, one) for one in (columns, output_v))
        bread = np.linalg.inv(white.T @ white)
        found.append(bread @ (white.T @ target))
        breads.append(bread)
    weights = np.array([weight for _, weight in obs.noises])
    mixture = Mixture(weights=weights, means=np.array(found), covariances=np.array(breads))
    return mixture.mean, float(mixture.covariance[-1, -1])


def _at_rest(info: StepInfo) -> bool:
    return info.kind == "thermal_ramp" and info.whole and not info.rate_dps and not info.amplitude_dps


def _ramp_means(obs: Observations, info: StepInfo) -> tuple[FloatArray, ...] | None:
    """Return means over half a minute: time, volts, °C, °C/s, and the variance of the volts; (n,) each.

    None if output or thermistor is missing, or there are fewer than two means.
    """
    step = obs.recording.step(info.index, CHANNELS)
    if not {"gyro_v", "gyro_temp_c"} <= step.channels.keys():
        return None
    time_s, output_v, celsius = step["time_s"], step["gyro_v"], step["gyro_temp_c"]
    good = usable(step, obs.recording.meta) & np.isfinite(celsius)
    time_s, output_v, celsius = time_s[good], output_v[good], celsius[good]
    count = 0 if time_s.size == 0 else min(int((time_s[-1] - time_s[0]) / _MEAN_S), time_s.size // 2)
    if count < 2:
        return None
    parts = np.array_split(np.arange(time_s.size), count)
    time, volts, warm = (np.array([one[part].mean() for part in parts]) for one in (time_s, output_v, celsius))
    white = np.array([white_variance(output_v[part]) / part.size for part in parts])
    return time, volts, warm, np.gradient(warm, time), np.maximum(white, LEAST_V2)
