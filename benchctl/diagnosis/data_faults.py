"""Removal of data faults before the search: lost bits, rails, held samples, spikes, overload."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from benchctl.diagnosis.chamber.problem import ChamberProblem
from benchctl.diagnosis.drive.problem import DriveProblem
from benchctl.diagnosis.faults import Fault, faults_in, rail_of, spikes_in
from benchctl.diagnosis.findings.located import where_of
from benchctl.diagnosis.gyro.points import PointsProblem, without_overload
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.result import Finding, Where
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.fit import Point, fit
from benchctl.estimation.noise_model import NoiseModel
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray
from benchctl_instruments.physics.effects.registry import effect

_HASTIEST = 0.05
"""Share of the rows that count as sudden because of their acceleration."""


def without_data_faults(problem: PartProblem) -> tuple[PartProblem, tuple[Fault, ...]]:
    """Return the problem without its spoilt rows, and the faults that spoilt them.

    A gyro's faults are found if its samples are compared one by one; otherwise only its rails are. In static points an
    overload is found. A chamber's or drive's faults are found when the problem is built. Faults in `without` are
    neither reported nor removed.
    """
    if isinstance(problem, ChamberProblem | DriveProblem):
        return problem, problem.faults
    if isinstance(problem, PointsProblem):
        return without_overload(problem)
    if not isinstance(problem, GyroProblem):
        return problem, ()
    frame = problem.frame
    if problem.band is not None:
        return _behind_rails(problem, rail_of(frame.volts), problem.band.rows)
    shown = faults_in(
        volts=problem.measured,
        predicted=problem.predict(problem.baseline_start, ()),
        foretold=problem.usable,
        stretches=frame.stretches,
        interval_s=frame.interval_s,
        adc_step_v=problem.adc_step_v,
        limit_v=float(problem.simulation.get("output_limit_v") or np.inf),
    )
    masked = (
        shown.masked if not {one.effect for one in shown.found} & problem.without else _spoilt(problem, shown.found)
    )
    usable = problem.usable & ~masked
    everything = np.ones(len(problem.step_names), np.bool_)
    without = replace(problem, usable=usable)
    provisional = fit(without, NoiseModel.of(without).plain, Point(baseline=problem.baseline_start), everything)
    spikes = spikes_in(
        residual=provisional.residual,
        usable=problem.usable & ~shown.standing,
        step_v=shown.step_v,
        sudden=(frame.sudden > 0.0, _hasty(frame.acceleration_dps2)),
    )
    found = tuple(one for one in (*shown.found, *spikes.found) if one.effect not in problem.without)
    if "outliers" not in problem.without:
        usable &= ~spikes.masked
    return replace(problem, usable=usable, rows_per_value=shown.rows_per_value), found


def _behind_rails(problem: GyroProblem, rail: Fault | None, rows: IntArray) -> tuple[PartProblem, tuple[Fault, ...]]:
    """Return a problem of slow components with the rail found in its samples, which stays in every model.

    Each slow component is made of many samples; with vibration, some of them are at the rail nearly always.
    """
    if rail is None or rail.effect in problem.without:
        return problem, ()
    rail_effect = effect(rail.effect).make({name: value.value for name, value in rail.parameters.items()})
    return problem.behind(rail_effect, rail.rows), (rail.on_rows(rail.rows[rows]),)


def _hasty(acceleration_dps2: FloatArray) -> BoolArray:
    """Return the rows with the fastest rate changes; a kink of the response, such as a fold, passes in 1 or 2 rows."""
    size = np.abs(acceleration_dps2)
    return np.asarray(size > np.quantile(size, 1.0 - _HASTIEST))


def fault_findings(problem: PartProblem, faults: tuple[Fault, ...]) -> Iterator[Finding]:
    """Yield the faults as findings."""
    for one in faults:
        spoilt = one.rows.astype(np.float32)
        located = where_of(problem, spoilt, one.coordinate) if one.rows.any() else Where(coordinate=one.coordinate)
        yield Finding(
            effect=one.effect,
            probability=1.0,
            parameters=one.parameters,
            where=one.where or located,
            explains=float(one.rows.mean()),
            gain=one.gain,
            gain_heldout=0.0,
            says=one.says,
        )


def coarse_step_of(problem: PartProblem, faults: tuple[Fault, ...]) -> float:
    """Return the step [unit] of a converter that has lost bits, or 0 if it has lost none."""
    bits = next((one.parameters["bits_lost"].value for one in faults if one.effect == "adc_coarse"), None)
    return 0.0 if bits is None else problem.circumstances["adc_step_v"] * 2.0**bits


def _spoilt(problem: GyroProblem, found: tuple[Fault, ...]) -> BoolArray:
    kept = [one.rows for one in found if one.effect not in problem.without]
    return np.asarray(np.logical_or.reduce([np.zeros_like(problem.usable), *kept]))
