"""A gyro that follows a calibration exactly, without any other effect.

    U = U0 + K0·k(T)·k(ω)·ω + n,    k(T) = 1 + a1·ΔT + a2·ΔT² + …,    k(ω) = 1 + b2·ω² + b4·ω⁴ + …

with ΔT = T − T0, T the temperature of the gyro's thermistor, ω the table's rate and n white noise (the paper's model;
open recordings contain it as their `simulation`). The Earth's rate is part of U0, as in the calibration; the output has
no low-pass, and the coil has the thermistor's temperature unless an effect changes it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chain import Baseline, Signals


@dataclass(frozen=True, slots=True, kw_only=True)
class ResponseParameters:
    """The response: `k_T` = (a1, a2, …) [°C⁻¹, °C⁻², …], `k_omega` = (b2, b4, …) [(°/s)⁻², (°/s)⁻⁴, …].

    `noise_v_rms` is the standard deviation of each sample at any sample rate; the output is limited to
    ±`output_limit_v`.
    """

    K0_v_per_dps: float
    U0_v: float
    T0_c: float
    k_T: tuple[float, ...]  # noqa: N815 - the letters of the model
    k_omega: tuple[float, ...]
    noise_v_rms: float
    output_limit_v: float

    def __post_init__(self) -> None:
        if self.noise_v_rms < 0.0 or self.output_limit_v <= 0.0:
            raise UsageError(
                f"a noise of {self.noise_v_rms} V and an output limit of {self.output_limit_v} V;"
                " give a noise of 0 or more and a limit above 0"
            )


def response_v(parameters: ResponseParameters, rate_dps: FloatArray, temperature_c: FloatArray) -> FloatArray:
    """Return K0·k(T)·k(ω)·ω [V], without the bias, for rates [deg/s] and temperatures [°C], all of shape (n,)."""
    return scaled_v(
        parameters.K0_v_per_dps, parameters.k_T, parameters.k_omega, rate_dps, temperature_c - parameters.T0_c
    )


def scaled_v(
    K0_v_per_dps: float, k_T: Sequence[float], k_omega: Sequence[float], rate_dps: FloatArray, delta_c: FloatArray
) -> FloatArray:
    """Return K0·k(T)·k(ω)·ω [V] for rates [deg/s] and temperatures above T0 [°C], both of shape (n,)."""
    volts = one_plus(k_omega, rate_dps * rate_dps)
    volts *= rate_dps
    if k_T:
        volts *= one_plus(k_T, delta_c)
    volts *= K0_v_per_dps
    return volts


def one_plus(coefficients: Sequence[float] | FloatArray, x: FloatArray) -> FloatArray:
    """Return 1 + c1·x + c2·x² + … in a new array of the shape of x."""
    total = np.zeros_like(x)
    for coefficient in reversed(coefficients):
        total += coefficient
        total *= x
    total += 1.0
    return total


def response_baseline(parameters: ResponseParameters) -> Baseline:
    """Return the stages on the grid; the coil senses the table's rate."""

    def scale(signals: Signals) -> Signals:
        return replace(signals, output_v=response_v(parameters, signals.sensed_rate_dps, signals.coil_c))

    def add_bias(signals: Signals) -> Signals:
        return replace(signals, output_v=signals.output_v + parameters.U0_v)

    return {"scale": scale, "bias": add_bias}
