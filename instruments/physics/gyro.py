"""The open-loop fibre-optic gyro: its output, before noise, for a rate and a coil temperature.

    U = h{ U0(T) + (K0/S)·g(T)·sin(S·Ω + φ) },    g(T) = 1 + g1·ΔT + g2·ΔT²,   U0(T) = U0 + c1·ΔT + c2·ΔT²

with ΔT = T − T0, T the temperature of the coil and Ω the rate about the input axis in inertial space (the table's and
the Earth's). The sine is the interferometer's (Sagnac phase S·Ω, first harmonic of the detector); h is the output's
low-pass. Changes at each switch-on are in `turn_on`, changes with the mounting in `mounting`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy  # scipy.signal is loaded on first use

from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

EARTH_DPS = 15.041 / 3600.0
"""Rate of the Earth relative to the stars [deg/s]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroParameters:
    """An analog open-loop gyro of the VG910 class. No data sheet is public: every default is assumed.

    S agrees with the published correction polynomial, which implies 0.00448 to 0.00452 rad per deg/s; g1 and g2 are the
    inverse of the published k(T) to first order. `arw_deg_per_sqrt_h` is the angle random walk N; N/60 is the two-sided
    amplitude density of the rate noise in (deg/s)/√Hz. `order` 0 is an output without low-pass. `turn_on_bias_v` and
    `turn_on_scale_ppm` are standard deviations of the changes of bias and scale factor at each switch-on;
    `misalignment_mrad` is the angle between the input axis and the axis marked on the housing.
    """

    K0_v_per_dps: float = 0.050
    U0_v: float = 0.012
    S_rad_per_dps: float = 0.0045
    T0_c: float = 20.0
    phi_nr_rad: float = 0.0
    g1_per_c: float = -1.315e-4
    g2_per_c2: float = 2.066e-6
    c1_v_per_c: float = 2e-5
    c2_v_per_c2: float = -1.5e-7
    arw_deg_per_sqrt_h: float = 0.03
    bias_walk_v_per_sqrt_s: float = 5e-7
    cutoff_hz: float = 200.0
    order: int = 2
    output_limit_v: float = 11.0
    turn_on_bias_v: float = 0.0
    turn_on_scale_ppm: float = 0.0
    misalignment_mrad: float = 0.0

    def __post_init__(self) -> None:
        if self.S_rad_per_dps <= 0.0:
            raise UsageError(f"S_rad_per_dps is {self.S_rad_per_dps}; give the Sagnac phase per rate, above 0")
        if self.cutoff_hz <= 0.0 or self.order not in (0, 1, 2):
            raise UsageError(f"a low-pass of order {self.order} at {self.cutoff_hz} Hz; give order 0 to 2, above 0 Hz")
        for name in ("turn_on_bias_v", "turn_on_scale_ppm"):
            if getattr(self, name) < 0.0:
                raise UsageError(f"{name} is {getattr(self, name)}; give a standard deviation, 0 or more")


def earth_rate_dps(latitude_deg: float) -> float:
    """Return the Earth's rate about a vertical axis [deg/s]: positive (counter-clockwise from above) in the north."""
    return EARTH_DPS * math.sin(math.radians(latitude_deg))


def horizontal_earth_rate_dps(latitude_deg: float) -> float:
    """Return the Earth's rate about a horizontal axis that points north [deg/s]."""
    return EARTH_DPS * math.cos(math.radians(latitude_deg))


def sine_output_v(parameters: GyroParameters, rate_dps: FloatArray, coil_c: FloatArray) -> FloatArray:
    """Return the interferometer's output [V] for rates [deg/s] and coil temperatures [°C], all of shape (n,)."""
    delta_c = coil_c - parameters.T0_c
    gain = 1.0 + delta_c * (parameters.g1_per_c + delta_c * parameters.g2_per_c2)
    phase = parameters.S_rad_per_dps * rate_dps
    phase += parameters.phi_nr_rad
    np.sin(phase, out=phase)
    phase *= gain
    phase *= parameters.K0_v_per_dps / parameters.S_rad_per_dps
    return phase


def bias_v(parameters: GyroParameters, coil_c: FloatArray) -> FloatArray:
    """Return the bias U0(T) [V] for coil temperatures [°C], shape (n,)."""
    delta_c = coil_c - parameters.T0_c
    return parameters.U0_v + delta_c * (parameters.c1_v_per_c + delta_c * parameters.c2_v_per_c2)


def white_deviation_v(parameters: GyroParameters, sample_rate_hz: float) -> float:
    """Return the standard deviation [V] of white noise averaged over one sample interval: K0·N/60·√fs."""
    return parameters.K0_v_per_dps * parameters.arw_deg_per_sqrt_h / 60.0 * math.sqrt(sample_rate_hz)


@dataclass(frozen=True)  # no slots: cached_property needs a __dict__
class LowPass:
    """A Butterworth low-pass as a difference equation, exact for an input that is linear between samples."""

    numerator: FloatArray
    denominator: FloatArray

    def at_rest(self, level: float) -> FloatArray:
        """Return the state, shape (order,), of a filter after a long constant input."""
        state: FloatArray = self._at_rest_at_one * level
        return state

    @cached_property
    def _at_rest_at_one(self) -> FloatArray:
        state: FloatArray = scipy.signal.lfilter_zi(self.numerator, self.denominator)
        return state

    def __call__(self, x: FloatArray, state: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Filter samples of shape (n,) from a state; return the output, shape (n,), and the final state."""
        y, after = scipy.signal.lfilter(self.numerator, self.denominator, x, zi=state)
        return y, after


def low_pass(cutoff_hz: float, order: int, interval_s: float) -> LowPass:
    """Discretise a continuous Butterworth low-pass (triangle hold, which preserves gain and delay at 0 Hz).

    The delay at low frequency is √2/(2π·cutoff) for order 2 and 1/(2π·cutoff) for order 1.
    """
    analog = scipy.signal.butter(order, 2.0 * math.pi * cutoff_hz, analog=True)
    numerator, denominator, _ = scipy.signal.cont2discrete(analog, interval_s, method="foh")
    return LowPass(np.ravel(numerator), np.ravel(denominator))
