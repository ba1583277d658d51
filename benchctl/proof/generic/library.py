"""The library of terms, and the effect that each term represents when the regression selects it.

Names of terms use the symbols of the vocabulary: ω is the rate (relative to the range), θ the angle, T the thermistor
minus T0 (in units of 40 °C), t the time (in hours), α the acceleration, U the output.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from benchctl.proof.generic.rows import Rows
from benchctl_instruments.arrays import FloatArray

WARM_C, HOUR_S, RAMP_C_PER_S = 40.0, 3600.0, 0.08


@dataclass(frozen=True, slots=True)
class Observations:
    """The coordinates of the rows, scaled to about one; arrays of shape (n,)."""

    w: FloatArray
    a: FloatArray
    j: FloatArray
    T: FloatArray
    S: FloatArray
    t: FloatArray
    angle: FloatArray
    u: FloatArray

    @classmethod
    def of(cls, rows: Rows) -> Observations:
        """Return the scaled coordinates."""
        return cls(
            w=rows.rate_dps / rows.range_dps,
            a=_scaled(rows.acceleration_dps2),
            j=_scaled(rows.jerk_dps3),
            T=rows.warmer_c / WARM_C,
            S=rows.warms_c_per_s / RAMP_C_PER_S,
            t=rows.time_s / HOUR_S,
            angle=np.radians(rows.angle_deg),
            u=_scaled(rows.output_v),
        )


def _scaled(values: FloatArray) -> FloatArray:
    return values / max(float(np.abs(values).max()), 1e-12)


def _decay(observed: Observations, tau_s: float) -> FloatArray:
    decay: FloatArray = np.exp(-observed.t * HOUR_S / tau_s)
    return decay


Term = tuple[str, Callable[[Observations], FloatArray]]

TERMS: Mapping[str, Term] = MappingProxyType(
    {
        "ωT": ("scale_temperature", lambda s: s.w * s.T),
        "ωT²": ("scale_temperature", lambda s: s.w * s.T**2),
        "ωT³": ("scale_temperature", lambda s: s.w * s.T**3),
        "ω³": ("rate_nonlinearity", lambda s: s.w**3),
        "ω⁵": ("rate_nonlinearity", lambda s: s.w**5),
        "ω⁷": ("rate_nonlinearity", lambda s: s.w**7),
        "ω³T": ("scale_rate_temperature_coupling", lambda s: s.w**3 * s.T),
        "ω³T²": ("scale_rate_temperature_coupling", lambda s: s.w**3 * s.T**2),
        "|ω|": ("scale_asymmetry", lambda s: np.abs(s.w)),
        "|ω|T": ("scale_asymmetry", lambda s: np.abs(s.w) * s.T),
        "|ω|³": ("scale_asymmetry", lambda s: np.abs(s.w) ** 3),
        "sign ω": ("dead_zone", lambda s: np.tanh(s.w / 0.005)),
        "ω²": ("rate_squared", lambda s: s.w**2),
        "ω⁴": ("rate_squared", lambda s: s.w**4),
        "ω²T": ("rate_squared", lambda s: s.w**2 * s.T),
        "ωt": ("scale_ageing", lambda s: s.w * s.t),
        "ωt²": ("scale_ageing", lambda s: s.w * s.t**2),
        "ω·e^(−t/100 s)": ("scale_warm_up", lambda s: s.w * _decay(s, 100.0)),
        "ω·e^(−t/300 s)": ("scale_warm_up", lambda s: s.w * _decay(s, 300.0)),
        "ω·e^(−t/900 s)": ("scale_warm_up", lambda s: s.w * _decay(s, 900.0)),
        "ωdT/dt": ("thermal_lag", lambda s: s.w * s.S),
        "ωT·dT/dt": ("thermal_lag", lambda s: s.w * s.T * s.S),
        "ω|dT/dt|": ("thermal_lag", lambda s: s.w * np.abs(s.S)),
        "ω·sign dT/dt": ("thermal_hysteresis", lambda s: s.w * np.tanh(s.S / 0.05)),
        "ω cos θ": ("encoder_eccentricity", lambda s: s.w * np.cos(s.angle)),
        "ω sin θ": ("encoder_eccentricity", lambda s: s.w * np.sin(s.angle)),
        "ω cos 2θ": ("encoder_eccentricity", lambda s: s.w * np.cos(2 * s.angle)),
        "ω sin 2θ": ("encoder_eccentricity", lambda s: s.w * np.sin(2 * s.angle)),
        "T": ("bias_temperature", lambda s: s.T),
        "T²": ("bias_temperature", lambda s: s.T**2),
        "T³": ("bias_temperature", lambda s: s.T**3),
        "dT/dt": ("bias_temperature_rate", lambda s: s.S),
        "|dT/dt|": ("bias_temperature_rate", lambda s: np.abs(s.S)),
        "T·dT/dt": ("bias_temperature_rate", lambda s: s.T * s.S),
        "(dT/dt)²": ("bias_temperature_rate", lambda s: s.S**2),
        "t": ("bias_drift", lambda s: s.t),
        "t²": ("bias_drift", lambda s: s.t**2),
        "tT": ("bias_drift", lambda s: s.t * s.T),
        "e^(−t/100 s)": ("warm_up", lambda s: _decay(s, 100.0)),
        "e^(−t/300 s)": ("warm_up", lambda s: _decay(s, 300.0)),
        "e^(−t/900 s)": ("warm_up", lambda s: _decay(s, 900.0)),
        "cos θ": ("heading_dependent_bias", lambda s: np.cos(s.angle)),
        "sin θ": ("heading_dependent_bias", lambda s: np.sin(s.angle)),
        "cos 2θ": ("heading_dependent_bias", lambda s: np.cos(2 * s.angle)),
        "sin 2θ": ("heading_dependent_bias", lambda s: np.sin(2 * s.angle)),
        "α": ("timing_offset", lambda s: s.a),
        "αt": ("clock_drift", lambda s: s.a * s.t),
        "αT": ("angular_acceleration", lambda s: s.a * s.T),
        "αω²": ("timing_offset", lambda s: s.a * s.w**2),
        "α²": ("angular_acceleration", lambda s: s.a**2),
        "|α|": ("angular_acceleration", lambda s: np.abs(s.a)),
        "α³": ("angular_acceleration", lambda s: s.a**3),
        "dα/dt": ("sensor_bandwidth", lambda s: s.j),
        "t·dα/dt": ("clock_drift", lambda s: s.j * s.t),
        "sin 2πU": ("adc_nonlinearity", lambda s: np.sin(2 * np.pi * s.u)),
        "cos 2πU": ("adc_nonlinearity", lambda s: np.cos(2 * np.pi * s.u)),
        "sin 4πU": ("adc_nonlinearity", lambda s: np.sin(4 * np.pi * s.u)),
        "cos 4πU": ("adc_nonlinearity", lambda s: np.cos(4 * np.pi * s.u)),
        "sin 8πU": ("adc_nonlinearity", lambda s: np.sin(8 * np.pi * s.u)),
        "cos 8πU": ("adc_nonlinearity", lambda s: np.cos(8 * np.pi * s.u)),
        "max(|U| − 0.9, 0)": ("saturation", lambda s: np.sign(s.u) * np.maximum(np.abs(s.u) - 0.9, 0.0)),
        "max(|ω| − 0.8, 0)": ("fringe_ambiguity", lambda s: np.sign(s.w) * np.maximum(np.abs(s.w) - 0.8, 0.0)),
    }
)
"""Name of a term -> the effect that it represents, and its column."""


_OF_K_T, _OF_K_OMEGA = ("ωT", "ωT²", "ωT³"), ("ω³", "ω⁵", "ω⁷")


def library(rows: Rows) -> tuple[list[str], FloatArray]:
    """Return names and columns, shape (n, terms), of the terms that the lab's model does not have."""
    scaled = Observations.of(rows)
    has = _believed(rows)
    names = [name for name in TERMS if name not in has]
    return names, np.column_stack([TERMS[name][1](scaled) for name in names])


def baseline(rows: Rows) -> FloatArray:
    """Return the terms of the lab's model, shape (n, terms); a change of their coefficients is no finding."""
    scaled = Observations.of(rows)
    columns = [np.ones_like(scaled.t), scaled.w, *(TERMS[name][1](scaled) for name in _believed(rows))]
    return np.column_stack(columns)


def _believed(rows: Rows) -> tuple[str, ...]:
    return (*_OF_K_T[: rows.k_T_terms], *_OF_K_OMEGA[: rows.k_omega_terms])
