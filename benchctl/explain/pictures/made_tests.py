"""Pictures of metrics, from small data sets made with the simulated gyro."""

from __future__ import annotations

import numpy as np

from benchctl.explain.pictures.sketch import Band, Panel, Sketch, SketchedCurve, one_panel
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.gyro import GyroParameters, bias_v, sine_output_v

_GYRO = GyroParameters()
_RATES = np.linspace(-170.0, 170.0, 35)
_LOW_DPS = 40.0


def _output_v(rate_dps: FloatArray) -> FloatArray:
    warm = np.full_like(rate_dps, _GYRO.T0_c)
    return sine_output_v(_GYRO, rate_dps, warm) + bias_v(_GYRO, warm)


def _line(chosen: np.ndarray) -> FloatArray:
    """Return the line fitted to the chosen rates, at all rates."""
    output_v = _output_v(_RATES)
    return np.asarray(np.polyval(np.polyfit(_RATES[chosen], output_v[chosen], 1), _RATES))


def scale_factor() -> Sketch:
    """Plot points, the line through all of them, and the line at low rates."""
    every, low = np.ones(_RATES.size, dtype=np.bool_), np.abs(_RATES) <= _LOW_DPS
    return one_panel(
        "Scale factor",
        "An open-loop gyro (S = 0.0045 rad/(°/s)): the slope depends on the rates that the line is fitted to.",
        SketchedCurve(x=_RATES, y=_output_v(_RATES), look="third dots", label="mean outputs"),
        SketchedCurve(x=_RATES, y=_line(every), look="on", label="K: line through all rates"),
        SketchedCurve(x=_RATES, y=_line(low), look="off", label="K0, K₁: line up to ±40 °/s"),
        x="rate (°/s)",
        y="output (V)",
        share=1.6,
    )


def nonlinearity() -> Sketch:
    """Plot the misfits of the same points by both definitions."""
    output_v = _output_v(_RATES)
    every, low = np.ones(_RATES.size, dtype=np.bool_), np.abs(_RATES) <= _LOW_DPS
    of_full = 100.0 * (output_v - _line(every)) / np.max(np.abs(output_v - _GYRO.U0_v))
    beyond = np.abs(_RATES) > 0.2 * _LOW_DPS
    of_reading = 100.0 * (output_v - _line(low))[beyond] / np.abs(_line(low) - _GYRO.U0_v)[beyond]
    return Sketch(
        title="Nonlinearity, by two definitions",
        caption="The same points of one gyro: above in percent of full scale, below in percent of reading.",
        panels=(
            Panel(
                x="rate (°/s)",
                y="misfit, line of all\nrates (% of full scale)",
                curves=(
                    SketchedCurve(x=_RATES, y=of_full, look="on"),
                    SketchedCurve(x=_RATES, y=of_full, look="on dots"),
                ),
                marks=((float(_RATES[0]), float(of_full[0]), "the largest: nonlinearity"),),
                zero=True,
            ),
            Panel(
                x="rate (°/s)",
                y="departure, line of\nlow rates (% of reading)",
                curves=(
                    SketchedCurve(x=_RATES[beyond], y=of_reading, look="third"),
                    SketchedCurve(x=_RATES[beyond], y=of_reading, look="third dots"),
                ),
                bands=(Band(low=-_LOW_DPS, high=_LOW_DPS, label="rates of the line", look="good"),),
                zero=True,
            ),
        ),
    )


def input_range() -> Sketch:
    """Plot the deviation from the line at low rates, and where it exceeds 10 %."""
    rate = np.linspace(10.0, 220.0, 400)
    output_v = _output_v(rate) - _GYRO.U0_v
    low = rate <= _LOW_DPS
    slope = float(rate[low] @ output_v[low] / (rate[low] @ rate[low]))
    departure = 100.0 * (1.0 - output_v / (slope * rate))
    ends = float(rate[np.argmax(departure > 10.0)])
    return one_panel(
        "Input range",
        f"Up to {ends:.0f} °/s the output stays within 10 % of what the line at low rates reads.",
        SketchedCurve(x=rate, y=departure, look="on"),
        x="rate (°/s)",
        y="error of reading (%)",
        bands=(
            Band(low=0.0, high=10.0, label="linearity_percent = 10", look="good", across=True),
            Band(low=ends, high=220.0, label="beyond the range", look="bad"),
        ),
    )


def turn_ons() -> Sketch:
    """Plot values after several turn-ons, and their standard deviation."""
    rng = np.random.default_rng(7)
    count = np.linspace(1.0, 8.0, 8)
    bias = 12.0 + 1.5 * rng.standard_normal(count.size)
    mean, deviation = float(bias.mean()), float(np.std(bias, ddof=1))
    return one_panel(
        "Repeatability",
        f"Eight turn-ons with cooling down between them: their standard deviation is {deviation:.2g} °/h (1σ).",
        SketchedCurve(x=count, y=bias, look="on dots", label="bias after a turn-on"),
        SketchedCurve(x=count, y=np.full(count.size, mean), look="off", label="mean"),
        x="turn-on (number)",
        y="bias (°/h)",
        bands=(Band(low=mean - deviation, high=mean + deviation, label="± 1σ", look="good", across=True),),
    )


def hysteresis_rate() -> Sketch:
    """Plot the deviation from the line over a cycle of rates."""
    cycle = np.concatenate([np.linspace(0.0, 170.0, 60), np.linspace(170.0, 0.0, 60)])
    going = np.concatenate([np.ones(60), -np.ones(60)])
    parted = -30.0 * going * np.sin(np.pi * cycle / 170.0)
    up, down = going > 0.0, going < 0.0
    return one_panel(
        "Hysteresis in rate",
        "Constant rates, up and down again: the largest difference of the branches over the largest output.",
        SketchedCurve(x=cycle[up], y=parted[up], look="on", label="reached from below"),
        SketchedCurve(x=cycle[down], y=parted[down], look="third", label="reached from above"),
        x="rate (°/s)",
        y="output less the line (ppm)",
        zero=True,
    )


def hysteresis_bias() -> Sketch:
    """Plot the bias at soaked set points, by heating and by cooling."""
    celsius = np.linspace(-40.0, 60.0, 6)
    common = 0.12 * (celsius - 20.0) - 0.001 * (celsius - 20.0) ** 2
    inner = np.sin(np.pi * (celsius + 40.0) / 100.0)
    return one_panel(
        "Thermal hysteresis of the bias",
        "Soaked set points, each reached by heating and by cooling: the largest difference is the hysteresis.",
        SketchedCurve(x=celsius, y=common - 1.2 * inner, look="on", label="by heating"),
        SketchedCurve(x=celsius, y=common + 1.2 * inner, look="third", label="by cooling"),
        SketchedCurve(x=celsius, y=common - 1.2 * inner, look="on dots"),
        SketchedCurve(x=celsius, y=common + 1.2 * inner, look="third dots"),
        x="temperature (°C)",
        y="bias (°/h)",
    )


def threshold() -> Sketch:
    """Plot the response to small rates of a gyro with a dead zone."""
    half_dph = 18.0
    tried = np.array([5.0, 10.0, 15.0, 20.0, 25.0, 30.0, 40.0, 50.0, 70.0, 100.0])
    response = np.maximum(tried - half_dph, 0.0) / tried
    return one_panel(
        "Threshold",
        "A gyro that swallows 18 °/h of every rate: from 36 °/h on it answers with half or more.",
        SketchedCurve(x=tried, y=response, look="on"),
        SketchedCurve(x=tried, y=response, look="on dots", label="rates tried"),
        SketchedCurve(x=tried, y=np.full(tried.size, 0.5), look="off", label="one half"),
        x="rate from rest (°/h)",
        y="response over\nwhat K promises (1)",
        bands=(Band(low=0.0, high=2.0 * half_dph, label="below the threshold", look="bad"),),
    )


def misalignment() -> Sketch:
    """Plot the response to the rate of a unit mounted across the table's axis."""
    rates, delta = np.array([-100.0, -67.0, -33.0, 0.0, 33.0, 67.0, 100.0]), 2e-3
    felt_mv = 1e3 * (_GYRO.K0_v_per_dps * np.sin(delta) * rates + _GYRO.U0_v)
    return one_panel(
        "Misalignment",
        "The unit mounted across the table's axis: with an input axis 2 mrad off it feels 0.2 % of the rate.",
        SketchedCurve(x=rates, y=felt_mv, look="on", label="δ = 2 mrad: slope over K is sin δ"),
        SketchedCurve(x=rates, y=felt_mv, look="on dots"),
        SketchedCurve(x=rates, y=np.full(rates.size, 1e3 * _GYRO.U0_v), look="off", label="δ = 0"),
        x="rate of the table, across (°/s)",
        y="output (mV)",
    )
