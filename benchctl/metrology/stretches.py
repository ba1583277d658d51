"""Split a recording into stretches: readings at rest and at constant rates at one temperature, turn-on and mounting.

A stretch ends with a soak, a ramp, a power cycle or a remounting. Swings inside it are skipped, and so is the rest
right after a power cycle, during which the unit warms up.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from benchctl.metrology.drift import white_variance
from benchctl.recordings.model import BY_HAND, BenchFacts, StepInfo
from benchctl.recordings.reader import Recording
from benchctl.signals.reduce import ReducedStep, reduced_steps
from benchctl.signals.step_reduction import QUIET_KINDS

BREAKS = ("soak", "thermal_ramp", *BY_HAND)
LEAST_V2 = 1e-22
"""Lower limit of the variance of a mean; an output whose noise is hidden by the converter's step has no scatter."""
_PIECES = 20
_SHORTEST_PIECE_S = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """Mean output at a constant rate or at rest, in time order.

    `rate_dps` is the encoder's mean over the same samples, `set_dps` the commanded rate. `white_v2` is the variance of
    `output_v` due to noise; `coarse_v` is its standard uncertainty due to the converter's steps, reduced by the
    dithering effect of the noise. Rest is cut into pieces of at least 10 s, each a reading.
    """

    step: int
    set_dps: float
    rate_dps: float
    output_v: float
    white_v2: float
    middle_s: float
    duration_s: float
    temperature_c: float
    coarse_v: float = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Stretch:
    """Consecutive readings in one state; `before_c` is the chamber's previous set point, NaN for the first stretch.

    `power_on` counts the earlier power cycles.
    """

    setpoint_c: float
    before_c: float
    power_on: int
    across: bool
    readings: tuple[Reading, ...] = ()

    @property
    def temperature_c(self) -> float:
        """Mean of the thermistor; the set point if there is no thermistor."""
        mean = float(np.mean([reading.temperature_c for reading in self.readings])) if self.readings else np.nan
        return mean if np.isfinite(mean) else self.setpoint_c


def stretches_of(recording: Recording) -> Iterator[Stretch]:
    """Yield all stretches with readings; incomplete steps are skipped. Several are reduced at a time, in parts."""
    current = Stretch(setpoint_c=np.nan, before_c=np.nan, power_on=0, across=False)
    wanted = [info.index for before, info in pairwise([None, *recording.infos]) if info and _is_read(before, info)]
    found = reduced_steps(map(recording.stored_step, wanted), recording.meta)
    for info in recording.infos:
        if info.kind in BREAKS:
            if current.readings:
                yield current
            current = _after(current, info)
        elif info.index in wanted:
            if not np.isfinite(current.setpoint_c):
                current = replace(current, setpoint_c=info.chamber_setpoint_c)
            reduced = next(found)
            if reduced is not None:
                current = replace(current, readings=(*current.readings, *_readings(reduced, recording.meta.bench)))
    if current.readings:
        yield current


def _is_read(before: StepInfo | None, info: StepInfo) -> bool:
    """Return whether a step gives readings of one axis: at rest or at a constant rate, complete, not warming up."""
    warms_up = before is not None and before.kind == "power_cycle" and info.kind == "static"
    return info.kind in QUIET_KINDS and info.whole and info.mounting in ("", "across") and not warms_up


def _after(before: Stretch, info: StepInfo) -> Stretch:
    moved = info.chamber_setpoint_c != before.setpoint_c
    return Stretch(
        setpoint_c=info.chamber_setpoint_c,
        before_c=before.setpoint_c if moved else before.before_c,
        power_on=before.power_on + (info.kind == "power_cycle"),
        across=info.name.startswith("mount across") if info.kind == "mount" else before.across,
    )


def _readings(reduced: ReducedStep, bench: BenchFacts) -> Iterator[Reading]:
    pieces = 1
    if reduced.kind == "static":
        pieces = max(1, min(_PIECES, int(reduced.duration_s / _SHORTEST_PIECE_S)))
    rate_dps = reduced.info.rate_dps if reduced.kind == "constant_rate" else 0.0
    white_v2 = max(white_variance(reduced.output_v), LEAST_V2)
    sample_v = math.sqrt(white_v2 * float(np.mean(reduced.count)))
    for part in np.array_split(np.arange(reduced.count.size), pieces):
        weights = reduced.count[part] / reduced.count[part].sum()
        yield Reading(
            step=reduced.info.index,
            set_dps=float(weights @ reduced.rate_dps[part]) if rate_dps is None else rate_dps,
            rate_dps=float(weights @ reduced.rate_dps[part]),
            output_v=float(weights @ reduced.output_v[part]),
            white_v2=white_v2 / part.size,
            middle_s=float(weights @ reduced.time_s[part]),
            duration_s=reduced.duration_s * part.size / reduced.count.size,
            temperature_c=float(np.mean(reduced.temperature_c[part])),
            coarse_v=_coarse_v(sample_v, bench.adc_step_v),
        )


def _coarse_v(sample_v: float, step_v: float) -> float:
    """Return the standard uncertainty of the mean of many noisy samples due to the converter's step.

    It is that of a uniform distribution over a step, times the factor by which noise attenuates the first harmonic of
    the rounding error, e^(−2π²σ²/step²) (Widrow and Kollár).
    """
    return step_v / math.sqrt(12.0) * math.exp(-2.0 * (math.pi * sample_v / step_v) ** 2) if step_v else 0.0


def residual_structure_of(recording: Recording) -> StepInfo | None:
    """Return the longest complete step at rest, except right after a power cycle; None if there is none."""
    infos = recording.infos
    warming = {after.index for on, after in pairwise(infos) if on.kind == "power_cycle"}
    resting = [one for one in infos if one.kind == "static" and one.whole and not one.mounting]
    settled = [one for one in resting if one.index not in warming]
    return max(settled, key=lambda info: info.t_end - info.t_start, default=None)
