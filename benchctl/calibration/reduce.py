"""One pass over a recording: every step becomes a few hundred block means, small enough to be fitted many times.

A block is a short run of neighbouring samples; of the gyro its mean output is kept, of the encoder mean and variance of
the rate, so that the mean of a curved law f is f̄ ≈ ½[f(ω̄+s) + f(ω̄−s)], s² the variance (exact to the third moment).
The rate is given at the time when the gyro sensed it: a delay is estimated within each step in motion and the rate is
evaluated there; the mean acceleration and jerk let a fit move it by a small correction. Clipped, filled-in or
non-finite samples are left out with their block, and nothing is smoothed across a gap.

`Rows` are the block means of many steps as flat arrays: what fits work on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from itertools import pairwise
from typing import Any, TypeVar

import numpy as np

from benchctl.calibration.step_reduction import CHANNELS, QUIET_KINDS, Blocks, StepReduction
from benchctl.recordings.model import Meta, Step, StepInfo
from benchctl.recordings.stored import StoredStep, stored_of
from benchctl.side_by_side import cores, in_order
from benchctl.signals.rate import Smoother
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import UsageError

Made = TypeVar("Made")

FREE_PIECE_S = 60.0
"""Into pieces of about this length a run in free motion is cut."""

UNUSED_KINDS = ("soak", "thermal_ramp", "unassigned", "static_points")
_SHORTEST = 32
_FEWEST_BLOCKS = 4
_MOST_AT_ONCE = 4
"""Steps: each holds two parts of `SCANS_AT_ONCE`, and as much again in between."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ReducedStep(Blocks):
    """A step as block means, arrays of shape (n,), oldest first.

    `kind` is `static`, `constant_rate` or `motion`. `rate_dps` is the table's, at the gyro's stamps less `delay_s`,
    `rate_at_stamp_dps` at the stamps;
    `rate_variance` that within the block (°/s)²; `encoder_basis`, shape (n, 4): the rate that the encoder shows too
    much per arc second of its error in sin θ, cos θ, sin 2θ, cos 2θ. `temperature_c` is a straight line through the
    thermistor's samples, NaN where there are none. `masked` samples were left out as clipped, filled in or not finite,
    `unsettled` as spin-up.
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
        """Which step of the recording, and which piece of it where a long run in free motion was cut into several."""
        return self.info.index, self.piece

    @property
    def samples(self) -> int:
        """Samples behind the blocks."""
        return int(self.count.sum())

    @property
    def peak_rate_dps(self) -> float:
        """Largest rate of a block."""
        return float(np.max(np.abs(self.rate_dps)))

    @property
    def mean_temperature_c(self) -> float:
        """Mean of the thermistor, NaN where there is none."""
        return float(np.mean(self.temperature_c))


def reduce_steps(steps: Iterable[Step | StoredStep], meta: Meta) -> Iterator[ReducedStep]:
    """Reduce every step that a calibration can use, on all cores; soaks and thermal ramps are passed over.

    Raises `UsageError` where a step to be used lacks the encoder or the gyro's output.
    """
    usable = (step for step in steps if step.info.kind not in UNUSED_KINDS and step.info.role != "none")
    stored = (stored_of(step) if isinstance(step, Step) else step for step in usable)
    for reduced in _on_all_cores(partial(_reduced, meta=meta), stored):
        yield from reduced


def reduced_steps(steps: Iterable[StoredStep], meta: Meta) -> Iterator[ReducedStep | None]:
    """As `reduce_step`, of each, on all cores."""
    return _on_all_cores(partial(reduce_step, meta=meta), steps)


def _on_all_cores(work: Callable[[StoredStep], Made], steps: Iterable[StoredStep]) -> Iterator[Made]:
    return in_order(work, steps, min(cores(), _MOST_AT_ONCE))


def _reduced(step: StoredStep, meta: Meta) -> list[ReducedStep]:
    """A step, or the pieces that it is cut into."""
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
    """Reduce one step, part by part; None where nothing of it can be used (too short, never settled, all clipped)."""
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
    """Raise where a channel that a calibration cannot do without is missing."""
    for channel in ("time_s", "encoder_deg", "gyro_v"):
        if channel not in step.names:
            raise UsageError(
                f"step {step.info.index} '{step.info.name}': a calibration needs the channel {channel}, the step has "
                f"{', '.join(sorted(step.names)) or 'none'}; import the recording with a map that names it"
            )


def _revolutions(blocks: list[Blocks], interval_s: float) -> float:
    """Revolutions turned within the blocks, in either sense."""
    return float(sum(np.sum(np.abs(one.rate_dps) * one.count) for one in blocks) * interval_s / 360.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Rows:
    """Blocks of several steps one after the other; arrays of shape (n,), `encoder_basis` (n, 4).

    `step` counts the steps of these rows from 0 and `start`, shape (m,), is where each begins; `dt_c` is T − T0, 0
    where no thermistor was recorded. `expanded_at_s` is the delay at which each row's rate is given.
    """

    step: IntArray
    start: IntArray
    count: FloatArray
    time_s: FloatArray
    output_v: FloatArray
    rate_dps: FloatArray
    rate_at_stamp_dps: FloatArray
    spread_dps: FloatArray
    acceleration_dps2: FloatArray
    jerk_dps3: FloatArray
    dt_c: FloatArray
    encoder_basis: FloatArray
    expanded_at_s: FloatArray

    @property
    def steps(self) -> int:
        """How many steps these rows come from."""
        return int(self.start.size)

    def true_rate(self, delay_s: float) -> FloatArray:
        """The table's rate `delay_s` before each block, °/s, (n,); exact at 0, expanded about the steps' own delays.

        (An expansion about a coarse encoder's third derivative must not be carried far.)
        """
        if delay_s == 0.0:
            return self.rate_at_stamp_dps
        late = delay_s - self.expanded_at_s
        return self.rate_dps - late * self.acceleration_dps2 + 0.5 * late**2 * self.jerk_dps3

    @property
    def likely_delay_s(self) -> float:
        """Median of the delays about which the moving rows are expanded; 0 where nothing moves."""
        moving = self.acceleration_dps2 != 0.0
        return float(np.median(self.expanded_at_s[moving])) if moving.any() else 0.0

    def means(self, values: FloatArray) -> FloatArray:
        """Means over each step, weighted by the samples; (n,) or (n, p) to (m,) or (m, p)."""
        weight = self.count if values.ndim == 1 else self.count[:, None]
        total = np.add.reduceat(self.count, self.start)
        summed = np.add.reduceat(values * weight, self.start, axis=0)
        averaged: FloatArray = summed / (total if values.ndim == 1 else total[:, None])
        return averaged


def gather(steps: Sequence[ReducedStep], T0_c: float) -> Rows:
    """Lay the blocks of some steps, at least one, one after the other."""
    sizes = np.array([step.count.size for step in steps], dtype=np.int64)

    def column(name: str) -> FloatArray:
        return np.concatenate([getattr(step, name) for step in steps])

    return Rows(
        step=np.repeat(np.arange(len(steps), dtype=np.int64), sizes),
        start=np.concatenate([[0], np.cumsum(sizes)[:-1]]).astype(np.int64),
        count=column("count"),
        time_s=column("time_s"),
        output_v=column("output_v"),
        rate_dps=column("rate_dps"),
        rate_at_stamp_dps=column("rate_at_stamp_dps"),
        spread_dps=np.sqrt(column("rate_variance")),
        acceleration_dps2=column("acceleration_dps2"),
        jerk_dps3=column("jerk_dps3"),
        dt_c=np.nan_to_num(column("temperature_c") - T0_c),
        encoder_basis=column("encoder_basis"),
        expanded_at_s=np.repeat([step.delay_s for step in steps], sizes),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class LinearFit:
    """Coefficients (p,), their covariance (p, p), the residuals (n,) and the degrees of freedom."""

    coefficients: FloatArray
    covariance: FloatArray
    residual: FloatArray
    dof: int


def fit_linear(columns: FloatArray, values: FloatArray) -> LinearFit:
    """Minimise Σ (values − columns·c)²; columns (n, p). With as many values as coefficients the variance is NaN."""
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    basis, triangle = np.linalg.qr(columns / scale)
    inverse = np.linalg.pinv(triangle)
    coefficients = inverse @ (basis.T @ values) / scale
    residual = values - columns @ coefficients
    freedom = values.size - columns.shape[1]
    variance = float(residual @ residual) / freedom if freedom > 0 else np.nan
    covariance = variance * (inverse @ inverse.T) / scale[:, None] / scale
    return LinearFit(coefficients=coefficients, covariance=covariance, residual=residual, dof=freedom)


def clustered_covariance(columns: FloatArray, residual: FloatArray, cluster: IntArray) -> tuple[FloatArray, int]:
    """Covariance (p, p) of unweighted coefficients where residuals of one cluster (a step) hang together, and its dof.

    Liang and Zeger, Biometrika 73 (1986) 13, with the usual correction for the number of clusters. With fewer than
    twice as many clusters as coefficients the plain covariance, times the blocks of a cluster, is used: an upper
    bound.
    """
    p = columns.shape[1]
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    scaled = columns / scale
    bread = np.linalg.pinv(scaled.T @ scaled)
    names = np.unique(cluster)
    if names.size < 2 * p:
        size = columns.shape[0] / names.size
        covariance, dof = bread * float(residual @ residual) / max(residual.size - p, 1) * size, names.size
    else:
        scores = np.stack([scaled[cluster == name].T @ residual[cluster == name] for name in names])
        covariance = bread @ (scores.T @ scores) @ bread * names.size / (names.size - p)
        dof = names.size - p
    return covariance / scale[:, None] / scale, dof
