"""Bias, its stability, and the noises of the longest rest.

Bias is the mean output at rest over the scale factor, minus the Earth's rate about the vertical axis. Stability is the
standard deviation of 10-s means; instability, random walks, quantisation and ramp are terms of the Allan deviation.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from scipy.linalg import toeplitz
from scipy.special import chdtri

from benchctl.calibration.result import Contribution
from benchctl.calibration.uncertainty import LEVEL, K, effective_dof
from benchctl.metrology.allan import TERMS, Allan, Term, analysed, densities, unit_of
from benchctl.metrology.drift import likeliest
from benchctl.metrology.names import UNITS
from benchctl.metrology.observations import (
    Observations,
    celsius_of,
    column,
    has_rest,
    measured,
    refused,
    same_set_point,
)
from benchctl.metrology.points import line
from benchctl.metrology.propagation import Offsets, as_read, propagated, single
from benchctl.metrology.result import Measured, Message, Picture, Trace, Uncertainty, message
from benchctl.metrology.series import series_of_step
from benchctl.metrology.stretches import residual_structure_of
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.gyro import EARTH_DPS, earth_rate_dps

_DEG_PER_H = 3600.0
_TERMS: Mapping[str, Term] = {
    "quantisation": "Q",
    "angle_random_walk": "N",
    "bias_instability": "B",
    "rate_random_walk": "K",
    "rate_ramp": "R",
}
_OF_NOISE = ("bias_stability", *_TERMS)
_FEWEST_MEANS = 10
_LOWEST = 0.1
"""Lowest frequency of the noise that makes means scatter, in reciprocals of the record; slower noise moves them all."""


def rest_tests(obs: Observations) -> Iterator[Measured]:
    """Yield the bias, its stability, and five terms."""
    if obs.reference is None:
        yield from (refused(name, message("needs_scale_factor")) for name in ("bias", *_OF_NOISE))
        return
    yield _bias(obs)
    info = residual_structure_of(obs.recording)
    length_s = 0.0 if info is None else info.t_end - info.t_start
    if info is None or length_s < obs.settings.rest_s:
        why = message("needs_long_rest", found_s=length_s, needed_s=obs.settings.rest_s)
        yield from (refused(name, why) for name in _OF_NOISE)
        return
    scale = obs.scale_v_per_dps if obs.recording.meta.output_unit == "V" else None
    try:
        found = analysed(series_of_step(obs.recording, "gyro_v", str(info.index), scale))
    except UsageError as err:
        why = message("term_refused", why=str(err))
        yield from (refused(name, why) for name in _OF_NOISE)
        return
    yield _stability(obs, found, info.index)
    yield from (_term(obs, found, name, info.index) for name in _TERMS)


def _bias(obs: Observations) -> Measured:
    """Return the bias of the longest rest at the reference's set point."""
    home = obs.stretches[obs.reference or 0]
    longest, where = 0.0, None
    for number, stretch in enumerate(obs.stretches):
        points = obs.in_stretch(number)
        if not stretch.across and same_set_point(stretch.setpoint_c, home.setpoint_c) and has_rest(points):
            rest_s = float(points.duration_s[points.set_dps == 0.0][0])
            if rest_s > longest:
                longest, where = rest_s, number
    if where is None or obs.reference is None:
        return refused("bias", message("needs_rest"))
    points = obs.swept_in([where, obs.reference])
    rest = int(np.flatnonzero((points.stretch == where) & (points.set_dps == 0.0))[0])
    sweep = np.flatnonzero(points.stretch == obs.reference)
    latitude_deg = obs.recording.meta.bench.latitude_deg
    earth_dps = 0.0 if latitude_deg is None else earth_rate_dps(latitude_deg)

    def deg_per_h(offsets: Offsets) -> FloatArray:
        rate_dps, output_v = points.moved(offsets)
        slope = line(rate_dps[:, sweep], output_v[:, sweep])[0]
        return _DEG_PER_H * (output_v[:, rest] / slope - earth_dps - offsets["Earth's rate"][:, 0])

    quantities = [*obs.quantities(points, drifting=False), single("Earth's rate", *_earth(obs, latitude_deg))]
    note = (
        message("latitude_unknown")
        if latitude_deg is None
        else message("earth_taken_off", rate_deg_per_h=_DEG_PER_H * earth_dps)
    )
    return measured(
        "bias",
        float(as_read(deg_per_h, quantities)),
        propagated(deg_per_h, quantities),
        points.of(np.array([rest])),
        notes=(note,),
    )


def _earth(obs: Observations, latitude_deg: float | None) -> tuple[float, str]:
    """Return the standard uncertainty of the Earth's rate about the axis [deg/s], and its source."""
    if latitude_deg is None:
        return EARTH_DPS / float(np.sqrt(3.0)), "latitude not known"
    away = float(np.hypot(obs.stated.latitude_deg.standard, obs.stated.tilt_deg.standard))
    slope = EARTH_DPS * abs(float(np.cos(np.deg2rad(latitude_deg))))
    return slope * float(
        np.deg2rad(away)
    ), f"latitude: {obs.stated.latitude_deg.says}; tilt: {obs.stated.tilt_deg.says}"


def _stability(obs: Observations, found: Allan, step: int) -> Measured:
    """Return the standard deviation of means; its interval follows from the scatter of means of this noise."""
    series = found.series
    long = max(1, round(obs.settings.mean_s / series.interval_s))
    count = series.values.size // long
    if count < _FEWEST_MEANS:
        needed_s = _FEWEST_MEANS * long * series.interval_s
        return refused(
            "bias_stability",
            message("needs_long_rest", found_s=series.values.size * series.interval_s, needed_s=needed_s),
        )
    means = _DEG_PER_H * series.values[: count * long].reshape(count, long).mean(axis=1)
    value = float(np.std(means, ddof=1))
    covariance = _DEG_PER_H**2 * _covariance_of_means(obs, found, count, long)
    centred = covariance - covariance.mean(axis=0) - covariance.mean(axis=1)[:, None] + covariance.mean()
    freedom = float(np.trace(centred) ** 2 / np.sum(centred**2))
    return Measured(
        name="bias_stability",
        unit=UNITS["bias_stability"],
        value=value,
        uncertainty=_of_chi_square(obs, value, freedom),
        notes=(message("mean_of", seconds=obs.settings.mean_s, count=count), *_caution(found)),
        temperature_c=_temperature_c(obs, step),
        steps=(step,),
    )


def _covariance_of_means(obs: Observations, found: Allan, count: int, long: int) -> FloatArray:
    """Return the covariance of means over `long` samples of the Allan deviation's noise, (count, count), unit squared.

    The walk is at least the one estimated from all rests, which a single rest may not show.
    """
    interval_s = found.series.interval_s
    mean_s = long * interval_s
    frequency = np.geomspace(_LOWEST / (count * mean_s), 0.5 / interval_s, 4000)
    squares, walk = found.terms.squares.copy(), TERMS.index("K")
    squares[walk] = max(float(squares[walk]), likeliest(obs.noises).walk / obs.scale_v_per_dps**2)
    density = densities(frequency, interval_s) @ squares
    through = np.sinc(frequency * mean_s) ** 2
    lags_s = mean_s * np.arange(count)
    # a few decades in logarithmic steps; the contributions of lags beyond a step's wavelength average out
    weights = 2.0 * density * through * np.gradient(frequency)
    return np.asarray(toeplitz(np.cos(2.0 * np.pi * np.outer(lags_s, frequency)) @ weights))


def _of_chi_square(obs: Observations, value: float, freedom: float) -> Uncertainty:
    tails = np.array([0.5 * (1.0 - LEVEL), 0.5 * (1.0 + LEVEL)])
    low, high = (value * np.sqrt(freedom / chdtri(freedom, tails))).tolist()
    return _by_scatter(obs, value, low, high, value / np.sqrt(2.0 * freedom), freedom)


def _by_scatter(
    obs: Observations, value: float, low: float, high: float, standard: float, dof: float = math.inf
) -> Uncertainty:
    """Return the uncertainty of a result of known distribution: its interval combined with the converter's gain."""
    gain = value * 1e-6 * obs.stated.gain_ppm.standard
    return Uncertainty(
        standard=float(np.hypot(standard, gain)),
        expanded=float(np.hypot(0.5 * (high - low), K * gain)),
        dof=effective_dof(((standard, dof), (gain, math.inf))),
        monte_carlo=0.5 * (high - low),
        contributors=(
            Contribution(source="scatter", standard=standard, kind="A", says="length of the record", dof=dof),
            Contribution(source="converter's gain", standard=gain, kind="B", says=obs.stated.gain_ppm.says),
        ),
        says=message("chi_square", low=low, high=high),
    )


def _term(obs: Observations, found: Allan, name: str, step: int) -> Measured:
    term = _TERMS[name]
    one = found.terms.found.get(term)
    if one is None:
        return refused(name, message("term_refused", why=found.terms.refused[term]))
    factor = unit_of(term, "deg/s").factor
    low, high = (factor * limit for limit in one.ci95)
    value = factor * one.value
    notes = _caution(found)
    if name == "bias_instability":
        lowest = int(np.argmin(found.deviation))
        least = _DEG_PER_H * float(found.deviation[lowest])
        notes = (message("allan_minimum", value=least, tau_s=float(found.tau_s[lowest])), *notes)
    return Measured(
        name=name,
        unit=UNITS[name],
        value=value,
        uncertainty=_by_scatter(obs, value, low, high, 0.25 * (high - low)),
        notes=notes,
        temperature_c=_temperature_c(obs, step),
        steps=(step,),
        picture=_picture(found) if name == "angle_random_walk" else None,
        table=(
            (column("tau", "s", found.tau_s), column("allan_deviation", "deg/h", _DEG_PER_H * found.deviation))
            if name == "angle_random_walk"
            else ()
        ),
    )


def _caution(found: Allan) -> tuple[Message, ...]:
    """Return the note that the terms, and what follows from them, do not describe the rest; empty if they do."""
    misfit = found.misfit
    if misfit is None:
        return ()
    value, modelled = _DEG_PER_H * misfit.deviation, _DEG_PER_H * misfit.modelled
    return (message("terms_misfit", tau_s=misfit.tau_s, value=value, modelled=modelled),)


def _picture(found: Allan) -> Picture:
    modelled = np.sqrt(found.terms.modelled(found.tau_s, found.series.interval_s))
    return Picture(
        x="tau",
        x_unit="s",
        y="allan_deviation",
        y_unit="deg/h",
        traces=(
            Trace(
                label="readings",
                x=found.tau_s,
                y=_DEG_PER_H * found.deviation,
                standard=_DEG_PER_H * found.deviation / np.sqrt(2.0 * found.freedom),
            ),
            Trace(label="terms", x=found.tau_s, y=_DEG_PER_H * modelled, dots=False),
        ),
        logarithmic=True,
    )


def _temperature_c(obs: Observations, step: int) -> float | None:
    own = [reading.temperature_c for stretch in obs.stretches for reading in stretch.readings if reading.step == step]
    return celsius_of(*own) if own else None
