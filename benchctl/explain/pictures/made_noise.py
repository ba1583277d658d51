"""Pictures of noise, Allan deviations and bias residuals, from simulated series."""

from __future__ import annotations

import numpy as np

from benchctl.explain.pictures.sketch import Band, Look, Panel, Sketch, SketchedCurve, one_panel
from benchctl.metrology.allan import NAMES, TERMS, Term, unit_of, variances
from benchctl.reports.acceptance.catalogue import catalogue
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.gyro import earth_rate_dps

_SIZES = (1e-4, 1.2e-4, 2.5e-5, 1.2e-6, 6e-9)
"""Q, N, B, K and R in deg/s and seconds: a gyro of the VG910 class, with quantisation and drift."""
_SLOPES = {"Q": "−1", "N": "−1/2", "B": "0", "K": "+1/2", "R": "+1"}
_READ_AT_S = {"Q": 3.0**0.5, "N": 1.0, "K": 3.0, "R": 2.0**0.5}
_NAMED_AT_S = {"Q": 0.05, "N": 4.0, "B": 0.05, "K": 1e4, "R": 2e3}
_LOWEST_DPH = 5e-3
"""Smaller deviations are not drawn, because other terms dominate there."""
_DEG_PER_H = 3600.0


def allan(shown: str) -> Sketch:
    """Plot the Allan deviation of five noises together and of each separately; `shown` is highlighted."""
    tau_s = np.geomspace(0.02, 3e4, 300)
    parts = variances(tau_s, 1e-3) * np.array(_SIZES) ** 2
    curves = [SketchedCurve(x=tau_s, y=_DEG_PER_H * np.sqrt(parts.sum(axis=1)), look="off", label="all five together")]
    marks = []
    for place, term in enumerate(TERMS):
        look: Look = "on" if term == shown else "third" if not shown else "faint"
        alone = _DEG_PER_H * np.sqrt(parts[:, place])
        label = f"{term}, {NAMES[term]}: slope {_SLOPES[term]}" if term == shown else ""
        curves.append(SketchedCurve(x=tau_s, y=np.where(alone > _LOWEST_DPH, alone, np.nan), look=look, label=label))
        place_s = _NAMED_AT_S[term]
        marks.append((place_s, float(np.interp(place_s, tau_s, alone)), term))
    return one_panel(
        "Allan deviation",
        _allan_caption(shown),
        *curves,
        x="averaging time τ (s)",
        y="Allan deviation (°/h)",
        marks=tuple(marks),
        logarithmic="xy",
        share=2.0,
    )


def _allan_caption(shown: str) -> str:
    if shown not in TERMS:
        return "Slopes: Q −1, N −1/2, B 0, K +1/2, R +1. Which one rules depends on the averaging time."
    term: Term = next(one for one in TERMS if one == shown)
    unit = unit_of(term, "deg/s")
    size, printed = unit.factor * _SIZES[TERMS.index(term)], catalogue("en").unit(unit.name)
    where = f", read off at τ = {_READ_AT_S[term]:.3g} s" if term in _READ_AT_S else ", its flat part over 0.664"
    return f"{term} = {size:.3g} {printed} here: slope {_SLOPES[term]}{where}; the other four stand back."


def bias() -> Sketch:
    """Plot the output at rest, and the part that is due to the Earth's rate."""
    minutes = np.linspace(0.0, 60.0, 361)
    wander = np.cumsum(np.random.default_rng(3).standard_normal(minutes.size)) * 0.25
    earth = _DEG_PER_H * earth_rate_dps(58.5)
    rest = 40.0 + wander - wander.mean()
    return one_panel(
        "Bias",
        "An hour at rest, in means of 10 s: Earth's rate at 58.5° N is taken off, the rest is the bias.",
        SketchedCurve(x=minutes, y=rest, look="grey", label="means of 10 s"),
        SketchedCurve(x=minutes, y=np.full(minutes.size, 40.0), look="on", label="their mean"),
        x="time (min)",
        y="output over K (°/h)",
        bands=(
            Band(low=0.0, high=earth, label="Earth's rate", look="open", across=True),
            Band(low=earth, high=40.0, label="bias", look="good", across=True),
        ),
    )


def bias_stability() -> Sketch:
    """Plot samples, means of 10 s, and their standard deviation."""
    rng = np.random.default_rng(11)
    time_s = np.linspace(0.0, 1200.0, 12000, endpoint=False)
    samples = 8.0 * rng.standard_normal(time_s.size) + 0.08 * np.cumsum(rng.standard_normal(time_s.size))
    means = samples.reshape(-1, 100).mean(axis=1)
    middle_s = time_s.reshape(-1, 100).mean(axis=1)
    spread, centre = float(np.std(means, ddof=1)), float(means.mean())
    return one_panel(
        "Bias stability",
        f"Means over 10 s scatter by {spread:.2g} °/h (1σ): that is not the minimum of the Allan deviation.",
        SketchedCurve(x=time_s / 60.0, y=samples, look="faint", label="samples"),
        SketchedCurve(x=middle_s / 60.0, y=means, look="on dots", label="means of 10 s"),
        x="time (min)",
        y="output at rest (°/h)",
        bands=(Band(low=centre - spread, high=centre + spread, label="± 1σ", look="good", across=True),),
    )


def whitening() -> Sketch:
    """Plot a drifting residual before and after the whitening filter, with autocorrelations."""
    rng = np.random.default_rng(5)
    white = rng.standard_normal(800)
    wandering = white + 0.35 * np.cumsum(rng.standard_normal(800))
    # subtract the prediction from past samples: their exponentially weighted mean
    predicted = np.zeros_like(wandering)
    for k in range(1, wandering.size):
        predicted[k] = predicted[k - 1] + 0.3 * (wandering[k - 1] - predicted[k - 1])
    whitened = wandering - predicted
    number = np.linspace(0.0, 799.0, 800)
    lags = np.linspace(0.0, 59.0, 60)
    return Sketch(
        title="Whitening",
        caption="A wandering residual looks like structure; filtered, each sample knows nothing of the others.",
        panels=(
            Panel(
                x="sample (number)",
                y="residual (1)",
                curves=(
                    SketchedCurve(x=number, y=wandering, look="grey", label="as it is"),
                    SketchedCurve(x=number, y=whitened, look="on", label="whitened"),
                ),
                zero=True,
            ),
            Panel(
                x="lag (samples)",
                y="correlation (1)",
                curves=(
                    SketchedCurve(x=lags, y=_correlation(wandering, lags), look="grey", label="as it is"),
                    SketchedCurve(x=lags, y=_correlation(whitened, lags), look="on", label="whitened"),
                ),
                zero=True,
                share=0.9,
            ),
        ),
    )


def _correlation(values: FloatArray, lags: FloatArray) -> FloatArray:
    centred = values - values.mean()
    own = float(centred @ centred)
    return np.array([float(centred[: values.size - k] @ centred[k:]) / own for k in lags.astype(int).tolist()])
