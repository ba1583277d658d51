"""The one number: how much of the rate is still wrong, defined here and nowhere else.

`error_percent` of a run is the largest residual rate over the largest rate of the run, in percent; `rms_percent` the
root mean square over the same. The residual rate is compensated minus true, both averaged over the same blocks (at most
40 ms in motion), the true rate taken from the encoder at the delay of the level. Of a recording they are the largest
over the runs that were kept aside: no fit has seen them. Runs at rest have no rate to be compared with and are left
out.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchctl.calibration.compensation import Compensator, mean_rate
from benchctl.calibration.reduce import ReducedStep
from benchctl.calibration.result import Residuals, RunErrors
from benchctl.calibration.rows import gather

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Level:
    """A level of compensation: how it turns volts into a rate, and its delay, s."""

    compensate: Compensator
    delay_s: float


def percent(residual_dps: FloatArray, rate_dps: FloatArray) -> tuple[float, float]:
    """`error_percent` and `rms_percent` of one run; NaN residuals (beyond the law's reach) count as 100 %."""
    peak = float(np.max(np.abs(rate_dps)))
    residual = np.where(np.isfinite(residual_dps), residual_dps, peak)
    return 100 * float(np.max(np.abs(residual))) / peak, 100 * float(np.sqrt(np.mean(residual**2))) / peak


def measure(
    levels: Mapping[str, Level],
    steps: Sequence[ReducedStep],
    verify: frozenset[tuple[int, int]],
    T0_c: float,
    earth_rate_dps: float,
) -> tuple[Residuals, tuple[RunErrors, ...]]:
    """Residuals of every block and errors of every run, at every level; `verify` holds the keys of those kept aside."""
    rows = gather(steps, T0_c)
    residual = {
        name: mean_rate(level.compensate, rows) - rows.true_rate(level.delay_s) - earth_rate_dps
        for name, level in levels.items()
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
    """`error_percent` and `rms_percent` per level: the largest over the runs kept aside, empty where there are none."""
    aside = [run for run in runs if run.role == "verify"]
    if not aside:
        return {}, {}
    levels = aside[0].error_percent
    return (
        {name: max(run.error_percent[name] for run in aside) for name in levels},
        {name: max(run.rms_percent[name] for run in aside) for name in levels},
    )
