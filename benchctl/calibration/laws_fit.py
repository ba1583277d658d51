"""From reduced steps to the joint fits of the result: laws that the data support, starts, intervals."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchctl.calibration.joint import LIKELY_LAG_S, THERMAL_LAG, JointProblem, JointSolution, fit_joint, predict
from benchctl.calibration.model import Law
from benchctl.calibration.result import (
    CalibrationOptions,
    Contribution,
    FittedParameter,
    JointFit,
    LawName,
    Noise,
    StraightLine,
)
from benchctl.calibration.rows import gather
from benchctl.calibration.stage_one import Carries, what_it_carries
from benchctl.calibration.thermistor import ThermalHistory
from benchctl.calibration.uncertainty import LEVEL, coverage_factor, dof_of_factor, effective_dof, mixed
from benchctl.estimation.linear import fit_linear
from benchctl.recordings.model import BenchFacts
from benchctl.recordings.stated import Stated, StatedUncertainties
from benchctl.signals.reduce import ReducedStep
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.gyro import EARTH_DPS

_CURVED_FROM_DPS = 60.0
_SURE_OF_BEND = 10.0
_LEAST_BEND = 1e-3
_ENCODER_FROM_RUNS = 3
_LAGS_S = (600.0, 420.0, 300.0, 210.0, 150.0)
_LAGS_MIXED = 6
"""Number of lags from 0 to the largest that is not excluded, over which the fit is averaged."""
_LEAST_BEHIND_C = 1e-3
_SETTLED = 0.5
_EXCLUDED = 4.0
"""Increase of twice the negative log likelihood (two standard deviations) at which a lag is excluded."""
_SURE_OF_LAG = 2.0

UNITS = {
    "K0_v_per_dps": ("V/(°/s)", "scale factor at T0 and low rates"),
    "S_rad_per_dps": ("rad/(°/s)", "Sagnac phase per rate: the sine's argument"),
    "U0_v": ("V", "output at rest at T0, when the recording began"),
    "delay_s": ("s", "by how much the output follows the rate"),
    THERMAL_LAG: ("s", "time constant of the coil behind the thermistor"),
}


def fit_laws(
    steps: Sequence[ReducedStep],
    line: StraightLine,
    T0_c: float,
    earth_rate_dps: float,
    bench: BenchFacts,
    options: CalibrationOptions,
    known: StatedUncertainties,
    thermal: ThermalHistory,
) -> tuple[tuple[JointFit, ...], tuple[str, ...]]:
    """Return joint fits, the one that the data prefer first, and sentences on what could not be fitted.

    `known` are the uncertainties of the bench. If the gyro had not settled thermally, by its `thermal` history, the lag
    of its coil is a parameter (`thermal_lag_s`).
    """
    warnings: list[str] = []
    delay = _likely_delay(steps)
    carries = what_it_carries(steps)
    base = _problem(steps, carries, T0_c, earth_rate_dps, bench, options, warnings)
    bend, sure = _bend(steps, T0_c)
    rate_terms = _rate_terms(steps, carries, sure, options, warnings)
    curved = rate_terms > 0
    temperature_terms = base.law.temperature_terms
    if options.choose_orders and curved:
        temperature_terms, rate_terms, note = choose_orders(base, steps, _start(base, line, delay), temperature_terms)
        warnings.append(note)
    solved: list[tuple[JointProblem, JointSolution]] = []
    for name in _laws(options, curved, bend, warnings):
        terms = 1 if name == "sine" else rate_terms
        problem = replace(base, law=Law(name=name, rate_terms=terms, temperature_terms=temperature_terms))
        start = _start(problem, line, delay)
        if name == "sine":
            start[1] = np.sqrt(-6.0 * bend)
        try:
            solution = fit_joint(problem, steps, start)
        except UsageError as err:
            warnings.append(f"The law '{name}' is left out: {err}.")
            continue
        if not solution.converged:
            warnings.append(f"The joint fit by the law '{name}' has not settled: judge its numbers with care.")
        solved.append((problem, solution))
    if not solved:
        raise UsageError(f"calibration: no law could be fitted jointly: {warnings[-1]}")
    solved.sort(key=lambda pair: pair[1].bic)
    lag_s, fitted = _thermal_lag(*solved[0], steps, thermal)
    if fitted is not None:
        others = (_with_lag(*pair, steps, thermal, lag_s) for pair in solved[1:])
        solved = [fitted, *(pair for pair in others if pair is not None)]
        solved.sort(key=lambda pair: pair[1].bic)
        warnings.append(_unsettled(solved[0][1], steps, thermal))
    elif lag_s > 0.0:
        solved = [(pair[0], _over_lags(*pair, steps, thermal, lag_s)) for pair in solved]
        warnings.append(
            f"The gyro may not have settled thermally: that its coil lags its thermistor by up to {lag_s:.0f} s cannot "
            "be excluded. Values and uncertainties take such lags into account; a longer soak avoids it."
        )
    return tuple(_named(*pair, steps, bench, known) for pair in solved), tuple(warnings)


def _thermal_lag(
    problem: JointProblem, solution: JointSolution, steps: Sequence[ReducedStep], thermal: ThermalHistory
) -> tuple[float, tuple[JointProblem, JointSolution] | None]:
    """Return the largest lag, s, of the coil that the data allow, and the fit with it as a parameter if significant.

    0 if no plausible lag would move a parameter by more than half its standard uncertainty: the gyro had settled.
    """
    if problem.law.temperature_terms == 0 and problem.bias_terms == 0:
        return 0.0, None
    standard = np.sqrt(np.diag(solution.covariance))
    for lag_s in _LAGS_S:
        if _farthest_behind_c(steps, thermal, lag_s) < _LEAST_BEHIND_C:
            break
        lagging = _at_lag(problem, solution, steps, thermal, lag_s)
        if lagging is None:
            continue
        if np.all(np.abs(lagging.estimate - solution.estimate) <= _SETTLED * standard):
            break
        if lagging.bic < solution.bic + _EXCLUDED:
            fitted = _with_lag(problem, solution, steps, thermal, lag_s)
            return lag_s, fitted if fitted is not None and _is_sure(fitted[1]) else None
    return 0.0, None


def _farthest_behind_c(steps: Sequence[ReducedStep], thermal: ThermalHistory, lag_s: float) -> float:
    """Return the largest difference between coil and thermistor during the steps, °C."""
    return float(np.max(np.abs(thermal.behind(np.concatenate([step.time_s for step in steps]), lag_s))))


def _at_lag(
    problem: JointProblem,
    solution: JointSolution,
    steps: Sequence[ReducedStep],
    thermal: ThermalHistory,
    lag_s: float,
) -> JointSolution | None:
    """Fit again to the temperatures of a coil with this lag; None if the law cannot be fitted to them."""
    try:
        return fit_joint(problem, thermal.coils(steps, lag_s), solution.estimate)
    except UsageError:
        return None


def _with_lag(
    problem: JointProblem,
    solution: JointSolution,
    steps: Sequence[ReducedStep],
    thermal: ThermalHistory,
    lag_s: float,
) -> tuple[JointProblem, JointSolution] | None:
    """Fit again with the lag of the coil as a further parameter, starting at `lag_s`; None if that is impossible."""
    lagging = replace(problem, thermal=thermal)
    start = np.insert(solution.estimate, lagging.names.index(THERMAL_LAG), lag_s)
    try:
        return lagging, fit_joint(lagging, steps, start)
    except UsageError:
        return None


def _lag_of(solution: JointSolution) -> tuple[float, float]:
    """Return the fitted lag and its standard uncertainty, s."""
    place = solution.names.index(THERMAL_LAG)
    return float(solution.estimate[place]), float(np.sqrt(solution.covariance[place, place]))


def _is_sure(solution: JointSolution) -> bool:
    """Return whether a fitted lag is significant."""
    lag_s, standard_s = _lag_of(solution)
    return solution.converged and lag_s > _SURE_OF_LAG * standard_s


def _over_lags(
    problem: JointProblem,
    solution: JointSolution,
    steps: Sequence[ReducedStep],
    thermal: ThermalHistory,
    largest_s: float,
) -> JointSolution:
    """Return the solution as a mixture over lags from 0 to the largest, weighted by likelihood and typical lags."""
    likely, weights = [solution.mixture], [1.0]
    for lag_s in np.linspace(0.0, largest_s, _LAGS_MIXED)[1:]:
        lagging = _at_lag(problem, solution, steps, thermal, float(lag_s))
        if lagging is not None:
            likely.append(lagging.mixture)
            weights.append(math.exp(0.5 * (solution.bic - lagging.bic - (lag_s / LIKELY_LAG_S) ** 2)))
    return replace(solution, mixture=mixed(likely, weights))


def _unsettled(solution: JointSolution, steps: Sequence[ReducedStep], thermal: ThermalHistory) -> str:
    behind_c = _farthest_behind_c(steps, thermal, _lag_of(solution)[0])
    return (
        f"The gyro had not settled thermally: its coil was up to {behind_c:.2g} °C behind its thermistor while the "
        "fitted steps were recorded. Its lag is a parameter of the joint fit (thermal_lag_s) and widens the "
        "uncertainties; a longer soak avoids it."
    )


def only_free_motion(steps: Sequence[ReducedStep]) -> bool:
    """Return whether only motion of unknown band was recorded: no constant rate, no sine of a stated frequency."""
    return not any(step.kind == "constant_rate" or step.info.frequency_hz is not None for step in steps)


def _rate_terms(
    steps: Sequence[ReducedStep], carries: Carries, sure: bool, options: CalibrationOptions, warnings: list[str]
) -> int:
    """Return the number of terms in ω; 0, with a warning, if the runs do not determine them or show no bend."""
    if only_free_motion(steps):
        warnings.append(
            "No term in ω is fitted: free motion alone does not separate it from what the smoother removes."
        )
        return 0
    if carries.rate_terms == 0:
        warnings.append("No term in ω is fitted: no temperature has the two magnitudes of rate that would tell it.")
        return 0
    if max(step.peak_rate_dps for step in steps) >= _CURVED_FROM_DPS:
        return min(options.orders_1[1], carries.rate_terms)
    if sure:
        return min(options.orders_1[1], 1)
    warnings.append(f"No term in ω is fitted: no run reaches {_CURVED_FROM_DPS:g} °/s, and the slower show no bend.")
    return 0


def _laws(options: CalibrationOptions, curved: bool, bend: float, warnings: list[str]) -> tuple[LawName, ...]:
    """Return the laws to fit; a sine only if the output falls short of the line, as an interferometer's does."""
    if options.law in ("polynomial", "response"):
        return (options.law,)
    if not curved:
        return ("polynomial",)
    if bend < 0.0:
        return ("sine",) if options.law == "sine" else ("sine", "polynomial")
    warnings.append("The sine law is left out: the output does not fall short of a line at high rates.")
    return ("response", "polynomial")


def law_of(fit: JointFit) -> tuple[Law, FloatArray, float, tuple[float, ...]]:
    """Return a fit's law, the law's parameters, U0 and the coefficients of the bias."""
    names = [parameter.name for parameter in fit.parameters]
    law = Law(
        name=fit.law,
        rate_terms=1 if fit.law == "sine" else sum(name[0] == "b" for name in names),
        temperature_terms=sum(name[0] in "ga" for name in names),
    )
    own = np.array([fit.value(name) for name in law.names])
    bias = tuple(p.value for p in fit.parameters if p.name[0] == "c")
    return law, own, fit.value("U0_v"), bias


def _problem(
    steps: Sequence[ReducedStep],
    carries: Carries,
    T0_c: float,
    earth: float,
    bench: BenchFacts,
    options: CalibrationOptions,
    warnings: list[str],
) -> JointProblem:
    """Return the problem that the recording supports: terms in temperature need temperatures, a delay needs motion."""
    terms = min(options.orders_1[0], max(carries.scale_temperatures - 1, 0))
    if terms < options.orders_1[0]:
        warnings.append(
            f"The joint fit has {terms} term(s) in temperature: {carries.scale_temperatures} temperature(s) have two "
            "rates or a motion."
        )
    turned = sum(step.peak_rate_dps > 1.0 for step in steps)
    moving = any(step.kind == "motion" for step in steps)
    if not moving:
        warnings.append("No delay is fitted: the recording has no run in motion, only rest and constant rates.")
    return JointProblem(
        law=Law(name="response", rate_terms=0, temperature_terms=terms),
        bias_terms=min(options.bias_order, max(carries.bias_temperatures - 1, 0)),
        T0_c=T0_c,
        earth_rate_dps=earth,
        delay=moving,
        encoder=options.encoder_errors and turned >= _ENCODER_FROM_RUNS,
        encoder_accuracy_arcsec=bench.encoder_accuracy_arcsec,
        robust=options.robust,
    )


def _likely_delay(steps: Sequence[ReducedStep]) -> float:
    """Return the median of the delays estimated within the runs in motion."""
    delays = [step.delay_s for step in steps if step.kind == "motion"]
    return float(np.median(delays)) if delays else 0.0


def _start(problem: JointProblem, line: StraightLine, delay_s: float) -> FloatArray:
    start = np.zeros(len(problem.names))
    own = problem.law.start(line.K0_v_per_dps)
    start[: own.size] = own
    start[own.size] = line.U0_v
    if problem.delay:
        start[own.size + 1 + problem.bias_terms] = delay_s
    return start


def _bend(steps: Sequence[ReducedStep], T0_c: float) -> tuple[float, bool]:
    """Return b2 of the response, (°/s)⁻², by ordinary least squares, and whether it is clearly significant.

    It is −S²/6 for an interferometer, a start for its fit.
    """
    rows = gather([step for step in steps if step.kind != "static"], T0_c)
    rate, dt = rows.rate_dps, rows.dt_c
    columns = np.stack([np.ones(rate.size), rate, rate**3, dt, dt**2, dt * rate, dt**2 * rate], axis=1)
    fit = fit_linear(columns, rows.output_v)
    bend = float(fit.coefficients[2] / fit.coefficients[1])
    standard = float(np.sqrt(fit.covariance[2, 2])) / abs(float(fit.coefficients[1]))
    fastest = float(np.max(np.abs(rate)))
    return bend, abs(bend) > max(_SURE_OF_BEND * standard, _LEAST_BEND / fastest**2)


def _named(
    problem: JointProblem,
    solution: JointSolution,
    steps: Sequence[ReducedStep],
    bench: BenchFacts,
    known: StatedUncertainties,
) -> JointFit:
    """Return the solution as a record of the result, with intervals and budgets."""
    low, high = solution.mixture.interval(0.95, solution.freedom)
    half = np.max(np.abs(solution.mixture.interval(LEVEL, solution.freedom) - solution.estimate), axis=0)
    standard = np.sqrt(np.diag(solution.covariance))
    values = dict(zip(solution.names, map(float, solution.estimate), strict=True))
    parameters = []
    for i, name in enumerate(solution.names):
        unit, meaning = UNITS.get(name) or _unit_of(name, problem.law.name)
        type_a, own = float(standard[i]), float(half[i])
        dof_a = dof_of_factor(own / type_a)
        budget = contributions(name, values, type_a, dof_a, steps, bench, problem.earth_rate_dps, known)
        combined = math.hypot(*(part.standard for part in budget))
        dof = effective_dof((part.standard, part.dof) for part in budget)
        expanded = max(coverage_factor(dof) * combined, own)
        parameters.append(
            FittedParameter(
                name=name,
                value=values[name],
                unit=unit,
                standard=type_a,
                ci95=(float(low[i]), float(high[i])),
                says=meaning,
                expanded=expanded,
                k=expanded / combined,
                dof=dof,
                budget=budget,
            )
        )
    return JointFit(
        law=problem.law.name,
        convention=problem.law.convention,
        argument=problem.law.argument,
        parameters=tuple(parameters),
        covariance=solution.covariance,
        noise=Noise(
            white_v=solution.white_v,
            random_walk_v_per_sqrt_s=float(np.sqrt(solution.means_noise.walk)),
            mean_excess=solution.means_noise.excess,
        ),
        rows=solution.rows,
        bic=solution.bic,
    )


def _unit_of(name: str, law: str) -> tuple[str, str]:
    """Return unit and description of a coefficient."""
    if name.endswith("arcsec"):
        return "″", f"the encoder's error, {name.split('_')[1]}"
    power = int(name[1:])
    if name[0] == "b":
        return f"(°/s)^-{power}", f"k(ω), coefficient of {'x' if law == 'polynomial' else 'ω'}^{power}"
    if name[0] == "c":
        return f"V/°C^{power}", f"bias over temperature, coefficient of (T − T0)^{power}"
    return f"°C^-{power}", f"k(T), coefficient of (T − T0)^{power}"


MOST_RATE_TERMS = 3
FOLDS = 4


def choose_orders(
    base: JointProblem, steps: Sequence[ReducedStep], start: FloatArray, most_temperature_terms: int
) -> tuple[int, int, str]:
    """Choose the terms of k(T) and k(ω) of the polynomial law by cross-validation over complete runs; with the reason.

    Each candidate is fitted to three quarters of the moving runs and predicts the rest, four times; the smallest one
    with a squared error within one standard error of the best is chosen (Breiman's rule).
    """
    moving = [i for i, step in enumerate(steps) if step.kind != "static"]
    if len(moving) < 2 * FOLDS:
        return most_temperature_terms, 2, "Orders were not chosen: too few runs to keep a quarter aside."
    scores: dict[tuple[int, int], FloatArray] = {}
    for temperature_terms in range(most_temperature_terms + 1):
        for rate_terms in range(1, MOST_RATE_TERMS + 1):
            law = Law(name="polynomial", rate_terms=rate_terms, temperature_terms=temperature_terms)
            scores[temperature_terms, rate_terms] = _held_out(replace(base, law=law), steps, start, moving)
    totals = {orders: float(np.mean(score)) for orders, score in scores.items()}
    best = min(totals, key=lambda orders: totals[orders])
    if not np.isfinite(totals[best]):
        raise UsageError(
            "calibration: no order of the polynomials can be fitted to three quarters of the runs; "
            "record more rates and temperatures, or take the paper's orders"
        )
    margin = {
        orders: float(np.std(score - scores[best], ddof=1) / np.sqrt(score.size)) for orders, score in scores.items()
    }
    enough = [orders for orders in totals if totals[orders] <= totals[best] + margin[orders]]
    chosen = min(enough, key=lambda orders: (sum(orders), totals[orders]))
    return (
        *chosen,
        f"Orders chosen on runs left out: {chosen[0]} term(s) in temperature, {chosen[1]} in rate "
        f"(rms {1e3 * totals[chosen] ** 0.5:.3g} mV; the best, {best[0]} and {best[1]}: "
        f"{1e3 * totals[best] ** 0.5:.3g} mV).",
    )


def _held_out(
    problem: JointProblem, steps: Sequence[ReducedStep], base_start: FloatArray, moving: list[int]
) -> FloatArray:
    """Return the mean squared error of each moving run, V², when it was not fitted; shape (len(moving),)."""
    start = np.zeros(len(problem.names))
    start[0] = base_start[0]
    start[len(problem.law.names) :] = base_start[-(len(problem.names) - len(problem.law.names)) :]
    errors = np.full(len(moving), np.inf)
    for fold in range(FOLDS):
        aside = moving[fold::FOLDS]
        kept = [step for i, step in enumerate(steps) if i not in aside]
        try:
            solution = fit_joint(problem, kept, start)
        except UsageError:
            return errors  # this order is not monotonic inside the range: not a candidate
        rows = gather([steps[i] for i in aside], problem.T0_c)
        output, _ = predict(problem, solution.estimate, rows)
        residual = rows.output_v - output
        errors[fold::FOLDS] = rows.means(residual**2)
    return errors


_ARCSEC_PER_REV = 360.0 * 3600.0


def contributions(
    name: str,
    values: Mapping[str, float],
    standard: float,
    dof: float,
    steps: Sequence[ReducedStep],
    bench: BenchFacts,
    earth_rate_dps: float,
    known: StatedUncertainties,
) -> tuple[Contribution, ...]:
    """Return the uncertainty budget of one parameter of a joint fit: type A with its `dof`, then type B.

    Each is a standard uncertainty (k = 1) in the parameter's unit, after JCGM 100:2008 (GUM), 4.3 and 5.1. The bench's
    figures come from the recording's certificates; missing ones are assumed, as the contribution then states.
    """
    scatter = "scatter of the data, bias drift included"
    parts = [Contribution(source="type A", standard=standard, kind="A", says=scatter, dof=dof)]

    def add(source: str, amount: float, says: str) -> None:
        if amount > 0.0 and np.isfinite(amount):
            parts.append(Contribution(source=source, standard=float(amount), kind="B", says=says))

    gain = abs(values["K0_v_per_dps"])
    slope_t = values.get("g1", values.get("a1", 0.0))
    celsius, clock = known.thermometer_c.standard, known.clock_ppm.standard * 1e-6
    thermometer = f"thermistor known to {_described(known.thermometer_c, ' °C')}"
    time_base = f"clock known to {_described(known.clock_ppm, ' ppm')}"
    if name == "K0_v_per_dps":
        turns = max(sum(step.revolutions for step in steps), 1.0)
        angle = known.encoder_arcsec.standard / (_ARCSEC_PER_REV * turns)
        add("encoder", gain * angle, f"{_described(known.encoder_arcsec, '″')} over all turns")
        add("time base", gain * clock, time_base)
        add("ADC gain", gain * known.gain_ppm.standard * 1e-6, f"volts known to {_described(known.gain_ppm, ' ppm')}")
        add("thermometer", gain * abs(slope_t) * celsius, thermometer)
    elif name == "U0_v":
        add("ADC offset", known.offset_v.standard, known.offset_v.says)
        add("thermometer", abs(values.get("c1", 0.0)) * celsius, thermometer)
        add(*_earth(gain, bench, earth_rate_dps, known))
    elif name == "S_rad_per_dps":
        add("time base", abs(values[name]) * clock, time_base)
    elif name in ("g1", "a1", "c1"):
        second = {"g1": "g2", "a1": "a2", "c1": "c2"}[name]
        add("thermometer", 2 * abs(values.get(second, 0.0)) * celsius, thermometer)
    return tuple(parts)


def _earth(gain: float, bench: BenchFacts, earth_rate_dps: float, known: StatedUncertainties) -> tuple[str, float, str]:
    """Return the uncertainty of the Earth's rate along the axis; all of that rate if the latitude is not known."""
    if bench.latitude_deg is None:
        return "Earth's rate", gain * EARTH_DPS / np.sqrt(3.0), "latitude not known: its rate is part of U0"
    off_deg = np.hypot(known.latitude_deg.standard, known.tilt_deg.standard)
    slope = EARTH_DPS * np.cos(np.deg2rad(bench.latitude_deg)) * np.deg2rad(off_deg)
    return (
        "Earth's rate",
        gain * float(slope),
        f"{earth_rate_dps:.4f} °/s taken off; latitude to {_described(known.latitude_deg, '°')}, tilt to "
        f"{_described(known.tilt_deg, '°')}",
    )


def _described(figure: Stated, unit: str) -> str:
    """Return a standard uncertainty with its unit and its source, as text."""
    return f"{figure.standard:.3g}{unit} ({figure.says})"
