"""Calibrate: one pass over the steps, then the two stages, the joint fits and the errors on held-out runs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from threadpoolctl import threadpool_limits

from benchctl.calibration.coefficients import applied_of
from benchctl.calibration.discovered import NOT_TAKEN_OFF, Discovered
from benchctl.calibration.free_motion import FreeMotionFit, fit_free_motion_of
from benchctl.calibration.joint import THERMAL_LAG
from benchctl.calibration.laws_fit import fit_laws, only_free_motion
from benchctl.calibration.model import AppliedLaw
from benchctl.calibration.result import (
    BeforeAfter,
    CalibrationOptions,
    CalibrationResult,
    JointFit,
    MeanPoints,
    Residuals,
    RunErrors,
    SmootherFacts,
    Stage,
    StraightLine,
    ValidRange,
)
from benchctl.calibration.rows import gather
from benchctl.calibration.stage_one import StageOne, line_in_motion, mean_points, stage_one, what_it_carries
from benchctl.calibration.stage_two import by_stages, mean_rate, stage_two
from benchctl.calibration.thermistor import ThermalHistory
from benchctl.recordings.model import Meta, Step
from benchctl.recordings.stated import stated_of
from benchctl.recordings.stored import StoredStep, stored_of
from benchctl.signals.reduce import ReducedStep, reduce_steps
from benchctl.signals.segments import CHANNELS
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.gyro import earth_rate_dps

_MOVING_DPS = 2.0
_CONSTANT = 1e-9  # relative; a 24-bit converter resolves 6e-8
_HOLD_OUT_EVERY = 4
_ROOM_C = 20.0
_POLLED = "poll_gyro_temp_c"
_NOT_MEASURED = BeforeAfter(before=None, after=None)


def calibrate(
    steps: Iterable[Step | StoredStep], meta: Meta, options: CalibrationOptions | None = None
) -> CalibrationResult:
    """Calibrate a recording; its steps are read once and only block means are kept.

    Raises `UsageError` if nothing can be fitted: no usable step, no motion, or no two rates.
    """
    # With small matrices the threads of BLAS wait for each other: 28 s instead of 0.8 s on a busy machine.
    with threadpool_limits(limits=1, user_api="blas"):
        return _calibrate(steps, meta, options or CalibrationOptions())


def _calibrate(steps: Iterable[Step | StoredStep], meta: Meta, options: CalibrationOptions) -> CalibrationResult:
    warnings: list[str] = []
    notes: list[str] = []
    free: list[FreeMotionFit] = []
    polls: list[tuple[FloatArray, FloatArray]] = []
    looked_at = _looked_at(steps, meta, free, polls, warnings)
    reduced = sorted(reduce_steps(looked_at, meta), key=lambda step: step.info.t_start)
    if options.discovered:
        reduced = _without_structures(reduced, options.discovered)
        structures = options.discovered.structures.values()
        notes += [f"Subtracted from the output before the fit: {one.says()}" for one in structures]
        notes.append("Its uncertainty is in the diagnosis; the uncertainties here do not contain it.")
        warnings += [f"{name} is not taken off the output: {NOT_TAKEN_OFF}." for name in options.discovered.left]
    latitude = options.latitude_deg if options.latitude_deg is not None else meta.bench.latitude_deg
    bench = replace(meta.bench, latitude_deg=latitude)
    earth = 0.0 if latitude is None else earth_rate_dps(latitude)
    if latitude is None:
        warnings.append("The latitude is not known: the Earth's rate (up to 0.0042 °/s) is part of U0.")
    verify = _kept_aside(reduced, options, warnings, notes)
    fitted = [step for step in reduced if step.key not in verify]
    _demand_motion(fitted)
    T0_c = _reference_temperature(fitted, meta, options)
    thermal = ThermalHistory(polls, [(step.time_s, step.temperature_c) for step in reduced])
    points, first = _stage_one(reduced, verify, T0_c, earth, options)
    _demand_response(first.line, fitted)
    joint, fit_notes = fit_laws(fitted, first.line, T0_c, earth, bench, options, stated_of(meta), thermal)
    coils = reduced
    if (lag_s := next((p.value for p in joint[0].parameters if p.name == THERMAL_LAG), None)) is not None:
        # The stages are fitted to the coil's temperatures; the errors are those with the thermistor's temperatures.
        coils = thermal.coils(reduced, lag_s)
        points, first = _stage_one(coils, verify, T0_c, earth, options)
    moving = [step for step in coils if step.kind == "motion" and step.key not in verify]
    warnings.extend(first.warnings)
    line = AppliedLaw(name="polynomial", K0_v_per_dps=first.line.K0_v_per_dps, U0_v=first.line.U0_v, T0_c=T0_c)
    levels = {"raw": line}
    stages = [_first_stage(first)]
    levels["stage_1"] = by_stages(stages)
    free_only = only_free_motion(fitted)
    if moving:
        orders = (options.orders_2[0], 0 if free_only else options.orders_2[1])
        stages.append(stage_two(stages[0], gather(moving, T0_c), earth, orders))
        levels["stage_2"] = by_stages(stages)
    else:
        warnings.append("Stage 2 is left out: the recording has no run in motion (sine) to be fitted.")
    warnings.extend(fit_notes)
    for fit in joint:
        levels[f"joint_{fit.law}"] = applied_of({one.name: one.value for one in fit.parameters}, fit.law, T0_c)
    levels["joint"] = levels[f"joint_{joint[0].law}"]
    residuals, runs = measure(levels, reduced, verify, T0_c, earth)
    errors, rms = largest(runs)
    masked = sum(step.masked for step in reduced)
    if masked:
        warnings.append(
            f"{masked} clipped, filled-in or non-finite samples were left out, with the blocks that hold them."
        )
    unsettled = [step for step in reduced if step.unsettled]
    if unsettled:
        notes.append(f"{len(unsettled)} steps began with a spin-up, found by the encoder; it was left out.")
    temperatures = [step.mean_temperature_c for step in fitted]
    if not np.all(np.isfinite(temperatures)):
        warnings.append("No thermistor was recorded: every term in temperature is left out.")
    return CalibrationResult(
        unit=meta.unit.serial,
        range_dps=meta.unit.range_dps,
        output_unit=meta.output_unit,
        T0_c=T0_c,
        latitude_deg=latitude,
        earth_rate_dps=earth,
        raw=first.line,
        stages=_with_errors(stages, errors, rms),
        joint=tuple(_in_unit(fit, meta.output_unit) for fit in joint),
        error_percent=errors,
        rms_percent=rms,
        runs=runs,
        residuals=residuals,
        points=points,
        temperatures=first.temperatures,
        valid=ValidRange(
            rate_dps=(
                min(float(step.rate_dps.min()) for step in fitted),
                max(float(step.rate_dps.max()) for step in fitted),
            ),
            temperature_c=(float(np.min(temperatures)), float(np.max(temperatures))),
        ),
        smoother=_smoother(fitted, meta),
        free_motion=max(free, key=lambda fit: fit.clusters) if free else None,
        discovered=options.discovered,
        samples=sum(step.samples for step in reduced),
        samples_masked=masked,
        warnings=tuple(warnings),
        notes=tuple(notes),
    )


def _without_structures(steps: Sequence[ReducedStep], discovered: Discovered) -> list[ReducedStep]:
    if discovered.needs_temperature and not all(np.isfinite(step.temperature_c).all() for step in steps):
        raise UsageError(
            "a structure over the gyro's temperature cannot be taken off where no thermistor was recorded; "
            "fit without --model"
        )
    return [
        replace(step, output_v=discovered.taken_off(step.output_v, step.rate_dps, step.temperature_c)) for step in steps
    ]


def _stage_one(
    steps: Sequence[ReducedStep],
    verify: frozenset[tuple[int, int]],
    T0_c: float,
    earth: float,
    options: CalibrationOptions,
) -> tuple[MeanPoints, StageOne]:
    """Return the mean points and stage 1; a line through the runs in motion if there are no constant rates."""
    points = mean_points(steps, verify)
    moving = [step for step in steps if step.kind == "motion" and step.key not in verify]
    still = [step for step in steps if step.kind != "motion" and step.key not in verify]
    if moving and what_it_carries(still).scale_temperatures == 0:
        return points, line_in_motion(gather(moving, T0_c), earth)
    return points, stage_one(points, T0_c, earth, (*options.orders_1, options.bias_order))


def _in_unit(fit: JointFit, output_unit: str) -> JointFit:
    """Return the fit with units of the output: a digital gyro outputs rates, not volts."""
    if output_unit == "V":
        return fit
    unit = f"({output_unit})".replace("deg", "°")
    parameters = (
        replace(each, unit=unit + each.unit[1:] if each.unit.startswith("V") else each.unit) for each in fit.parameters
    )
    return replace(fit, parameters=tuple(parameters))


def _looked_at(
    steps: Iterable[Step | StoredStep],
    meta: Meta,
    free: list[FreeMotionFit],
    polls: list[tuple[FloatArray, FloatArray]],
    warnings: list[str],
) -> Iterator[Step | StoredStep]:
    """Yield the steps unchanged; on the way fit free motion in angle, and collect polls of the thermistor."""
    digital = meta.output_unit != "V"
    believed = 1.0 if digital else (meta.simulation or {}).get("K0_v_per_dps")
    for step in steps:
        stored = stored_of(step) if isinstance(step, Step) else step
        if _POLLED in stored.names:
            polls.append((stored.read("poll_time_s", 0, stored.polls), stored.read(_POLLED, 0, stored.polls)))
        if step.info.kind == "motion" and step.info.role == "fit":
            try:
                loaded = step if isinstance(step, Step) else step.part(0, step.scans, CHANNELS)
                free.append(fit_free_motion_of(loaded, believed))
            except UsageError as err:
                warnings.append(f"No fit in angle of '{step.info.name}': {err}.")
        yield step


def _demand_motion(steps: Sequence[ReducedStep]) -> None:
    """Raise `UsageError` if nothing can be fitted at all."""
    if not steps:
        raise UsageError(
            "calibration: the recording has no step that can be used for a fit (role fit; static, constant_rate or "
            "sine, settled, with encoder and output); look at it with `benchctl show`"
        )
    if max(step.peak_rate_dps for step in steps) < _MOVING_DPS:
        raise UsageError(
            f"calibration: no motion: the largest rate in {len(steps)} steps is "
            f"{max(step.peak_rate_dps for step in steps):.3g} deg/s, expected at least {_MOVING_DPS:g}; "
            "record a rate sweep"
        )


def _demand_response(line: StraightLine, steps: Sequence[ReducedStep]) -> None:
    """Raise `UsageError` if the output is the same at every rate, as for a gyro without power."""
    swing = abs(line.K0_v_per_dps) * max(step.peak_rate_dps for step in steps)
    if swing <= _CONSTANT * (swing + abs(line.U0_v)):
        raise UsageError(
            f"calibration: gyro_v is {line.U0_v:.6g} at every rate; check that the gyro is powered and that the right"
            " channel was recorded"
        )


def _kept_aside(
    steps: Sequence[ReducedStep], options: CalibrationOptions, warnings: list[str], notes: list[str]
) -> frozenset[tuple[int, int]]:
    """Return the keys of the held-out runs: those marked so, or else every fourth of the fast sines."""
    marked = frozenset(step.key for step in steps if step.info.role == "verify")
    turning = sum(step.key in marked and step.kind != "static" for step in steps)
    if turning:
        notes.append(f"{turning} runs were kept aside by the procedure; errors are measured on them alone.")
        return marked
    if marked:
        warnings.append("The runs kept aside are all at rest, so error_percent is not reported: they have no rate.")
        return marked
    sines = [step for step in steps if step.kind == "motion"]
    fast = [step for step in sines if step.peak_rate_dps > 0.5 * max(sine.peak_rate_dps for sine in sines)]
    if options.hold_out and len(fast) >= _HOLD_OUT_EVERY:
        aside = frozenset(step.key for step in fast[_HOLD_OUT_EVERY // 2 :: _HOLD_OUT_EVERY])
        notes.append(
            f"No run is marked for verification, so {len(aside)} of {len(fast)} fast runs in motion (every fourth) "
            "were kept aside by the calibration; errors are measured on them alone."
        )
        return aside
    warnings.append(
        "No runs were kept aside, so error_percent is not reported: measured on fitted runs it would flatter."
    )
    return frozenset()


def _reference_temperature(steps: Sequence[ReducedStep], meta: Meta, options: CalibrationOptions) -> float:
    """Return T0: as given, that of the lab, or the set point of the fastest constant rates, nearest to 20 °C."""
    stated = (meta.simulation or {}).get("T0_c")
    if options.T0_c is not None:
        return options.T0_c
    if isinstance(stated, int | float):
        return float(stated)
    turning = [step for step in steps if step.kind == "constant_rate"] or list(steps)
    fastest = max(turning, key=lambda step: (round(step.peak_rate_dps), -_from_room_c(step), -step.info.index))
    if np.isfinite(fastest.info.chamber_setpoint_c):
        return fastest.info.chamber_setpoint_c
    measured = fastest.mean_temperature_c
    return round(measured, 1) if np.isfinite(measured) else _ROOM_C


def _from_room_c(step: ReducedStep) -> float:
    """Return the distance of a step from room temperature, rounded to °C; 0 if set point and thermistor are unknown."""
    known = [c for c in (step.info.chamber_setpoint_c, step.mean_temperature_c) if np.isfinite(c)]
    return float(round(abs(known[0] - _ROOM_C))) if known else 0.0


def _first_stage(first: StageOne) -> Stage:
    """Convert stage 1 to a record of the result."""
    return Stage(
        name="stage 1",
        k_t=first.k_t,
        k_omega=first.k_omega,
        K0_v_per_dps=first.K0_v_per_dps,
        U0_v=first.U0_v,
        u0_t=first.u0_t,
        delay_s=0.0,
        standard={"K0_v_per_dps": first.K0_standard, "U0_v": first.U0_standard},
        dof={"K0_v_per_dps": first.K0_dof, "U0_v": first.U0_dof},
        error_percent=_NOT_MEASURED,
        rms_percent=_NOT_MEASURED,
        runs=len(first.temperatures),
    )


def _with_errors(stages: Sequence[Stage], errors: dict[str, float], rms: dict[str, float]) -> tuple[Stage, ...]:
    """Return the stages with the errors before and after each."""
    names = ("raw", "stage_1", "stage_2")
    return tuple(
        replace(
            stage,
            error_percent=BeforeAfter(before=errors.get(names[i]), after=errors.get(names[i + 1])),
            rms_percent=BeforeAfter(before=rms.get(names[i]), after=rms.get(names[i + 1])),
        )
        for i, stage in enumerate(stages)
    )


def _smoother(steps: Sequence[ReducedStep], meta: Meta) -> SmootherFacts | None:
    """Describe how the rate of the runs in motion was computed."""
    smoothers = [step.smoother for step in steps if step.kind == "motion"] or [step.smoother for step in steps]
    widest = max(smoothers, key=lambda smoother: smoother.window_s)
    worst = max(smoothers, key=lambda smoother: smoother.gain_error)
    counts = meta.bench.encoder_counts_per_rev
    noise = widest.noise_gain * 360.0 / counts / np.sqrt(12.0) if counts else float("nan")
    return SmootherFacts(
        window_s=widest.window_s,
        attenuation=worst.gain_error,
        rate_noise_dps=float(noise),
        says=(
            f"Rates are derivatives of local polynomials (order {widest.order}) over up to {1e3 * widest.window_s:.0f} "
            f"ms of angle; gain error at most {worst.gain_error:.1g} in the band of the motion."
        ),
    )


def percent(residual_dps: FloatArray, rate_dps: FloatArray) -> tuple[float, float]:
    """Return `error_percent` and `rms_percent` of one run; NaN residuals (beyond the law's reach) count as 100 %.

    `error_percent` is the largest residual rate over the largest rate of the run, `rms_percent` the root mean square
    over the same. The residual rate is compensated minus true, both averaged over the same blocks (at most 40 ms in
    motion), the true rate from the encoder at the delay of the level.
    """
    peak = float(np.max(np.abs(rate_dps)))
    residual = np.where(np.isfinite(residual_dps), residual_dps, peak)
    return 100 * float(np.max(np.abs(residual))) / peak, 100 * float(np.sqrt(np.mean(residual**2))) / peak


def measure(
    levels: Mapping[str, AppliedLaw],
    steps: Sequence[ReducedStep],
    verify: frozenset[tuple[int, int]],
    T0_c: float,
    earth_rate_dps: float,
) -> tuple[Residuals, tuple[RunErrors, ...]]:
    """Return residuals of every block and errors of every run, at every level; `verify` are the held-out steps' keys.

    Runs at rest have no rate for comparison and are left out.
    """
    rows = gather(steps, T0_c)
    residual = {
        name: mean_rate(level, rows) - rows.true_rate(level.delay_s) - earth_rate_dps for name, level in levels.items()
    }
    ends = [*rows.start[1:], rows.step.size]
    runs = []
    for i, step in enumerate(steps):
        if step.kind == "static":
            continue
        own = slice(int(rows.start[i]), int(ends[i]))
        errors = {name: percent(values[own], rows.rate_dps[own]) for name, values in residual.items()}
        runs.append(
            RunErrors(
                step=step.info.index,
                name=step.info.name,
                kind=step.info.kind,
                role="verify" if step.key in verify else "fit",
                temperature_c=step.mean_temperature_c,
                peak_rate_dps=step.peak_rate_dps,
                error_percent={name: error for name, (error, _) in errors.items()},
                rms_percent={name: rms for name, (_, rms) in errors.items()},
            )
        )
    indices = np.array([step.info.index for step in steps], dtype=np.int64)
    return (
        Residuals(
            step=indices[rows.step],
            verify=np.array([step.key in verify for step in steps], dtype=np.bool_)[rows.step],
            time_s=rows.time_s,
            rate_dps=rows.rate_dps,
            acceleration_dps2=rows.acceleration_dps2,
            temperature_c=np.concatenate([step.temperature_c for step in steps]),
            block_s=np.array([step.block_s for step in steps])[rows.step],
            residual_dps=residual,
        ),
        tuple(runs),
    )


def largest(runs: Sequence[RunErrors]) -> tuple[dict[str, float], dict[str, float]]:
    """Return `error_percent` and `rms_percent` per level: the largest over the held-out runs, empty without any."""
    aside = [run for run in runs if run.role == "verify"]
    if not aside:
        return {}, {}
    levels = aside[0].error_percent
    return (
        {name: max(run.error_percent[name] for run in aside) for name in levels},
        {name: max(run.rms_percent[name] for run in aside) for name in levels},
    )
