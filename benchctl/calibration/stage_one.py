"""Stage 1 of the paper: constant rates at T0 give K0 and k(ω), slopes at every temperature give k(T), rest gives U0(T).

Convention `correction`, argument `indicated` (facts: the paper's k grows with ω while an interferometer's output falls
short). K0 is the slope over |ω| ≤ 40 °/s, at T0; k(T) is 1 at T0 by construction; every temperature's slope is over
|ω| ≤ 50 °/s, so that the curvature cancels if all temperatures have the same rates.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from benchctl.calibration.result import MeanPoints, PolynomialFactor, StraightLine, TemperaturePoint
from benchctl.calibration.rows import Rows
from benchctl.estimation.linear import LinearFit, fit_linear
from benchctl.signals.reduce import ReducedStep
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.response_gyro import one_plus

K0_LIMIT_DPS = 40.0
SLOPE_LIMIT_DPS = 50.0
SAME_TEMPERATURE_C = 2.0
_CURVED_FROM_DPS = 60.0


@dataclass(frozen=True, slots=True, kw_only=True)
class StageOne:
    """The result of stage 1; `u0_t` are the coefficients of the bias over ΔT, V/°C^i.

    Standard uncertainties of K0 and U0 have their degrees of freedom.
    """

    line: StraightLine
    K0_v_per_dps: float
    K0_standard: float
    K0_dof: float
    U0_v: float
    U0_standard: float
    U0_dof: float
    u0_t: tuple[float, ...]
    k_t: PolynomialFactor
    k_omega: PolynomialFactor
    temperatures: tuple[TemperaturePoint, ...]
    warnings: tuple[str, ...]


def mean_points(steps: Sequence[ReducedStep], verify: frozenset[tuple[int, int]]) -> MeanPoints:
    """Return the means of the steps at rest and at constant rate, in time order."""
    quiet = [step for step in steps if step.kind in ("static", "constant_rate")]

    def mean(step: ReducedStep, values: FloatArray) -> float:
        return float(np.average(values, weights=step.count))

    def standard_error(step: ReducedStep) -> float:
        return float(np.std(step.output_v, ddof=1) / np.sqrt(step.count.size))

    return MeanPoints(
        step=np.array([step.info.index for step in quiet], dtype=np.int64),
        time_s=np.array([mean(step, step.time_s) for step in quiet]),
        rate_dps=np.array([mean(step, step.rate_dps) for step in quiet]),
        temperature_c=np.array([step.mean_temperature_c for step in quiet]),
        setpoint_c=np.array([step.info.chamber_setpoint_c for step in quiet]),
        output_v=np.array([mean(step, step.output_v) for step in quiet]),
        output_se_v=np.array([standard_error(step) for step in quiet]),
        samples=np.array([step.samples for step in quiet], dtype=np.int64),
        revolutions=np.array([step.revolutions for step in quiet]),
        verify=np.array([step.key in verify for step in quiet], dtype=np.bool_),
    )


def group_by_temperature(temperature_c: FloatArray) -> list[IntArray]:
    """Return the indices of points within `SAME_TEMPERATURE_C` of their neighbours, coldest group first."""
    if not np.all(np.isfinite(temperature_c)):
        return [np.arange(temperature_c.size)]
    order = np.argsort(temperature_c, kind="stable")
    breaks = np.flatnonzero(np.diff(temperature_c[order]) > SAME_TEMPERATURE_C) + 1
    return [np.sort(group) for group in np.split(order, breaks)]


def stage_one(
    points: MeanPoints, T0_c: float, earth_rate_dps: float, orders: tuple[int, int, int] = (2, 2, 2)
) -> StageOne:
    """Fit stage 1 to the points that are not held out; `orders` of k(T), k(ω) and the bias over temperature.

    Raises `UsageError` if no temperature has two different rates: nothing can be fitted without motion.
    """
    use = np.flatnonzero(~points.verify)
    warnings: list[str] = []
    groups = [use[group] for group in group_by_temperature(points.temperature_c[use])] if use.size else []
    lines = [(group, _slope(points, group, earth_rate_dps, SLOPE_LIMIT_DPS)) for group in groups]
    usable = [(group, line) for group, line in lines if line is not None]
    if not usable:
        raise UsageError(
            "calibration: stage 1 needs steps at two constant rates (or a rate and rest) at one temperature, the "
            f"recording has {use.size} such steps and no two rates among them; record a rate sweep"
        )
    dt = np.nan_to_num(np.array([float(np.mean(points.temperature_c[group])) - T0_c for group, _ in usable]))
    room = int(np.argmin(np.abs(dt)))
    k_t = _k_of_temperature(dt, [line for _, line in usable], orders[0], warnings)
    u0, u0_standard, u0_dof, u0_t = _bias(dt, [line for _, line in usable], orders[2], warnings)
    room_group = usable[room][0]
    narrow = _slope(points, room_group, earth_rate_dps, K0_LIMIT_DPS) or usable[room][1]
    if narrow.limit > 1.01 * K0_LIMIT_DPS:
        warnings.append(
            f"K0 is a slope over rates up to {narrow.limit:.3g} °/s: there are too few below {K0_LIMIT_DPS:g} °/s."
        )
    warm = float(one_plus(k_t.coefficients, dt[[room]])[0])
    k0 = narrow.slope * warm
    offset = u0 + float(one_plus(u0_t, dt[[room]])[0]) - 1.0
    k_omega = _k_of_rate(points, room_group, k0 / warm, offset, earth_rate_dps, orders[1], warnings)
    return StageOne(
        line=StraightLine(K0_v_per_dps=narrow.slope, U0_v=narrow.bias, rate_limit_dps=narrow.limit),
        K0_v_per_dps=k0,
        K0_standard=narrow.slope_standard,
        K0_dof=narrow.dof,
        U0_v=u0,
        U0_standard=u0_standard,
        U0_dof=u0_dof,
        u0_t=u0_t,
        k_t=k_t,
        k_omega=k_omega,
        temperatures=tuple(
            TemperaturePoint(
                temperature_c=T0_c + float(shift),
                slope_v_per_dps=line.slope,
                slope_standard=line.slope_standard,
                bias_v=line.bias,
                bias_standard=line.bias_standard,
                rates=group.size,
                rate_limit_dps=line.limit,
            )
            for shift, (group, line) in zip(dt, usable, strict=True)
        ),
        warnings=tuple(warnings),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Line:
    """A straight line through the slow points of one temperature; `dof` is 0 if the uncertainties are not known."""

    slope: float
    slope_standard: float
    bias: float
    bias_standard: float
    dof: int
    limit: float


def line_in_motion(rows: Rows, earth_rate_dps: float) -> StageOne:
    """Replace stage 1 if there are no constant rates: a line through the runs in motion, without terms.

    The line is over |ω| ≤ 40 °/s if the motion includes that range. The acceleration is a second regressor, so that a
    delay does not change the slope.
    """
    slow = np.abs(rows.rate_dps) <= max(K0_LIMIT_DPS, 0.25 * float(np.max(np.abs(rows.rate_dps))))
    rate = rows.true_rate(0.0)[slow] + earth_rate_dps
    fit = fit_linear(np.stack([np.ones(rate.size), rate, rows.acceleration_dps2[slow]], axis=1), rows.output_v[slow])
    standard = np.sqrt(np.diag(fit.covariance))
    none = _factor_of((), np.empty(0), np.empty((0, 0)), fit.dof)
    offset, gain = float(fit.coefficients[0]), float(fit.coefficients[1])
    return StageOne(
        line=StraightLine(K0_v_per_dps=gain, U0_v=offset, rate_limit_dps=float(np.max(np.abs(rate)))),
        K0_v_per_dps=gain,
        K0_standard=float(standard[1]),
        K0_dof=fit.dof,
        U0_v=offset,
        U0_standard=float(standard[0]),
        U0_dof=fit.dof,
        u0_t=(),
        k_t=none,
        k_omega=none,
        temperatures=(),
        warnings=(
            "Stage 1 is a straight line through the runs in motion: the recording has no two constant rates at one "
            "temperature.",
        ),
    )


def _slope(points: MeanPoints, group: IntArray, earth: float, limit: float) -> _Line | None:
    """Return the line over |ω| ≤ limit, minus the drift between readings at rest; over at least the slowest two rates.

    None if all rates are equal.
    """
    rate = points.rate_dps[group]
    if np.ptp(rate) < 1.0:
        return None
    narrowest = next(reach for reach in np.sort(np.abs(rate)) if np.ptp(rate[np.abs(rate) <= reach]) >= 1.0)
    slow = np.abs(rate) <= 1.01 * max(limit, float(narrowest))
    output = points.output_v[group] - _drift(points, group)
    sensed = rate[slow] + earth
    columns = np.stack([np.ones(sensed.size), sensed], axis=1)
    fit = fit_linear(columns, output[slow])
    # The drift passes through every reading at rest, so all but one of them give no information on the scatter.
    at_rest = int(np.sum(np.abs(rate[slow]) < 0.5))
    freedom = sensed.size - 2 - max(at_rest - 1, 0)
    standard = np.full(2, np.nan)
    if freedom > 0:
        wider = np.sqrt((sensed.size - 2) / freedom)
        standard = wider * np.sqrt(np.diag(fit.covariance)) * _share_of_scatter(columns, output[slow], fit.residual)
    return _Line(
        slope=float(fit.coefficients[1]),
        slope_standard=float(standard[1]),
        bias=float(fit.coefficients[0]),
        bias_standard=float(standard[0]),
        dof=max(freedom, 0),
        limit=float(np.max(np.abs(rate[slow]))),
    )


def _share_of_scatter(columns: FloatArray, output: FloatArray, residual: FloatArray) -> float:
    """Return the share of a line's misfit that a cubic leaves, too; the law's curvature does not count as scatter."""
    rates = np.unique(np.round(columns[:, 1], 1)).size
    freedom = output.size - 3
    if rates < 5 or freedom < 1:
        return 1.0
    bent = fit_linear(np.column_stack([columns, columns[:, 1] ** 3]), output).residual
    line = float(residual @ residual) / (freedom + 1)
    return min(1.0, float(np.sqrt(bent @ bent / freedom / line))) if line > 0.0 else 1.0


def _drift(points: MeanPoints, group: IntArray) -> FloatArray:
    """Return the drift of the bias at each point, V: interpolated between the readings at rest, 0 on average."""
    rest = group[np.abs(points.rate_dps[group]) < 0.5]
    if rest.size < 2:
        return np.zeros(group.size)
    zeros = points.output_v[rest]
    return np.asarray(np.interp(points.time_s[group], points.time_s[rest], zeros) - zeros.mean())


def _powers(order: int) -> tuple[str, ...]:
    return tuple("ΔT" if i == 1 else f"ΔT^{i}" for i in range(1, order + 1))


def _k_of_temperature(dt: FloatArray, lines: list[_Line], order: int, warnings: list[str]) -> PolynomialFactor:
    """Return k(T) from the reciprocal slopes, 1 at T0."""
    order = _supported(dt, order, "k(T)", warnings)
    columns, reciprocal = dt[:, None] ** np.arange(order + 1), np.array([1.0 / line.slope for line in lines])
    fit = fit_linear(columns, reciprocal)
    centre, covariance, dof = fit.coefficients[0], fit.covariance, fit.dof
    if dof == 0:
        # The curve passes through every temperature: its uncertainty is that of each slope.
        weights = np.linalg.inv(columns) * (reciprocal**2 * np.array([line.slope_standard for line in lines]))
        covariance, dof = weights @ weights.T, min(line.dof for line in lines)
    # c_i = a_i/a_0, to first order in the errors
    change = np.concatenate([-fit.coefficients[1:, None] / centre**2, np.eye(order) / centre], axis=1)
    return _factor_of(_powers(order), fit.coefficients[1:] / centre, change @ covariance @ change.T, dof)


def _bias(
    dt: FloatArray, lines: list[_Line], order: int, warnings: list[str]
) -> tuple[float, float, int, tuple[float, ...]]:
    """Return the bias at T0, its standard uncertainty with its degrees of freedom, and its coefficients over ΔT."""
    order = _supported(dt, order, "U0(T)", warnings)
    fit = fit_linear(dt[:, None] ** np.arange(order + 1), np.array([line.bias for line in lines]))
    room = lines[int(np.argmin(np.abs(dt)))]
    standard, dof = (float(np.sqrt(fit.covariance[0, 0])), fit.dof) if fit.dof else (room.bias_standard, room.dof)
    return float(fit.coefficients[0]), standard, dof, tuple(map(float, fit.coefficients[1:]))


def _supported(dt: FloatArray, order: int, what: str, warnings: list[str]) -> int:
    """Return the order that the number of temperatures supports; add a warning if it is less than requested."""
    possible = min(order, dt.size - 1)
    if possible < order:
        temperatures = "one temperature" if dt.size == 1 else f"{dt.size} temperatures"
        left = "is left out" if possible == 0 else f"has {possible} term{'s' * (possible > 1)} instead of {order}"
        warnings.append(f"{what} {left}: the recording has constant rates at {temperatures} only.")
    return possible


def _k_of_rate(
    points: MeanPoints,
    group: IntArray,
    gain: float,
    offset: float,
    earth: float,
    order: int,
    warnings: list[str],
) -> PolynomialFactor:
    """Return k(ω) by least squares of ω − x·(1 + b2x² + b4x⁴), in rates so that slow points do not weigh too much."""
    rate = points.rate_dps[group] + earth
    x = (points.output_v[group] - _drift(points, group) - offset) / gain
    fast = np.unique(np.round(np.abs(rate[np.abs(rate) > SLOPE_LIMIT_DPS]), 0)).size
    if np.max(np.abs(rate)) < _CURVED_FROM_DPS or fast == 0:
        warnings.append(
            f"k(ω) is left out: no constant rate beyond {_CURVED_FROM_DPS:g} °/s at T0, where curvature would show."
        )
        order = 0
    elif fast < order:
        warnings.append(
            f"k(ω) has {fast} term{'s' * (fast > 1)} instead of {order}: too few rates beyond 50 °/s at T0."
        )
        order = fast
    if order == 0:
        return _factor_of((), np.empty(0), np.empty((0, 0)), 0)
    fit: LinearFit = fit_linear(x[:, None] ** (2 * np.arange(order) + 3), rate - x)
    return _factor_of(tuple(f"x^{2 * i + 2}" for i in range(order)), fit.coefficients, fit.covariance, fit.dof)


def _factor_of(basis: tuple[str, ...], coefficients: FloatArray, covariance: FloatArray, dof: int) -> PolynomialFactor:
    return PolynomialFactor(
        basis=basis,
        coefficients=tuple(map(float, coefficients)),
        covariance=tuple(tuple(map(float, row)) for row in covariance),
        dof=dof,
    )


_REST_DPS = 0.5
_APART_DPS = 1.0
_TERMS_IN_MOTION = 8


@dataclass(frozen=True, slots=True, kw_only=True)
class Carries:
    """`rate_terms`: terms in ω, in addition to scale factor and bias, that one temperature's rates identify.

    `scale_temperatures`: temperatures with two rates or a motion, which determine a scale factor; `bias_temperatures`:
    those that determine a bias, by the same or by rest.
    """

    rate_terms: int
    scale_temperatures: int
    bias_temperatures: int


def what_it_carries(steps: Sequence[ReducedStep]) -> Carries:
    """Count what these runs determine; a motion passes through as many rates as any law has terms."""
    rate_terms, scales, biases = 0, 0, 0
    for group in group_by_temperature(np.array([step.mean_temperature_c for step in steps])):
        own = [steps[i] for i in group]
        rates = np.array([float(np.mean(step.rate_dps)) for step in own if step.kind != "motion"])
        moving = rates.size < len(own)
        two_rates = rates.size > 0 and float(np.ptp(rates)) > _APART_DPS
        scales += moving or two_rates
        biases += moving or two_rates or bool(np.any(np.abs(rates) < _REST_DPS))
        if moving:
            rate_terms = _TERMS_IN_MOTION
        elif two_rates:
            signed = np.unique(np.round(rates))
            magnitudes = np.unique(np.abs(signed[signed != 0]))
            rate_terms = max(rate_terms, min(magnitudes.size - 1, signed.size - 2))
    return Carries(rate_terms=max(rate_terms, 0), scale_temperatures=scales, bias_temperatures=biases)
