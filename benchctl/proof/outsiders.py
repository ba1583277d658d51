"""Effects that a diagnosis is not given a hypothesis of: it must say that something is left, and where."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

from benchctl.proof.sizes import WANDERING

OUTSIDERS: Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]] = MappingProxyType(
    {
        "heading_dependent_bias": (("encoder_eccentricity", "encoder_interpolation"), ("angle",)),
        "encoder_eccentricity": (("heading_dependent_bias", "encoder_interpolation"), ("angle", "rate")),
        "rate_squared": (("scale_asymmetry", "adc_nonlinearity"), ("rate", "abs_rate", "rate_sign", "output")),
        "scale_asymmetry": (
            ("rate_squared", "dead_zone", "adc_nonlinearity"),
            ("rate", "abs_rate", "rate_sign", "output"),
        ),
        "dead_zone": (
            ("scale_asymmetry", "adc_nonlinearity", "rate_nonlinearity"),
            ("rate", "abs_rate", "rate_sign", "output"),
        ),
        "adc_nonlinearity": (("adc_coarse",), ("output", "rate", "abs_rate")),
        "bias_temperature": (
            ("bias_temperature_rate", "warm_up", "bias_drift", *WANDERING),
            ("gyro_temp", "chamber_temp", "time", "step"),
        ),
        "bias_temperature_rate": (
            ("bias_temperature", "thermal_lag", *WANDERING),
            ("gyro_temp_rate", "gyro_temp", "chamber_temp", "time", "step"),
        ),
        "warm_up": (("bias_drift", "bias_temperature", *WANDERING), ("time", "step")),
        "angular_acceleration": (
            ("timing_offset", "sensor_bandwidth", "mount_resonance", "clock_drift"),
            ("acceleration", "frequency"),
        ),
    }
)
"""Effects whose own hypothesis is withheld: their look-alikes that are withheld too, and where they live."""
