"""Reduce every step of a recording in one pass to a few hundred block means, few enough for many fits.

A block is a short run of neighbouring samples. Of the gyro its mean output is kept, of the encoder the mean and the
variance of the rate, so that the mean of a curved law f is f̄ ≈ ½[f(ω̄+s) + f(ω̄−s)], s² the variance (exact to the third
moment). The rate applies to the time at which the gyro sensed it: a delay is estimated within each step in motion and
the rate is evaluated there; the mean acceleration and jerk allow a fit to correct the delay slightly. Blocks with
clipped, filled-in or non-finite samples are left out, and nothing is smoothed across a gap.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from benchctl.recordings.model import Meta, Step, StepInfo
from benchctl.recordings.stored import StoredStep, stored_of
from benchctl.side_by_side import cores, in_order
from benchctl.signals.rate import Smoother
from benchctl.signals.segments import CHANNELS
from benchctl.signals.step_reduction import QUIET_KINDS, Blocks, StepReduction
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

Made = TypeVar("Made")

FREE_PIECE_S = 60.0
"""A run in free motion is cut into pieces of about this length."""

UNUSED_KINDS = ("soak", "thermal_ramp", "unassigned", "static_points")
_SHORTEST = 32
_FEWEST_BLOCKS = 4
_MOST_AT_ONCE = 4
"""Maximum number of steps at once; each holds two parts of `SCANS_AT_ONCE` and as much in intermediate arrays."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReducedStep(Blocks):
    """A step as block means, arrays of shape (n,), oldest first.

    `kind` is `static`, `constant_rate` or `motion`. `rate_dps` is the table's rate at the gyro's stamps minus
    `delay_s`, `rate_at_stamp_dps` at the stamps; `rate_variance` is the variance of the rate within the block (°/s)².
    `encoder_basis`, shape (n, 4), is the excess rate per arc second of encoder error in sin θ, cos θ, sin 2θ, cos 2θ.
    `temperature_c` is a straight line through the thermistor's samples, NaN if there are none. `masked` samples were
    left out as clipped, filled in or not finite, `unsettled` samples as spin-up.
    """

    info: StepInfo
    kind: str
    block_s: float
    temperature_c: FloatArray
    delay_s: float
    duration_s: float
    revolutions: float
    smoother: Smoother
    masked: int
    unsettled: int
    piece: int = 0

    @property
    def key(self) -> tuple[int, int]:
        """Index of the step, and of its piece if a long run in free motion was cut into several."""
        return self.info.index, self.piece

    @property
    def samples(self) -> int:
        """Number of samples in the blocks."""
        return int(self.count.sum())

    @property
    def peak_rate_dps(self) -> float:
        """Largest mean rate of a block."""
        return float(np.max(np.abs(self.rate_dps)))

    @property
    def mean_temperature_c(self) -> float:
        """Mean of the thermistor, NaN if there is none."""
        return float(np.mean(self.temperature_c))


def reduce_steps(steps: Iterable[Step | StoredStep], meta: Meta) -> Iterator[ReducedStep]:
    """Reduce every step that a calibration can use, on all cores; soaks and thermal ramps are skipped.

    Raises `UsageError` if a step to be used lacks the encoder or the gyro's output.
    """
    usable = (step for step in steps if step.info.kind not in UNUSED_KINDS and step.info.role != "none")
    stored = (stored_of(step) if isinstance(step, Step) else step for step in usable)
    for reduced in _on_all_cores(partial(_reduced, meta=meta), stored):
        yield from reduced


def reduced_steps(steps: Iterable[StoredStep], meta: Meta) -> Iterator[ReducedStep | None]:
    """Apply `reduce_step` to each step, on all cores."""
    return _on_all_cores(partial(reduce_step, meta=meta), steps)


def _on_all_cores(work: Callable[[StoredStep], Made], steps: Iterable[StoredStep]) -> Iterator[Made]:
    return in_order(work, steps, min(cores(), _MOST_AT_ONCE))


def _reduced(step: StoredStep, meta: Meta) -> list[ReducedStep]:
    """Reduce a step, or the pieces into which it is cut."""
    pieces = (reduce_step(piece, meta) for piece in _pieces(step))
    return [replace(piece, piece=number) for number, piece in enumerate(pieces) if piece is not None]


def _pieces(step: StoredStep) -> Iterator[StoredStep]:
    """Split a long run in free motion, so that some parts can be held out and their scatter estimated."""
    info = step.info
    if info.kind in QUIET_KINDS or info.frequency_hz is not None or step.scans < 2:
        yield step
        return

    def stamp(scan: int) -> float:
        return float(step.read("time_s", scan, scan + 1)[0])

    number = max(1, int((stamp(step.scans - 1) - stamp(0)) / FREE_PIECE_S))
    edges = np.linspace(0, step.scans, number + 1).astype(np.int64)
    for start, stop in pairwise(map(int, edges)):
        yield step.cut(replace(info, t_start=stamp(start), t_end=stamp(stop - 1)), start, stop)


def reduce_step(step: Step | StoredStep, meta: Meta) -> ReducedStep | None:
    """Reduce one step, part by part; None if none of it is usable (too short, never settled, all clipped)."""
    stored = stored_of(step) if isinstance(step, Step) else step
    _demand_channels(stored)
    if stored.scans < _SHORTEST:
        return None
    reduction, taken = None, 0
    for part in stored.parts(CHANNELS):
        reduction = reduction or StepReduction(part, meta)
        taken += part["time_s"].size
        reduction.take(part, last=taken == stored.scans)
    if reduction is None or sum(one.count.size for one in reduction.blocks) < _FEWEST_BLOCKS:
        return None
    blocks = reduction.blocks

    joined: dict[str, Any] = {
        one.name: np.concatenate([getattr(block, one.name) for block in blocks]) for one in fields(Blocks)
    }
    info, count, stamps = stored.info, joined["count"], joined["time_s"]
    intercept, slope = reduction.temperature.fitted()
    return ReducedStep(
        **joined,
        info=info,
        kind=info.kind if info.kind in QUIET_KINDS else "motion",
        block_s=float(np.median(count)) * reduction.interval_s,
        temperature_c=intercept + slope * stamps,
        delay_s=reduction.delay_s or 0.0,
        duration_s=float(count.sum()) * reduction.interval_s,
        revolutions=_revolutions(blocks, reduction.interval_s),
        smoother=reduction.smoother,
        masked=reduction.masked,
        unsettled=reduction.unsettled,
    )


def _demand_channels(step: StoredStep) -> None:
    """Raise `UsageError` if a channel that a calibration requires is missing."""
    for channel in ("time_s", "encoder_deg", "gyro_v"):
        if channel not in step.names:
            raise UsageError(
                f"step {step.info.index} '{step.info.name}': a calibration needs the channel {channel}, the step has "
                f"{', '.join(sorted(step.names)) or 'none'}; import the recording with a map that names it"
            )


def _revolutions(blocks: list[Blocks], interval_s: float) -> float:
    """Return the revolutions turned within the blocks, in either sense."""
    return float(sum(np.sum(np.abs(one.rate_dps) * one.count) for one in blocks) * interval_s / 360.0)
