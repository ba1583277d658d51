"""Stage 2 of the paper: fit the residual of stage 1 in motion, relative to the encoder's rate.

The residual ratio is fitted by k(T)·k(ω̂₁) of lower order *together with* K0, U0 and the delay: the polynomials alone
cannot reduce 3–4 % to 0.7 % (`benchctl paper`, point 5), so each one's share of the improvement is reported.

Rates at every level of compensation, from volts and temperature, are computed here as well.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import factorial

import numpy as np

from benchctl.calibration.model import AppliedLaw, Factors
from benchctl.calibration.result import BeforeAfter, PolynomialFactor, Share, Stage
from benchctl.calibration.rows import Rows
from benchctl.estimation.linear import clustered_covariance
from benchctl_instruments.arrays import FloatArray


def by_stages(stages: Sequence[Stage]) -> AppliedLaw:
    """Return the two-stage correction: the last stage's K0 and U0, then every stage's factors of that stage's input.

    It is used with temperatures above T0.
    """
    last = stages[-1]
    return AppliedLaw(
        name="polynomial",
        K0_v_per_dps=last.K0_v_per_dps,
        U0_v=last.U0_v,
        T0_c=0.0,
        bias=last.u0_t,
        stages=tuple(Factors(k_t=one.k_t.coefficients, k_omega=one.k_omega.coefficients) for one in stages),
        delay_s=last.delay_s,
    )


def mean_rate(law: AppliedLaw, rows: Rows) -> FloatArray:
    """Return the mean of the compensated rate over each block, °/s, including the law's curvature within the block."""
    nudge = np.maximum(1e-5, 1e-4 * np.abs(rows.output_v))
    up, down = law.sensed_dps(rows.output_v + nudge, rows.dt_c), law.sensed_dps(rows.output_v - nudge, rows.dt_c)
    slope = (up - down) / (2 * nudge)
    spread_v = rows.spread_dps / np.where(slope == 0.0, np.inf, slope)
    high, low = law.sensed_dps(rows.output_v + spread_v, rows.dt_c), law.sensed_dps(rows.output_v - spread_v, rows.dt_c)
    return np.asarray(0.5 * (high + low))


_TURNS = 12
_CURVED_FROM_DPS = 60.0
_NOT_MEASURED = BeforeAfter(before=None, after=None)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Layout:
    """The place of each part in the vector of parameters: K0 (relative), U0, delay, then k(T) and k(ω)."""

    temperature_terms: int
    rate_terms: int

    @property
    def parts(self) -> dict[str, list[int]]:
        start = 3 + self.temperature_terms
        parts = {
            "K0": [0],
            "U0": [1],
            "delay": [2],
            "k(T)": list(range(3, start)),
            "k(ω)": list(range(start, start + self.rate_terms)),
        }
        return {name: places for name, places in parts.items() if places}

    @property
    def nudges(self) -> FloatArray:
        """Steps for the derivatives, each equivalent to about 0.01 °/s."""
        temperature = [1e-4 * 30.0**-i for i in range(1, self.temperature_terms + 1)]
        rate = [1e-4 * 100.0 ** -(2 * i) for i in range(1, self.rate_terms + 1)]
        return np.array([1e-4, 1e-6, 1e-6, *temperature, *rate])


def stage_two(first: Stage, rows: Rows, earth_rate_dps: float, orders: tuple[int, int] = (1, 1)) -> Stage:
    """Fit stage 2 to the blocks of the runs in motion; `orders` of k(T) and k(ω), lower if not supported."""
    temperatures = rows.means(rows.dt_c)
    distinct = 1 + int(np.sum(np.diff(np.sort(temperatures)) > 2.0))
    fast = float(np.max(np.abs(rows.rate_dps))) >= _CURVED_FROM_DPS
    layout = _Layout(temperature_terms=min(orders[0], distinct - 1), rate_terms=orders[1] if fast else 0)
    parameters = np.zeros(layout.nudges.size)
    parameters[1] = first.U0_v
    before = mean_rate(by_stages((first,)), rows) - rows.true_rate(0.0) - earth_rate_dps
    parameters[2] = rows.likely_delay_s
    for _ in range(_TURNS):
        residual, slopes = _residual_and_slopes(first, layout, parameters, rows, earth_rate_dps)
        change = _solve(slopes, residual)
        parameters = parameters - change
        if np.all(np.abs(change) <= 1e-3 * layout.nudges):
            break
    covariance, dof = clustered_covariance(slopes, residual, rows.step)
    standard = np.sqrt(np.diag(covariance))
    stage = _stage(first, layout, parameters, covariance, dof)
    return replace(
        stage,
        standard={
            "K0_v_per_dps": abs(first.K0_v_per_dps) * float(standard[0]),
            "U0_v": float(standard[1]),
            "delay_s": float(standard[2]),
        },
        dof=dict(zip(("K0_v_per_dps", "U0_v", "delay_s"), dof.tolist(), strict=False)),
        shares=_shares(_secant(slopes, rows, stage.delay_s), before, layout.parts),
        runs=rows.steps,
    )


def _stage(
    first: Stage,
    layout: _Layout,
    parameters: FloatArray,
    covariance: FloatArray | None = None,
    dof: FloatArray | None = None,
) -> Stage:
    """Return the stage with these parameters; a polynomial has the fewest degrees of freedom of its coefficients."""
    parts = layout.parts

    def polynomial(name: str, basis: Sequence[str]) -> PolynomialFactor:
        places = parts.get(name, [])
        block = np.zeros((len(places),) * 2) if covariance is None else covariance[np.ix_(places, places)]
        return PolynomialFactor(
            basis=tuple(basis),
            coefficients=tuple(float(parameters[i]) for i in places),
            covariance=tuple(tuple(map(float, row)) for row in block),
            dof=math.inf if dof is None else float(dof[places or slice(None)].min()),
        )

    return Stage(
        name="stage 2",
        k_t=polynomial("k(T)", ["ΔT" if i == 0 else f"ΔT^{i + 1}" for i in range(layout.temperature_terms)]),
        k_omega=polynomial("k(ω)", [f"x^{2 * i + 2}" for i in range(layout.rate_terms)]),
        K0_v_per_dps=first.K0_v_per_dps * (1 + float(parameters[0])),
        U0_v=float(parameters[1]),
        u0_t=first.u0_t,
        delay_s=float(parameters[2]),
        error_percent=_NOT_MEASURED,
        rms_percent=_NOT_MEASURED,
    )


def _residual_and_slopes(
    first: Stage, layout: _Layout, parameters: FloatArray, rows: Rows, earth: float
) -> tuple[FloatArray, FloatArray]:
    """Return compensated minus true rate of each block (n,), and its derivatives (n, p)."""

    def residual(at: FloatArray) -> FloatArray:
        stage = _stage(first, layout, at)
        return mean_rate(by_stages((first, stage)), rows) - rows.true_rate(stage.delay_s) - earth

    slopes = np.empty((rows.step.size, parameters.size))
    for i, nudge in enumerate(layout.nudges):
        step = np.zeros(parameters.size)
        step[i] = nudge
        slopes[:, i] = (residual(parameters + step) - residual(parameters - step)) / (2 * nudge)
    return residual(parameters), slopes


def _secant(slopes: FloatArray, rows: Rows, delay_s: float) -> FloatArray:
    """Return the slopes, that of the delay as a secant from zero to the fitted delay."""
    if delay_s == 0.0:
        return slopes
    full = slopes.copy()
    full[:, 2] = (rows.true_rate(0.0) - rows.true_rate(delay_s)) / delay_s
    return full


def _solve(slopes: FloatArray, residual: FloatArray) -> FloatArray:
    scale = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
    return np.asarray(np.linalg.lstsq(slopes / scale, residual, rcond=1e-10)[0] / scale)


def _shares(slopes: FloatArray, residual: FloatArray, parts: dict[str, list[int]]) -> tuple[Share, ...]:
    """Return Shapley shares of the drop in squared residuals, linearised (Lindeman, Merenda, Gold 1980)."""
    scale = np.maximum(np.linalg.norm(slopes, axis=0), 1e-300)
    gram = (slopes / scale).T @ (slopes / scale)
    moment = (slopes / scale).T @ residual

    def drop(names: tuple[str, ...]) -> float:
        places = [place for name in names for place in parts[name]]
        if not places:
            return 0.0
        inside = np.ix_(places, places)
        return float(moment[places] @ np.linalg.lstsq(gram[inside], moment[places], rcond=1e-12)[0])

    names = tuple(parts)
    total = max(drop(names), 1e-300)
    shares = []
    for name in names:
        others = [other for other in names if other != name]
        share = 0.0
        for size in range(len(others) + 1):
            weight = factorial(size) * factorial(len(names) - size - 1) / factorial(len(names))
            for before in combinations(others, size):
                share += weight * (drop((*before, name)) - drop(before))
        shares.append(Share(part=name, share=share / total, alone=drop((name,)) / total))
    return tuple(shares)
