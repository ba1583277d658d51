"""Motions and temperatures that excite the effects of the gyro, as signals of the simulated chain."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from benchctl.explain.pictures.sketch import Panel, SketchedCurve
from benchctl.explain.sizes import RANGE_DPS
from benchctl.reports import text
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.chain import Signals
from benchctl_instruments.physics.effects.effect import PhysicalEffect
from benchctl_instruments.physics.effects.kinds import EncoderEffect

T0_C = 20.0
_TURNING_DPS = 100.0
_HOUR_S = 3600.0
_SWING_SCANS = 2000
"""Number of scans in `swing`, the span for the positions of data faults."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Scene:
    """A motion. `x` is the abscissa of its picture, `description` the motion in words; `stimulus` is drawn above.

    `parts` are named sections, such as heating and cooling.

    `noisy`: with the noise of samples, both with and without the effect. `memoryless`: the output depends only on x, so
    that the effect may be enlarged in the drawing. `spectrum`: the picture includes a spectrum.
    """

    signals: Signals
    x: FloatArray
    x_label: str
    description: str
    stimulus: Panel | None = None
    parts: tuple[tuple[str, slice], ...] = ()
    noisy: bool = False
    memoryless: bool = True
    spectrum: bool = False
    allan: bool = False


Make = Callable[[PhysicalEffect, float], Scene]
"""A function that returns a scene for an effect; the number is the top rate [°/s] of scenes that sweep the rate."""


def sweep(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return a sweep over all rates without acceleration."""
    near = np.geomspace(1e-4 * top_dps, top_dps, 600)
    rate = np.unique(np.concatenate([np.linspace(-top_dps, top_dps, 8001), near, -near]))
    signals = _signals(np.linspace(0.0, 600.0, rate.size), rate)
    return Scene(signals=signals, x=rate, x_label="rate (°/s)", description=f"Rates up to ±{top_dps:.3g} °/s")


def noisy_sweep(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return a sweep over all rates with the noise of samples."""
    rate = np.linspace(-top_dps, top_dps, 6000)
    return Scene(
        signals=_signals(_every(0.01, rate.size), rate),
        x=rate,
        x_label="rate (°/s)",
        description=f"Rates up to ±{top_dps:.3g} °/s, every sample",
        noisy=True,
    )


def reversals(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return two quick reversals."""
    interval_s = 1e-3
    time_s = _every(interval_s, 2600)
    acceleration = np.zeros_like(time_s)
    acceleration[600:1000], acceleration[1800:2200] = 500.0, -500.0
    rate = -_TURNING_DPS + np.concatenate([np.zeros(1), np.cumsum(acceleration)[:-1]]) * interval_s
    signals = _signals(time_s, rate, acceleration=acceleration)
    return _timed(signals, "s", "Reversals from −100 to 100 °/s and back at 500 °/s²", memoryless=False)


def slow_sine(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return a sine with a period of two minutes, for an hour."""
    signals = _sine(_every(0.5, 7200), 1.0 / 120.0)
    return _timed(signals, "min", "A sine of ±100 °/s and two minutes, for an hour", memoryless=False)


def turns(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return two turns, or four waves of an encoder effect."""
    waves = effect.waves_a_turn if isinstance(effect, EncoderEffect) else 1.0
    span_deg = 720.0 if waves <= 2.0 else 4.0 * 360.0 / waves
    angle = np.linspace(0.0, span_deg, 2001)
    rate_dps = 36.0
    signals = _signals(angle / rate_dps, np.full_like(angle, rate_dps), angle=angle)
    return Scene(signals=signals, x=angle, x_label="angle of the table (°)", description="Turning at 36 °/s")


def temperatures(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return rest at all temperatures, each for a long time."""
    celsius = np.linspace(-40.0, 60.0, 1001)
    signals = _signals(np.linspace(0.0, 100.0 * _HOUR_S, celsius.size), np.zeros_like(celsius), celsius=celsius)
    return Scene(signals=signals, x=celsius, x_label="temperature of the gyro (°C)", description="At rest")


def temperature_cycle(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return a constant rate, from cold to hot and back."""
    celsius = np.interp(np.arange(2001.0), [0.0, 1000.0, 2000.0], [-40.0, 60.0, -40.0])
    time_s = np.linspace(0.0, 200.0 * _HOUR_S, celsius.size)
    return Scene(
        signals=_signals(time_s, np.full_like(time_s, _TURNING_DPS), celsius=celsius),
        x=celsius,
        x_label="temperature of the gyro (°C)",
        description="Turning at 100 °/s, from the cold to the heat and back, with long soaks",
        parts=(("heating", slice(0, 1001)), ("cooling", slice(1000, None))),
    )


def sweeps_at_temperatures(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return all rates, at a low temperature, at T0 and at a high temperature."""
    once = np.linspace(-top_dps, top_dps, 401)
    celsius = (-40.0, T0_C, 60.0)
    rate = np.tile(once, len(celsius))
    named = [f"at {text.plain(one, '°C')}" for one in celsius]
    parts = [(name, slice(k * once.size, (k + 1) * once.size)) for k, name in enumerate(named)]
    return Scene(
        signals=_signals(np.linspace(0.0, 30.0 * _HOUR_S, rate.size), rate, celsius=np.repeat(celsius, once.size)),
        x=rate,
        x_label="rate (°/s)",
        description=f"Rates up to ±{top_dps:.3g} °/s at three temperatures",
        parts=tuple(parts),
    )


def ramps(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return a constant rate while the chamber heats and cools, with constant temperature in between."""
    time_s = _every(2.0, 6300)
    hours = time_s / _HOUR_S
    celsius = np.interp(hours, [0.0, 0.25, 0.75, 1.75, 2.25, 3.5], [20.0, 20.0, 50.0, 50.0, 20.0, 20.0])
    return _timed(
        _signals(time_s, np.full_like(time_s, _TURNING_DPS), celsius=celsius),
        "h",
        "Turning at 100 °/s while the temperature rises and falls by 1 °C/min",
        stimulus=_stimulus("time (h)", "temperature (°C)", hours, celsius, label="thermistor", share=0.7),
    )


def long_turning(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return a constant rate for two hours."""
    time_s = _every(2.0, 3600)
    return _timed(_signals(time_s, np.full_like(time_s, _TURNING_DPS)), "min", "Turning at 100 °/s for two hours")


def long_rest(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return rest for two hours."""
    return _timed(_rest(2.0, 3600), "min", "Two hours at rest")


def noisy_rest(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return rest for two hours with the noise of samples, two per second."""
    return _timed(_rest(0.5, 14400), "min", "Two hours at rest, two samples a second", noisy=True, allan=True)


def short_rest(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return twenty seconds at rest with all samples."""
    return _timed(_rest(0.01, _SWING_SCANS), "s", "At rest, a hundred samples a second", noisy=True)


def tone(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return rest, sampled fast enough for the mains frequency."""
    return _timed(_rest(1e-3, 4000), "s", "At rest, a thousand samples a second", noisy=True, spectrum=True)


def swing(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return a slow sine with all samples."""
    return _timed(_sine(_every(0.01, _SWING_SCANS), 0.2), "s", "A sine of ±100 °/s and 0.2 Hz", memoryless=False)


def supply(effect: PhysicalEffect, top_dps: float) -> Scene:
    """Return a constant rate while the supply voltage is stepped."""
    time_s = _every(2.0, 1800)
    minutes = time_s / 60.0
    volts = 12.0 + np.interp(minutes, [0, 15, 15.01, 30, 30.01, 45, 60], [0, 0, 0.5, 0.5, -0.5, -0.5, 0.5])
    return _timed(
        _signals(time_s, np.full_like(time_s, _TURNING_DPS), auxiliary={"supply_v": volts}),
        "min",
        "Turning at 100 °/s while the supply is changed",
        stimulus=_stimulus("time (min)", "supply (V)", minutes, volts, share=0.6),
    )


BY_COORDINATE: Mapping[str, Make] = {
    "rate": sweep,
    "abs_rate": sweep,
    "rate_sign": sweep,
    "output": sweep,
    "acceleration": reversals,
    "acceleration*time": slow_sine,
    "angle": turns,
    "gyro_temp": temperatures,
    "gyro_temp_rate": ramps,
    "rate*gyro_temp": temperature_cycle,
    "rate*time": long_turning,
    "time": long_rest,
    "frequency": tone,
}
"""The default scene of an effect, by its coordinate."""

BY_NAME: Mapping[str, Make] = {
    "noisy_rest": noisy_rest,
    "noisy_sweep": noisy_sweep,
    "short_rest": short_rest,
    "supply": supply,
    "sweeps_at_temperatures": sweeps_at_temperatures,
    "swing": swing,
}
"""Scenes that the glossary requests by name."""

CIRCUMSTANCES: Mapping[str, float] = {"T0_c": T0_C, "range_dps": RANGE_DPS, "span_scans": float(_SWING_SCANS)}
"""Circumstances for all effects that require them."""


def _timed(signals: Signals, unit: Literal["s", "min", "h"], description: str, **more: Any) -> Scene:
    """Return a scene drawn over time."""
    seconds = {"s": 1.0, "min": 60.0, "h": _HOUR_S}[unit]
    return Scene(signals=signals, x=signals.time_s / seconds, x_label=f"time ({unit})", description=description, **more)


def _stimulus(x_label: str, y_label: str, x: FloatArray, y: FloatArray, *, share: float, label: str = "") -> Panel:
    return Panel(x=x_label, y=y_label, curves=(SketchedCurve(x=x, y=y, look="grey", label=label),), share=share)


def _sine(time_s: FloatArray, frequency_hz: float) -> Signals:
    turn = 2.0 * np.pi * frequency_hz
    rate = _TURNING_DPS * np.sin(turn * time_s)
    return _signals(time_s, rate, acceleration=_TURNING_DPS * turn * np.cos(turn * time_s))


def _rest(interval_s: float, count: int) -> Signals:
    return _signals(_every(interval_s, count), np.zeros(count))


def _every(interval_s: float, count: int) -> FloatArray:
    return np.linspace(0.0, interval_s * (count - 1), count)


def _signals(
    time_s: FloatArray,
    rate: FloatArray,
    *,
    acceleration: FloatArray | None = None,
    angle: FloatArray | None = None,
    celsius: FloatArray | None = None,
    auxiliary: Mapping[str, FloatArray] | None = None,
) -> Signals:
    interval_s = float(time_s[1] - time_s[0])
    warm = np.full_like(time_s, T0_C) if celsius is None else celsius
    turned = np.concatenate([np.zeros(1), np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(time_s))])
    place = turned if angle is None else angle
    return Signals(
        interval_s=interval_s,
        time_s=time_s,
        angle_deg=place,
        rate_dps=rate,
        acceleration_dps2=np.zeros_like(rate) if acceleration is None else acceleration,
        housing_c=warm,
        coil_c=warm,
        sensed_rate_dps=rate,
        output_v=np.zeros_like(rate),
        encoder_deg=place,
        thermistor_c=warm,
        coil_rate_c_per_s=np.gradient(warm, time_s),
        auxiliary=auxiliary or {},
    )
