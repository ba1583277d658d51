"""Average a recording into rows for regression, as a careful user would."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.interpolate import make_interp_spline
from scipy.signal import savgol_filter

from benchctl.recordings.model import Step
from benchctl.recordings.reader import Recording
from benchctl.signals.normal import QUARTILE
from benchctl.signals.rate import unwrap_deg
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.response_gyro import scaled_v

ROWS_PER_S = 20.0
_NEEDED = ("time_s", "encoder_deg", "gyro_v", "gyro_temp_c")
_FEWEST_ROWS = 1000
_SPIKE = 5.0
_SETTLING_S = 1.0
"""The start of a constant rate is left out: while the table accelerates, no filter of its encoder is accurate."""

_SMOOTHED_S = 10.0
_WINDOW, _DEGREE = 7, 4
"""Savitzky-Golay filter for acceleration and jerk. The rate is the derivative of a fifth-degree spline: plain
differences would be too small by 4 % at 9 Hz."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Rows:
    """Means over short blocks; arrays of shape (n,).

    `residual_v` is the residual of the lab's own model, `step` the index of the step. `noise_v` is the noise of a row,
    from the differences of neighbouring rows at rest after subtraction of the encoder's rate. `k_T_terms` and
    `k_omega_terms` count the terms of the lab's model.
    """

    time_s: FloatArray
    step: IntArray
    angle_deg: FloatArray
    rate_dps: FloatArray
    acceleration_dps2: FloatArray
    jerk_dps3: FloatArray
    warmer_c: FloatArray
    warms_c_per_s: FloatArray
    output_v: FloatArray
    residual_v: FloatArray
    noise_v: float
    range_dps: float
    k_T_terms: int  # noqa: N815 - the key is that of open recordings
    k_omega_terms: int


def rows_of(recording: Recording) -> Rows:
    """Return the rows of a recording whose lab states a model.

    Raises `UsageError` if it states none, or if there are too few samples.
    """
    stated = recording.meta.simulation
    if stated is None:
        raise UsageError(
            f"{recording.path}: its lab states no model, and a regression needs one as a start; pass --no-generic"
        )
    steps = [step for step in recording.steps() if all(name in step.channels for name in _NEEDED)]
    parts = [_averaged(step) for step in steps]
    at_rest = [part for step, part in zip(steps, parts, strict=True) if step.info.kind == "static"]
    if sum(part.shape[1] for part in parts) < _FEWEST_ROWS or not at_rest:
        raise UsageError(
            f"{recording.path}: too few samples in motion, or none at rest, for a regression; say --no-generic"
        )
    place = np.repeat(np.arange(len(parts)), [part.shape[1] for part in parts])
    time_s, angle, rate, acceleration, jerk, celsius, output = np.concatenate(parts, axis=1)
    warmer = celsius - stated["T0_c"]
    believed_v = scaled_v(stated["K0_v_per_dps"], stated["k_T"], stated["k_omega"], rate, warmer) + stated["U0_v"]
    at_rest_v = [part[6] - stated["K0_v_per_dps"] * part[2] for part in at_rest]
    return Rows(
        time_s=time_s - time_s[0],
        step=place,
        angle_deg=angle,
        rate_dps=rate,
        acceleration_dps2=acceleration,
        jerk_dps3=jerk,
        warmer_c=warmer,
        warms_c_per_s=np.gradient(_running_mean(celsius, round(_SMOOTHED_S * ROWS_PER_S)), time_s),
        output_v=output,
        residual_v=output - believed_v,
        noise_v=_white_v(np.concatenate([np.diff(volts) for volts in at_rest_v])),
        range_dps=recording.meta.unit.range_dps or float(np.abs(rate).max()),
        k_T_terms=len(stated["k_T"]),
        k_omega_terms=len(stated["k_omega"]),
    )


def _averaged(step: Step) -> npt.NDArray[np.float64]:
    """Return time, angle, rate, acceleration, jerk, temperature and output; shape (7, rows)."""
    time_s = step["time_s"]
    interval_s = float(np.median(np.diff(time_s)))
    block = max(1, round(1.0 / (ROWS_PER_S * interval_s)))
    count = (time_s.size - 1) // block
    if count < 3 or time_s.size < _WINDOW:
        return np.empty((7, 0))
    angle = unwrap_deg(step["encoder_deg"])
    rate = make_interp_spline(time_s, angle, k=5).derivative()(time_s)
    acceleration, jerk = (savgol_filter(angle, _WINDOW, _DEGREE, deriv=n, delta=interval_s) for n in (2, 3))

    def means(values: FloatArray) -> FloatArray:
        mean: FloatArray = values[: count * block].reshape(count, block).mean(axis=1)
        return mean

    settled = round(_SETTLING_S / (block * interval_s)) if step.info.kind == "constant_rate" else 0
    return np.stack(
        [
            means(time_s),
            means(angle),
            means(rate),
            means(acceleration),
            means(jerk),
            means(step["gyro_temp_c"]),
            means(step["gyro_v"]),
        ]
    )[:, settled:]


def _white_v(differences: FloatArray) -> float:
    """Estimate the white noise from differences of neighbours, shape (n,); spikes and jumps are ignored."""
    usual = np.median(np.abs(differences)) / QUARTILE
    kept = differences[np.abs(differences) <= _SPIKE * usual]
    return max(float(np.sqrt(np.mean(kept**2) / 2.0)), 1e-9)


def _running_mean(values: FloatArray, width: int) -> FloatArray:
    padded = np.pad(values, (width // 2, width - 1 - width // 2), mode="edge")
    mean: FloatArray = np.convolve(padded, np.full(width, 1.0 / width), mode="valid")
    return mean
