"""One joint weighted fit of every run: law, bias, delay and the encoder's error at once, with calibrated intervals.

Each step is split into its mean, which determines the bias and shares its random walk with all other steps, and the
blocks about the mean, whose noise is white except for the encoder's. Gauss-Newton on both together; after every
iteration the noise is estimated again (`noise_model`). The encoder's error at one and two periods per turn is a
nuisance of four amplitudes, constrained only by its stated accuracy: without it a sine about one angle would put the
slope of that error into the scale factor.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from dataclasses import dataclass

import numpy as np

from benchctl.calibration.model import Law
from benchctl.calibration.noise_model import (
    LinearMeans,
    MeansNoise,
    StepScores,
    autocovariances,
    estimate,
    likely_noises,
    linear_means,
    project,
    score_scatter,
    walk_covariance,
)
from benchctl.calibration.rows import Rows, gather
from benchctl.calibration.thermistor import ThermalHistory
from benchctl.calibration.uncertainty import Mixture
from benchctl.signals.normal import DEVIATION_OF_MEDIAN
from benchctl.signals.reduce import ReducedStep
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import UsageError

ENCODER_TERMS = (
    "encoder_sin1_arcsec",
    "encoder_cos1_arcsec",
    "encoder_sin2_arcsec",
    "encoder_cos2_arcsec",
)
THERMAL_LAG = "thermal_lag_s"
LIKELY_LAG_S = 600.0
_LAG_STEP_S = 3.0
_NUDGE_C = 0.01
_TURNS = 25
_UNKNOWN_ACCURACY_ARCSEC = 200.0
_ROBUST_AT = 4.0
_MOST_LAGS = 12
_LEAST_STEP = 1e-3
_LEAST_EIGENVALUE = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class JointProblem:
    """What to fit: the law, powers of ΔT in the bias, and whether the delay and the encoder's error are free.

    `encoder_accuracy_arcsec` is the standard deviation of a normal prior of the encoder's amplitudes, 0 if unknown.
    With a `thermal` history the lag of the coil behind the thermistor is fitted too, with a normal prior of 600 s
    about 0.
    """

    law: Law
    bias_terms: int
    T0_c: float
    earth_rate_dps: float = 0.0
    delay: bool = True
    encoder: bool = True
    encoder_accuracy_arcsec: float = 0.0
    robust: bool = True
    thermal: ThermalHistory | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in order."""
        bias = ("U0_v", *(f"c{i + 1}" for i in range(self.bias_terms)))
        delay = ("delay_s",) if self.delay else ()
        lag = (THERMAL_LAG,) if self.thermal else ()
        return (*self.law.names, *bias, *delay, *lag, *(ENCODER_TERMS if self.encoder else ()))


@dataclass(frozen=True, slots=True, kw_only=True)
class JointSolution:
    """The solution: estimates as a mixture over the likely noises, the noise itself, and the quality of the fit.

    `freedom` is the number of steps in motion behind the scatter: the degrees of freedom of intervals.
    """

    names: tuple[str, ...]
    mixture: Mixture
    white_v: float
    means_noise: MeansNoise
    rows: int
    bic: float
    freedom: float
    converged: bool

    @property
    def estimate(self) -> FloatArray:
        """Estimates, shape (p,)."""
        return self.mixture.mean

    @property
    def covariance(self) -> FloatArray:
        """Covariance of the estimates, shape (p, p)."""
        return self.mixture.covariance


def predict(problem: JointProblem, parameters: FloatArray, rows: Rows) -> tuple[FloatArray, FloatArray]:
    """Return the mean output of each block (n,) and its derivatives by the parameters (n, p)."""
    laws = len(problem.law.names)
    bias_end = laws + 1 + problem.bias_terms
    rest = parameters[bias_end:]
    delay = float(rest[0]) if problem.delay else 0.0
    rate = rows.true_rate(delay) + problem.earth_rate_dps
    if problem.encoder:
        rate = rate - rows.encoder_basis @ rest[-4:]
    dt_c, lag = rows.dt_c, float(rest[int(problem.delay)]) if problem.thermal else 0.0
    if problem.thermal:
        dt_c = dt_c + problem.thermal.behind(rows.time_s, lag)
    low = problem.law.volts_and_slopes(parameters[:laws], rate - rows.spread_dps, dt_c)
    high = problem.law.volts_and_slopes(parameters[:laws], rate + rows.spread_dps, dt_c)
    powers = dt_c[:, None] ** np.arange(problem.bias_terms + 1)
    output = 0.5 * (low[0] + high[0]) + powers @ parameters[laws:bias_end]
    by_rate = 0.5 * (low[2] + high[2])
    columns = [0.5 * (low[1] + high[1]), powers]
    if problem.delay:
        late = delay - rows.expanded_at_s
        columns.append((by_rate * (late * rows.jerk_dps3 - rows.acceleration_dps2))[:, None])
    if problem.thermal:
        ends = [problem.thermal.behind(rows.time_s, lag + step) for step in (-_LAG_STEP_S, _LAG_STEP_S)]
        by_lag = (ends[1] - ends[0]) / (2 * _LAG_STEP_S)
        columns.append((_by_temperature(problem, parameters, rate, dt_c) * by_lag)[:, None])
    if problem.encoder:
        columns.append(-by_rate[:, None] * rows.encoder_basis)
    return output, np.concatenate(columns, axis=1)


def _by_temperature(problem: JointProblem, parameters: FloatArray, rate: FloatArray, dt_c: FloatArray) -> FloatArray:
    """Return the derivative of the output by the coil's temperature, V/°C, shape (n,)."""
    laws = len(problem.law.names)
    bias = parameters[laws : laws + 1 + problem.bias_terms]

    def output(at_c: FloatArray) -> FloatArray:
        return problem.law.volts(parameters[:laws], rate, at_c) + at_c[:, None] ** np.arange(bias.size) @ bias

    return np.asarray((output(dt_c + _NUDGE_C) - output(dt_c - _NUDGE_C)) / (2 * _NUDGE_C))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Class:
    """Blocks with a common noise: their rows, and the number of blocks correlated by the encoder's smoother."""

    rows: IntArray
    lags: int


def _classes(steps: Sequence[ReducedStep], rows: Rows) -> list[_Class]:
    """Return blocks of equal kind, length and smoother; those at rest contribute only their mean."""
    keys: dict[Hashable, list[int]] = {}
    for i, step in enumerate(steps):
        if step.kind == "constant_rate":
            keys.setdefault("constant_rate", []).append(i)
        elif step.kind == "motion":
            keys.setdefault((round(step.block_s, 6), step.smoother), []).append(i)
    classes = []
    for members in keys.values():
        first = steps[members[0]]
        lags = 1 if first.kind == "constant_rate" else min(_MOST_LAGS, int(first.smoother.window_s / first.block_s) + 2)
        classes.append(_Class(rows=np.flatnonzero(np.isin(rows.step, members)), lags=lags))
    return classes


def _white_of_means(
    steps: Sequence[ReducedStep], rows: Rows, residual: FloatArray, classes: list[_Class]
) -> FloatArray:
    """Return the white variance of the mean of each step, V², shape (m,), from the scatter of blocks of its class."""
    per_sample = np.zeros(rows.steps)
    weighted = residual * np.sqrt(rows.count)
    still = [i for i, step in enumerate(steps) if step.kind == "static"]
    everything = [*classes, _Class(rows=np.flatnonzero(np.isin(rows.step, still)), lags=1)]
    for group in everything:
        if group.rows.size == 0:
            continue
        members = rows.step[group.rows]
        gamma = autocovariances(weighted[group.rows], members, group.lags)
        left = 1.0 - (2 * group.lags + 1) * np.unique(members).size / members.size  # removed with each step's mean
        # The noise at low frequency: the encoder's differentiated noise cancels in a mean.
        per_sample[np.unique(members)] = max(gamma[0] + 2 * float(gamma[1:].sum()), 0.2 * gamma[0]) / max(left, 0.2)
    floor = 1e-12 * max(float(np.median(np.abs(rows.output_v))), 1e-6) ** 2
    return np.maximum(per_sample, floor) / np.add.reduceat(rows.count, rows.start)


def fit_joint(problem: JointProblem, steps: Sequence[ReducedStep], start: FloatArray) -> JointSolution:
    """Fit the problem; `start` has the shape of `problem.names`. Steps must be in time order.

    Raises `UsageError` if the steps do not determine the parameters, or the law has no output at their rates.
    """
    rows = gather(steps, problem.T0_c)
    classes = _classes(steps, rows)
    wiener = walk_covariance(rows.means(rows.time_s), np.array([step.duration_s for step in steps]))
    parameters = np.array(start, dtype=np.float64)
    noise: MeansNoise | None = None
    converged = False
    for _ in range(_TURNS):
        blocks = _linearise(problem, steps, rows, classes, wiener, parameters)
        _demand_told_apart(problem, blocks.means)
        noise = estimate(blocks.means, noise)
        total, gradient, deviance = blocks.means.solve(noise)
        bread = _inverse(total)
        change = bread @ gradient
        if bool(np.all(np.abs(change) <= 1e-2 * np.sqrt(np.diag(bread)))):
            converged = True
            break
        parameters = parameters + change * _reach(problem, parameters, change, rows)
    # Estimate again without a start: a bad start of the fit may have led the noise to a local optimum.
    noise = estimate(blocks.means)
    deviance = blocks.means.solve(noise)[2]
    moving, turning = _scores(steps, blocks)
    estimates, covariances, weights = [], [], []
    for likely, weight in likely_noises(blocks.means, noise):
        total, gradient, _ = blocks.means.solve(likely)
        bread = _inverse(total)
        meat = total - blocks.white_information + score_scatter(moving, bread) + score_scatter(turning, bread)
        estimates.append(parameters + bread @ gradient)
        covariances.append(bread @ meat @ bread)
        weights.append(weight)
    mixture = Mixture(weights=np.array(weights), means=np.array(estimates), covariances=np.array(covariances))
    white = np.sqrt(np.median(blocks.means.variance * np.add.reduceat(rows.count, rows.start)))
    used = int(sum(group.rows.size for group in classes)) + rows.steps
    return JointSolution(
        names=problem.names,
        mixture=mixture,
        white_v=float(white),
        means_noise=noise,
        rows=used,
        bic=blocks.chi_square + deviance + parameters.size * float(np.log(used)),
        freedom=float(max(3, len(moving) or len(turning))),
        converged=converged,
    )


def _reach(problem: JointProblem, parameters: FloatArray, change: FloatArray, rows: Rows) -> float:
    """Return the share of a change that the law can follow (a polynomial must stay monotonic); usually all of it."""
    laws = len(problem.law.names)
    fastest = 1.05 * float(np.max(np.abs(rows.rate_dps) + rows.spread_dps))
    extremes = np.array([float(rows.dt_c.min()), float(rows.dt_c.max())])
    share = 1.0
    while True:
        try:
            problem.law.volts((parameters + share * change)[:laws], np.full(2, fastest), extremes)
        except UsageError:
            if share < _LEAST_STEP:
                raise
            share /= 4
        else:
            return share


@dataclass(frozen=True, slots=True, kw_only=True)
class _Linear:
    """The linearised problem at the current parameters: the means, and per class the blocks about them.

    `classes` holds the step of each block, its weighted derivatives (n, p) and its weighted residual (n,).
    """

    means: LinearMeans
    classes: list[tuple[IntArray, FloatArray, FloatArray]]
    white_information: FloatArray
    chi_square: float


def _linearise(
    problem: JointProblem,
    steps: Sequence[ReducedStep],
    rows: Rows,
    classes: list[_Class],
    wiener: FloatArray,
    parameters: FloatArray,
) -> _Linear:
    """Return residuals and derivatives, split into means and blocks about them, weighted by the blocks' scatter."""
    output, derivative = predict(problem, parameters, rows)
    residual = rows.output_v - output
    mean_residual, mean_derivative = rows.means(residual), rows.means(derivative)
    centred = residual - mean_residual[rows.step]
    prior = _prior(problem)
    white_information = np.zeros((parameters.size, parameters.size))
    gradient = -prior * parameters
    weighted: list[tuple[IntArray, FloatArray, FloatArray]] = []
    chi_square = 0.0
    for group in classes:
        root = np.sqrt(rows.count[group.rows])
        e = centred[group.rows] * root
        weight, variance = _weights(e, problem.robust)
        root *= np.sqrt(weight / variance)
        members = rows.step[group.rows]
        X = (derivative[group.rows] - mean_derivative[members]) * root[:, None]
        if steps[members[0]].kind == "constant_rate":
            # About their mean, constant rates contain only the encoder's noise and error, not the scale factor.
            X[:, : X.shape[1] - len(ENCODER_TERMS) * problem.encoder] = 0.0
        e = centred[group.rows] * root
        white_information += X.T @ X
        gradient = gradient + X.T @ e
        weighted.append((members, X, e))
        chi_square += float(e.size * np.log(variance))
    means = linear_means(
        residual=mean_residual,
        derivative=mean_derivative,
        white=_white_of_means(steps, rows, centred, classes),
        wiener=wiener,
        information=white_information + np.diag(prior),
        gradient=gradient,
    )
    return _Linear(means=means, classes=weighted, white_information=white_information, chi_square=chi_square)


def _scores(steps: Sequence[ReducedStep], blocks: _Linear) -> tuple[list[StepScores], list[StepScores]]:
    """Return the scores of each step's blocks, in motion and at constant rates."""
    moving: list[StepScores] = []
    turning: list[StepScores] = []
    for members, derivative, residual in blocks.classes:
        edges = np.flatnonzero(np.diff(members)) + 1
        for start, stop in zip([0, *edges], [*edges, members.size], strict=True):
            score = project(derivative[start:stop], residual[start:stop])
            (turning if steps[members[start]].kind == "constant_rate" else moving).append(score)
    return moving, turning


def _prior(problem: JointProblem) -> FloatArray:
    """Return the prior information, (p,): of the encoder's stated accuracy, and of typical lags of gyros."""
    information = np.zeros(len(problem.names))
    if problem.thermal:
        information[problem.names.index(THERMAL_LAG)] = 1.0 / LIKELY_LAG_S**2
    if problem.encoder:
        information[-4:] = 1.0 / (problem.encoder_accuracy_arcsec or _UNKNOWN_ACCURACY_ARCSEC) ** 2
    return information


def _weights(e: FloatArray, robust: bool) -> tuple[FloatArray, float]:
    """Return Huber weights beyond four deviations (1 for normal noise), and the weighted variance."""
    if not robust:
        return np.ones(e.size), max(float(np.mean(e**2)), 1e-30)
    deviation = max(DEVIATION_OF_MEDIAN * float(np.median(np.abs(e))), 1e-15)
    weight = np.minimum(1.0, _ROBUST_AT * deviation / np.maximum(np.abs(e), 1e-300))
    return weight, max(float(np.mean(weight * e**2)), 1e-30)


def _demand_told_apart(problem: JointProblem, means: LinearMeans) -> None:
    """Raise `UsageError` if a parameter, or a combination of several, has no effect on the data."""
    information = means.information + means.derivative.T @ means.derivative
    scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    if values[0] > _LEAST_EIGENVALUE:
        return
    lost = [name for name, part in zip(problem.names, vectors[:, 0], strict=True) if abs(part) > 0.1]
    raise UsageError(f"{', '.join(lost)} cannot be distinguished by these runs; record more rates and temperatures")


def _inverse(information: FloatArray) -> FloatArray:
    """Invert an information matrix, scaled so that different units cause no loss of accuracy."""
    scale = 1.0 / np.sqrt(np.diag(information))
    inverse: FloatArray = np.linalg.inv(information * np.outer(scale, scale)) * np.outer(scale, scale)
    return inverse
