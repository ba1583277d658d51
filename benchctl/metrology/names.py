"""The tests of a gyro by name: the unit of each result, and the procedure that measures it."""

from __future__ import annotations

from collections.abc import Mapping

UNITS: Mapping[str, str] = {
    "scale_factor": "mV/(deg/s)",
    "nonlinearity": "ppm",
    "nonlinearity_reading": "%",
    "asymmetry": "ppm",
    "input_range": "deg/s",
    "scale_factor_repeatability": "ppm",
    "scale_factor_temperature": "ppm/degC",
    "hysteresis_rate": "ppm",
    "hysteresis_temperature_scale": "ppm",
    "hysteresis_temperature_bias": "deg/h",
    "threshold": "deg/h",
    "resolution": "deg/h",
    "dead_zone": "deg/h",
    "bias": "deg/h",
    "bias_stability": "deg/h",
    "bias_repeatability": "deg/h",
    "bias_temperature": "(deg/h)/degC",
    "bias_temperature_rate": "(deg/h)/(degC/min)",
    "quantisation": "arcsec",
    "angle_random_walk": "deg/sqrt(h)",
    "bias_instability": "deg/h",
    "rate_random_walk": "(deg/h)/sqrt(h)",
    "rate_ramp": "(deg/h)/h",
    "misalignment": "mrad",
    "bandwidth": "Hz",
    "delay": "ms",
    "warm_up_time": "s",
    "warm_up_bias": "deg/h",
}
"""In the order of a report."""

RATE_UNITS: Mapping[str, str] = {"scale_factor": "1"}
"""The units that differ if the output is a rate in deg/s: the scale factor is then the stated rate over the true."""

PROCEDURES: Mapping[str, str] = {
    "scale_factor": "rate_sweep",
    "nonlinearity": "rate_sweep",
    "nonlinearity_reading": "rate_sweep",
    "asymmetry": "rate_sweep",
    "input_range": "rate_sweep",
    "scale_factor_repeatability": "repeatability",
    "scale_factor_temperature": "temperature_sweep",
    "hysteresis_rate": "hysteresis",
    "hysteresis_temperature_scale": "thermal_hysteresis",
    "hysteresis_temperature_bias": "thermal_hysteresis",
    "threshold": "small_rates",
    "resolution": "small_rates",
    "dead_zone": "small_rates",
    "bias": "stability",
    "bias_stability": "stability",
    "bias_repeatability": "repeatability",
    "bias_temperature": "temperature_sweep",
    "bias_temperature_rate": "thermal_ramps",
    "quantisation": "stability",
    "angle_random_walk": "stability",
    "bias_instability": "stability",
    "rate_random_walk": "stability",
    "rate_ramp": "stability",
    "misalignment": "misalignment",
    "bandwidth": "frequency_response",
    "delay": "frequency_response",
    "warm_up_time": "warm_up",
    "warm_up_bias": "warm_up",
}
