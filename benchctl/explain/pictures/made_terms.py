"""Pictures of terms: calibration, uncertainty and judging, temperature, response."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from benchctl.explain.pictures.sketch import Band, Look, Panel, Sketch, SketchedCurve, one_panel
from benchctl.metrology.verdict import rule_of
from benchctl_instruments.physics.chamber import ChamberParameters, advance, settled, switched

_S, _PAPERS_S = 0.0045, 0.00448
"""Sagnac phases [rad/(°/s)]: of the gyro in these pictures, and the value implied by the paper's polynomial."""


def convention() -> Sketch:
    """Plot K as a response and as a correction, of one gyro."""
    true = np.linspace(1.0, 170.0, 200)
    indicated = np.sin(_S * true) / _S
    return one_panel(
        "Convention: response or correction",
        "One gyro, S = 0.0045 rad/(°/s). A response gives the output, a correction the factor to multiply it by.",
        SketchedCurve(x=true, y=indicated / true, look="on", label="response: (U − U0)/K0 = k·ω"),
        SketchedCurve(x=indicated, y=true / indicated, look="third", label="correction: ω = k·(U − U0)/K0"),
        SketchedCurve(x=true, y=np.ones(true.size), look="off"),
        x="rate, true or indicated (°/s)",
        y="k(ω) (1)",
        share=1.6,
    )


def argument() -> Sketch:
    """Plot the error of a correction evaluated at the right rate and at the wrong one."""
    true = np.linspace(1.0, 175.0, 200)
    indicated = np.sin(_PAPERS_S * true) / _PAPERS_S

    def left(rate: np.ndarray) -> np.ndarray:
        return np.asarray(100.0 * (indicated * (1.0 + 3.02e-6 * rate**2 + 5.89e-11 * rate**4) / true - 1.0))

    return one_panel(
        "Argument: indicated or true rate",
        "The paper's k(ω) = 1 + 3.02e-6·ω² + 5.89e-11·ω⁴ on a gyro of S = 0.00448 rad/(°/s): right where ω is the"
        " indicated rate, too large where it is the true one.",
        SketchedCurve(x=true, y=left(indicated), look="third", label="at the indicated rate"),
        SketchedCurve(x=true, y=left(true), look="on", label="at the true rate"),
        x="true rate (°/s)",
        y="error that is left (%)",
        zero=True,
        share=1.6,
    )


def error_path() -> Sketch:
    """Plot the residuals of a sine run for one line, stage 1 and the exact law."""
    rate = 165.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, 400))
    indicated = np.sin(_S * rate) / _S
    stage_1 = indicated * (1.0 + _S**2 / 6.0 * indicated**2)
    low_line = np.sin(_S * 40.0) / (_S * 40.0)
    phase_deg = np.linspace(0.0, 360.0, 400)
    levels: tuple[tuple[Look, str, np.ndarray], ...] = (
        ("grey", "one straight line", indicated / low_line),
        ("on", "k(ω) in ω² alone", stage_1),
        ("third", "the exact law", np.arcsin(_S * indicated) / _S),
    )
    left = {label: 100.0 * (found - rate) / 165.0 for _, label, found in levels}
    worst = [f"{label} {np.max(np.abs(one)):.1f} %" for label, one in left.items()]
    return one_panel(
        "error_percent along a calibration",
        f"A sine of ±165 °/s without noise; error_percent: {', '.join(worst)}.",
        *(SketchedCurve(x=phase_deg, y=left[label], look=look, label=label) for look, label, _ in levels),
        x="phase of the motion (°)",
        y="residual rate (% of the peak)",
        zero=True,
        share=1.6,
    )


def coverage() -> Sketch:
    """Plot a normal density with its u and U."""
    z = np.linspace(-4.0, 4.0, 400)
    density = np.exp(-0.5 * z**2) / math.sqrt(2.0 * math.pi)
    inside = 100.0 * math.erf(2.0 / math.sqrt(2.0))
    return one_panel(
        "Standard and expanded uncertainty",
        f"A value with a bell curve: ± u holds the true one with 68 %, ± U (k = 2) with {inside:.1f} %.",
        SketchedCurve(x=z, y=density, look="on"),
        x="distance from the value, in standard uncertainties (u)",
        y="density (1/u)",
        bands=(
            Band(low=-2.0, high=2.0, label="± U = ± 2u", look="open"),
            Band(low=-1.0, high=1.0, label="± u", look="good"),
        ),
    )


def guard_band() -> Sketch:
    """Plot the probability of each verdict over the true value, at a limit."""
    true = np.linspace(-3.0, 3.0, 400)
    rule = rule_of(1.0)
    passes, fails = _below(-1.0, true), 1.0 - _below(1.0, true)
    return one_panel(
        "Guard band",
        "An upper limit at 0, values in units of U (k = 2), guard = 1: exactly at the limit a unit passes"
        f" in {float(rule.says.values['risk_percent']):.1f} % of all tries, and fails in as many.",
        SketchedCurve(x=true, y=100.0 * passes, look="third", label="PASS"),
        SketchedCurve(x=true, y=100.0 * (1.0 - passes - fails), look="grey", label="INCONCLUSIVE"),
        SketchedCurve(x=true, y=100.0 * fails, look="on", label="FAIL"),
        x="true value less the limit (U)",
        y="share of tries (%)",
        bands=(
            Band(low=-3.0, high=-1.0, label="measured here: PASS", look="good"),
            Band(low=-1.0, high=1.0, label="here: INCONCLUSIVE", look="open"),
            Band(low=1.0, high=3.0, label="here: FAIL", look="bad"),
        ),
        share=1.8,
    )


def e_n() -> Sketch:
    """Plot two results that agree, and two that do not."""
    number = np.array([1.0, 2.0, 4.0, 5.0])
    value = np.array([10.0, 10.8, 10.0, 11.8])
    half = np.array([0.8, 0.6, 0.8, 0.6])
    scores = [(value[k + 1] - value[k]) / math.hypot(half[k], half[k + 1]) for k in (0, 2)]
    bars = [
        SketchedCurve(x=np.array([x, x]), y=np.array([y - u, y + u]), look="grey")
        for x, y, u in zip(number, value, half, strict=True)
    ]
    return one_panel(
        "E_n",
        "Two pairs of results with their U: up to 1 they agree to within what both state.",
        *bars,
        SketchedCurve(x=number, y=value, look="on dots"),
        x="result (number)",
        y="value ± U (°/h)",
        marks=((1.1, 11.6, f"E_n = {scores[0]:.2f}"), (4.9, 11.6, f"E_n = {scores[1]:.2f}")),
    )


def control_chart() -> Sketch:
    """Plot a unit's figure over campaigns with control limits, one value beyond them."""
    from benchctl.history.flags import control_of  # history sorts above; only its arithmetic is used

    rng = np.random.default_rng(2)
    values = 50.0 + 0.004 * rng.standard_normal(14)
    values[-1] = 50.022
    number = np.linspace(1.0, values.size, values.size)
    control = control_of(values[:-1].tolist())
    low, high = (control.low, control.high) if control is not None else (math.nan, math.nan)
    return one_panel(
        "Control limits",
        "K0 of one unit, campaign by campaign: the last one lies beyond what this unit has always been.",
        SketchedCurve(x=number, y=values, look="grey"),
        SketchedCurve(x=number, y=values, look="third dots", label="K0"),
        SketchedCurve(x=number[-1:], y=values[-1:], look="on dots", label="outside the control limits"),
        x="campaign (number)",
        y="K0 (mV/(°/s))",
        bands=(Band(low=low, high=high, label="control limits", look="good", across=True),),
    )


def soak() -> Sketch:
    """Plot set point, air, housing and coil after a step of the chamber."""
    parameters = ChamberParameters()
    state = replace(switched(settled(parameters, 20.0), True), setpoint_c=50.0)
    minutes = np.linspace(0.0, 120.0, 121)
    found = []
    for _ in minutes:
        found.append((state.profile_c, state.air_c, state.housing_c, state.coil_c))
        state = advance(parameters, 20.0, state, 60.0)
    profile, air, housing, coil = np.array(found).T
    drift = np.abs(np.gradient(housing, minutes))
    arrived = float(minutes[np.argmax(np.abs(air - 50.0) < 0.3)])
    still = float(minutes[(drift < 0.02) & (minutes > arrived)][0])
    return one_panel(
        "Set point and soak",
        f"Air within 0.3 °C after {arrived:.0f} min; gyro slower than 0.02 °C/min after {still:.0f} min.",
        SketchedCurve(x=minutes, y=profile, look="off", label="set point, led by the ramp limit"),
        SketchedCurve(x=minutes, y=air, look="grey", label="air"),
        SketchedCurve(x=minutes, y=housing, look="third", label="gyro's housing (thermistor)"),
        SketchedCurve(x=minutes, y=coil, look="on", label="its coil"),
        x="time (min)",
        y="temperature (°C)",
        bands=(Band(low=arrived, high=still, label="waiting for the gyro", look="open"),),
        share=1.8,
    )


def bandwidth() -> Sketch:
    """Plot gain and phase of a second-order low-pass."""
    cutoff = 60.0
    frequency = np.geomspace(0.5, 300.0, 300)
    s = 1j * frequency / cutoff
    response = 1.0 / (1.0 + math.sqrt(2.0) * s + s**2)
    phase = np.degrees(np.unwrap(np.angle(response)))
    delay_ms = 1e3 * math.sqrt(2.0) / (2.0 * math.pi * cutoff)
    return Sketch(
        title="Bandwidth and delay",
        caption=f"A low-pass of second order: −3 dB and −90° at 60 Hz; slow motion is late by {delay_ms:.1f} ms.",
        panels=(
            Panel(
                x="frequency (Hz)",
                y="gain (dB)",
                curves=(
                    SketchedCurve(x=frequency, y=20.0 * np.log10(np.abs(response)), look="on", label="gain"),
                    SketchedCurve(x=frequency, y=np.full(frequency.size, -3.01), look="off", label="−3 dB"),
                ),
                bands=(Band(low=0.5, high=cutoff, label="bandwidth", look="good"),),
                logarithmic="x",
            ),
            Panel(
                x="frequency (Hz)",
                y="phase (°)",
                curves=(
                    SketchedCurve(x=frequency, y=phase, look="on", label="phase"),
                    SketchedCurve(
                        x=frequency[frequency < 90.0],
                        y=-0.36 * delay_ms * frequency[frequency < 90.0],
                        look="off",
                        label="slope at low frequencies: delay",
                    ),
                ),
                bands=(Band(low=0.5, high=cutoff, label="", look="good"),),
                logarithmic="x",
            ),
        ),
    )


def warm_up_time() -> Sketch:
    """Plot the bias after power-on, its law, and the time after which it stays within a limit."""
    rng = np.random.default_rng(4)
    within, amplitude, tau_s = 10.0, 90.0, 300.0
    time_s = np.linspace(10.0, 2390.0, 120)
    law = amplitude * np.exp(-time_s / tau_s)
    ready_s = tau_s * math.log(amplitude / within)
    return one_panel(
        "Warm-up",
        f"A = 90 °/h, τ = 300 s: within 10 °/h of its end after τ·ln(A/10 °/h) = {ready_s:.0f} s.",
        SketchedCurve(x=time_s, y=law + 4.0 * rng.standard_normal(time_s.size), look="off dots", label="means"),
        SketchedCurve(x=time_s, y=law, look="on", label="A·exp(−t/τ)"),
        x="time since power-on (s)",
        y="bias less its end (°/h)",
        bands=(
            Band(low=-within, high=within, label="warm_deg_per_h = 10", look="good", across=True),
            Band(low=0.0, high=ready_s, label="warm-up time", look="open"),
        ),
        share=1.6,
    )


def _below(limit: float, true: np.ndarray) -> np.ndarray:
    """Return the probability that a value with U = 1 (k = 2) is measured below a limit, for each true value."""
    return np.array([0.5 * (1.0 + math.erf((limit - one) * math.sqrt(2.0))) for one in true.tolist()])
