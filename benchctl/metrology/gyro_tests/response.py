"""Bandwidth and delay: gain and phase of the output relative to the encoder in swings of several frequencies.

For each swing the fundamental of both is fitted. The gain is relative to that of the static curve at the same
amplitude, because the static gain of a nonlinear gyro depends on the amplitude. The band ends at a gain of −3 dB or a
phase of −90°, whichever comes first; the delay is the slope of the phase at low frequencies.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from benchctl.metrology.names import UNITS
from benchctl.metrology.observations import Observations, celsius_of, column, refused, same_set_point
from benchctl.metrology.propagation import Offsets, Quantity, as_read, nothing, propagated, single
from benchctl.metrology.result import Measured, Picture, Trace, message
from benchctl.metrology.swings import fitted
from benchctl.recordings.model import Meta, Step
from benchctl.signals.segments import CHANNELS
from benchctl_instruments.arrays import FloatArray

_FEWEST = 3
_LEAST_DPS = 1.0
_THREE_DB = 1.0 / np.sqrt(2.0)
_EARLY_RAD = 0.3
"""Phase up to which that of any low-pass is proportional to the frequency."""
_ORDER = 5
_BETWEEN = 33
_NAMES = ("bandwidth", "delay")


@dataclass(frozen=True, slots=True, kw_only=True)
class _Response:
    step: int
    frequency_hz: float
    gain: float
    phase_rad: float
    amplitude_dps: float
    standard: float
    """Of the gain, relative; and of the phase, rad: the noise is equal along the phasor and perpendicular to it."""


def response_tests(obs: Observations) -> Iterator[Measured]:
    """Yield bandwidth and delay."""
    if obs.reference is None:
        yield from (refused(name, message("needs_scale_factor")) for name in _NAMES)
        return
    swings = list(_responses(obs))
    frequencies, gains, phases, standard = _by_frequency(swings)
    if frequencies.size < _FEWEST:
        yield from (refused(name, message("needs_sines", found=frequencies.size, needed=_FEWEST)) for name in _NAMES)
        return
    quantities = [
        single("static curve", _curve_misfit(obs, swings), "residual of the curve through the sweep", kind="A"),
        Quantity(name="gain", root=np.diag(gains * standard), kind="A", note="scatter of the samples of a swing"),
        Quantity(name="phase", root=np.diag(standard), kind="A", note="scatter of the samples of a swing"),
    ]
    table = (
        column("frequency", "Hz", frequencies),
        column("gain", "1", gains),
        column("phase", "deg", np.rad2deg(phases)),
    )

    def band(offsets: Offsets) -> FloatArray:
        falls = _first_below(frequencies, gains * (1.0 + offsets["static curve"]) + offsets["gain"], _THREE_DB)
        lags = _first_below(frequencies, phases + offsets["phase"], -0.5 * np.pi)
        return np.asarray(np.minimum(falls, lags))

    early = np.abs(phases) <= _EARLY_RAD
    early[0] = True

    def late_ms(offsets: Offsets) -> FloatArray:
        x = -2.0 * np.pi * frequencies[early] / standard[early]
        y = (phases[early] + offsets["phase"][:, early]) / standard[early]
        return np.asarray(1e3 * (y @ x) / (x @ x))

    beyond = bool((gains <= _THREE_DB).any() or (phases <= -0.5 * np.pi).any())
    steps = tuple(sorted({one.step for one in swings}))
    celsius = celsius_of(obs.stretches[obs.reference].temperature_c)
    yield Measured(
        name="bandwidth",
        unit=UNITS["bandwidth"],
        value=float(as_read(band, quantities)),
        uncertainty=propagated(band, quantities) if beyond else nothing(),
        bound="" if beyond else "at least",
        temperature_c=celsius,
        steps=steps,
        table=table,
        picture=Picture(
            x="frequency",
            x_unit=UNITS["bandwidth"],
            y="gain",
            y_unit="1",
            traces=(Trace(label="readings", x=frequencies, y=gains, standard=gains * standard),),
            left=(Trace(label="phase", x=frequencies, y=np.rad2deg(phases)),),
            left_unit="deg",
            limited="x",
        ),
    )
    yield Measured(
        name="delay",
        unit=UNITS["delay"],
        value=float(as_read(late_ms, quantities)),
        uncertainty=propagated(late_ms, quantities),
        temperature_c=celsius,
        steps=steps,
        table=table,
    )


def _responses(obs: Observations) -> Iterator[_Response]:
    home_c = obs.stretches[obs.reference or 0].setpoint_c
    points = obs.at_reference
    curve = np.zeros(1) if points is None else np.polyfit(points.rate_dps, points.output_v, _order(points.rate_dps))
    for info in obs.recording.infos:
        near = same_set_point(info.chamber_setpoint_c, home_c)
        if info.kind == "sine" and info.whole and info.frequency_hz and near and not info.mounting:
            step = obs.recording.step(info.index, CHANNELS)
            swing = _response(step, info.frequency_hz, curve, obs.recording.meta)
            if swing is not None:
                yield swing


def _by_frequency(swings: Sequence[_Response]) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return increasing frequencies, and at each the mean gain, phase and its standard uncertainty; (n,) each."""
    frequencies = np.unique([one.frequency_hz for one in swings])
    alike = [[one for one in swings if one.frequency_hz == hz] for hz in frequencies]
    return (
        frequencies,
        np.array([np.mean([one.gain for one in own]) for own in alike]),
        np.array([np.mean([one.phase_rad for one in own]) for own in alike]),
        np.array([np.linalg.norm([one.standard for one in own]) / len(own) for own in alike]),
    )


def _curve_misfit(obs: Observations, swings: Sequence[_Response]) -> float:
    """Return the relative uncertainty of the static gain at the swings' amplitude, from the curve's residual."""
    points = obs.at_reference
    if points is None:
        return 0.0
    curve = np.polyfit(points.rate_dps, points.output_v, _order(points.rate_dps))
    left_v = float(np.std(points.output_v - np.polyval(curve, points.rate_dps)))
    smallest_dps = min(swing.amplitude_dps for swing in swings)
    return left_v / (abs(obs.scale_v_per_dps) * smallest_dps)


def _order(rate_dps: FloatArray) -> int:
    return min(_ORDER, np.unique(np.round(rate_dps, 3)).size - 1)


def _response(step: Step, frequency_hz: float, curve: FloatArray, meta: Meta) -> _Response | None:
    """Return the output's fundamental over that of the static curve for the same motion; None if it hardly moves."""
    swing = fitted(step, frequency_hz, meta)
    if swing is None or abs(swing.rate_phasor) < _LEAST_DPS:
        return None
    size = abs(swing.rate_phasor)
    once = np.cos(2.0 * np.pi * np.arange(128) / 128.0)
    static = 2.0 * float(np.mean(np.polyval(curve, size * once) * once))
    ratio = swing.output_phasor / swing.rate_phasor * size / static
    return _Response(
        step=step.info.index,
        frequency_hz=frequency_hz,
        gain=abs(ratio),
        phase_rad=float(np.angle(ratio)),
        amplitude_dps=size,
        standard=float(np.std(swing.left_v) * np.sqrt(2.0 / swing.left_v.size)) / abs(swing.output_phasor),
    )


def _first_below(frequencies: FloatArray, values: FloatArray, limit: float) -> FloatArray:
    """Return where values (d, n) over increasing frequencies first fall below a limit, else the highest; (d,).

    Between two frequencies a cubic spline over their logarithm is used.
    """
    crossing = np.full(values.shape[0], frequencies[-1])
    below = values < limit
    first = np.argmax(below, axis=1)
    logs = np.log(frequencies)
    for at in np.unique(first[below.any(axis=1)]).tolist():
        own = below.any(axis=1) & (first == at)
        between = np.linspace(logs[max(at - 1, 0)], logs[at], _BETWEEN)
        curves = CubicSpline(logs, values[own], axis=1)(between)
        falls = np.argmax(curves <= limit, axis=1)
        rows, before = np.arange(falls.size), np.maximum(falls - 1, 0)
        drop = curves[rows, before] - curves[rows, falls]
        share = np.divide(curves[rows, before] - limit, drop, out=np.ones_like(drop), where=drop > 0.0)
        crossing[own] = np.exp(between[before] + share * (between[falls] - between[before]))
    return crossing
