"""Bias over the rate of temperature (Shupe): by ramps at rest in both directions, once bias over temperature is off.

The bias along all ramps is fitted by 1, ΔT, ΔT² and dT/dt together, under the noise that rest shows. A thermometer that
follows the coil late looks the same to first order, and is part of the value.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from benchctl.calibration.noise_model import walk_covariance
from benchctl.calibration.uncertainty import Mixture
from benchctl.metrology.drift import white_variance
from benchctl.metrology.names import UNITS
from benchctl.metrology.observations import Observations, column, dots, refused
from benchctl.metrology.propagation import Offsets, as_read, propagated, scattered, single
from benchctl.metrology.result import Measured, message
from benchctl.metrology.stretches import LEAST_V2
from benchctl.recordings.model import StepInfo
from benchctl_instruments.arrays import FloatArray

_NAME = "bias_temperature_rate"
_MEAN_S = 30.0
_FEWEST = 20
_DEG_PER_H, _PER_MINUTE = 3600.0, 60.0


def ramp_tests(obs: Observations) -> Iterator[Measured]:
    """The one result."""
    ramps = [(info, _means(obs, info)) for info in obs.recording.infos if _at_rest(info)]
    parts = [part for _, part in ramps if part is not None]
    directions = {np.sign(celsius[-1] - celsius[0]) for _, _, celsius, _, _ in parts}
    if not {1.0, -1.0} <= directions:
        yield refused(_NAME, message("needs_ramps"))
        return
    if obs.reference is None:
        yield refused(_NAME, message("needs_scale_factor"))
        return
    time_s, output_v, celsius, per_s, white_v2 = (np.concatenate([part[k] for part in parts]) for k in range(5))
    if time_s.size < _FEWEST:
        yield refused(_NAME, message("needs_ramps"))
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
        name=_NAME,
        unit=UNITS[_NAME],
        value=float(as_read(coefficient, quantities)),
        uncertainty=propagated(coefficient, quantities),
        notes=(message("lag_included"),),
        temperature_c=float(celsius.mean()),
        steps=tuple(info.index for info, part in ramps if part is not None),
        picture=dots(
            column("temperature_rate", "degC/min", _PER_MINUTE * per_s),
            column("bias", "deg/h", _DEG_PER_H * without / obs.scale_v_per_dps),
        ),
    )


def _regressed(
    obs: Observations, columns: FloatArray, output_v: FloatArray, time_s: FloatArray, white_v2: FloatArray
) -> tuple[FloatArray, float]:
    """Coefficients of the columns (n, p), shape (p,), and the variance of the last: over all walks that rest allows."""
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


def _means(obs: Observations, info: StepInfo) -> tuple[FloatArray, ...] | None:
    """Means over half a minute: time, volts, °C, °C/s, and the variance of the volts; (n,) each.

    None where output or thermistor are missing, or there are no two means.
    """
    step = obs.recording.step(info.index, ("time_s", "gyro_v", "gyro_temp_c"))
    if not {"gyro_v", "gyro_temp_c"} <= step.channels.keys():
        return None
    time_s, output_v, celsius = step["time_s"], step["gyro_v"], step["gyro_temp_c"]
    good = np.isfinite(output_v) & np.isfinite(celsius)
    time_s, output_v, celsius = time_s[good], output_v[good], celsius[good]
    count = 0 if time_s.size == 0 else min(int((time_s[-1] - time_s[0]) / _MEAN_S), time_s.size // 2)
    if count < 2:
        return None
    parts = np.array_split(np.arange(time_s.size), count)
    time, volts, warm = (np.array([one[part].mean() for part in parts]) for one in (time_s, output_v, celsius))
    white = np.array([white_variance(output_v[part]) / part.size for part in parts])
    return time, volts, warm, np.gradient(warm, time), np.maximum(white, LEAST_V2)
