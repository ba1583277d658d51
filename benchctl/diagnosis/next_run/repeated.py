"""The next experiment if no two known effects must be separated: for unknown structures and for a wandering bias."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from benchctl.bench import Bench
from benchctl.campaign.check import bench_time_s
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.next_run.candidates import LONGEST_H, called, candidates, shown_bench, two_digits
from benchctl.diagnosis.next_run.planned import planned
from benchctl.diagnosis.result import NextExperiment
from benchctl_instruments.arrays import FloatArray

_MOVED_BY = {
    "output": "rate",
    "rate_sign": "rate",
    "frequency": "acceleration",
    "step": "time",
    "setpoint": "gyro_temp_rate",
}
"""Coordinates that are unknown before a run or have no spread, and the coordinates used in their place."""

_VERY_MUCH = 1000.0
"""Ratio beyond which a larger number means no more: the recording hardly varies it at all."""


def repeat_along(problem: GyroProblem, coordinates: Sequence[str], *, bench: Bench | None = None) -> NextExperiment:
    """Return the run that varies the coordinate of an unknown structure most per hour.

    The measure is Σ(x − mean)² over the samples, which is proportional to the information on a linear dependence on x.
    Of several coordinates that the recording does not separate, the part of the first that is independent of the others
    is used.
    """
    if not coordinates:
        return NextExperiment(
            says="The unexplained part follows no single coordinate: repeat the recording; what repeats is of the unit."
        )
    meant = coordinates[0]
    target = bench or shown_bench(problem)
    others = coordinates[1:]
    now = _spread(problem.coordinates, meant, problem.usable.astype(np.float64), others)
    best = None
    for given, plan in candidates(target):
        hours = bench_time_s(plan, target) / 3600.0
        if hours > LONGEST_H:
            continue
        rows = planned(plan, target, tuple(problem.frame.auxiliary))
        there = replace(problem, frame=rows.frame, band=None)
        power = _spread(there.coordinates, meant, rows.stands_for, others)
        if best is None or power / hours > best[0] / best[2]:
            best = power, (given, plan), hours
    if best is None or best[0] <= 0.0:
        return NextExperiment(says=f"No installed procedure within the bench's limits moves {meant}.")
    power, (given, plan), hours = best
    more = power / now if now > 0.0 else 0.0
    often = two_digits(more) if more < _VERY_MUCH else f"more than {_VERY_MUCH:g}"
    much = f" and varies it {often} times as much as this recording" if more > 1.0 else ""
    apart = f" apart from {' and '.join(others)}" if others else ""
    return NextExperiment(
        says=f"The unexplained part depends on {meant}. Run {called(given, plan)}, which varies {meant}{apart} most per"
        f" hour; it takes {two_digits(hours)} h of bench time{much}.",
        procedure=plan.procedure,
        separates=tuple(coordinates) if others else (),
        parameters=given,
    )


def rest_longer(problem: GyroProblem, names: Sequence[str], *, bench: Bench | None = None) -> NextExperiment:
    """Return the run that distinguishes kinds of bias wander: the longest rest available."""
    target = bench or shown_bench(problem)
    rests = [(given, plan) for given, plan in candidates(target) if plan.procedure == "static" and given]
    if not rests:
        return NextExperiment(
            says=f"A long rest would separate {' from '.join(names)}; no procedure for one is installed.",
            separates=tuple(names),
        )
    given, plan = rests[0]
    return NextExperiment(
        says=f"Run {called(given, plan)}: only hours at rest separate {' from '.join(names)}.",
        procedure=plan.procedure,
        separates=tuple(names),
        parameters=given,
    )


def _spread(known: Mapping[str, FloatArray], coordinate: str, samples: FloatArray, others: Sequence[str] = ()) -> float:
    """Return Σ(x − mean)² over samples; for an angle, of its unit vector; for two coordinates, of their product.

    The part that is linear in the coordinates `others` is removed.
    """
    product = np.ones(samples.size)
    for name in coordinate.split("*"):
        values = known[_MOVED_BY.get(name, name)]
        if name == "angle":
            turned = np.exp(1j * np.radians(values))
            product = product * np.abs(turned - np.average(turned, weights=samples))
        else:
            product = product * (values - np.average(values, weights=samples))
    if not np.isfinite(product).all():
        return 0.0
    for name in others if "angle" not in coordinate else ():
        along = known.get(_MOVED_BY.get(name, name))
        if along is not None and np.isfinite(along).all():
            along = along - np.average(along, weights=samples)
            product = product - float(samples @ (product * along)) / max(float(samples @ along**2), 1e-300) * along
    return float(samples @ np.abs(product) ** 2)
