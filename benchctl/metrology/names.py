"""The tests of a gyro by name: the unit of each result, and the procedure that measures it."""

from __future__ import annotations

from collections.abc import Mapping

_TESTS = {
    "scale_factor": ("mV/(deg/s)", "rate_sweep"),
    "nonlinearity": ("ppm", "rate_sweep"),
    "nonlinearity_reading": ("%", "rate_sweep"),
    "asymmetry": ("ppm", "rate_sweep"),
    "input_range": ("deg/s", "rate_sweep"),
    "scale_factor_repeatability": ("ppm", "repeatability"),
    "scale_factor_temperature": ("ppm/degC", "temperature_sweep"),
    "hysteresis_rate": ("ppm", "hysteresis"),
    "hysteresis_temperature_scale": ("ppm", "thermal_hysteresis"),
    "hysteresis_temperature_bias": ("deg/h", "thermal_hysteresis"),
    "threshold": ("deg/h", "small_rates"),
    "resolution": ("deg/h", "small_rates"),
    "dead_zone": ("deg/h", "small_rates"),
    "bias": ("deg/h", "stability"),
    "bias_stability": ("deg/h", "stability"),
    "bias_repeatability": ("deg/h", "repeatability"),
    "bias_temperature": ("(deg/h)/degC", "temperature_sweep"),
    "bias_temperature_rate": ("(deg/h)/(degC/min)", "thermal_ramps"),
    "quantisation": ("arcsec", "stability"),
    "angle_random_walk": ("deg/sqrt(h)", "stability"),
    "bias_instability": ("deg/h", "stability"),
    "rate_random_walk": ("(deg/h)/sqrt(h)", "stability"),
    "rate_ramp": ("(deg/h)/h", "stability"),
    "misalignment": ("mrad", "misalignment"),
    "bandwidth": ("Hz", "frequency_response"),
    "delay": ("ms", "frequency_response"),
    "warm_up_time": ("s", "warm_up"),
    "warm_up_bias": ("deg/h", "warm_up"),
}
"""In the order of a report."""

UNITS: Mapping[str, str] = {name: unit for name, (unit, _) in _TESTS.items()}

PROCEDURES: Mapping[str, str] = {name: procedure for name, (_, procedure) in _TESTS.items()}

RATE_UNITS: Mapping[str, str] = {"scale_factor": "1"}
"""The units that differ if the output is a rate in deg/s: the scale factor is then the stated rate over the true."""
