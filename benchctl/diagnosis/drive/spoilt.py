"""Invalid samples of a drive: wrapped counters, a torque at a converter's rail, spikes.

Suspected faults of the torque are compared with the motion. A wrapped torque does not fit it. A torque at a limit may
be the limit of the drive itself, which fits the motion; a converter at its rail reads less than the motion requires.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation, median_filter

from benchctl.diagnosis.faults.clipping import NEAR, gain_of, limits_of, stated_limits
from benchctl.diagnosis.faults.fault import Fault
from benchctl.diagnosis.faults.grid import grid_of
from benchctl.diagnosis.faults.outliers import spikes_in
from benchctl.diagnosis.faults.wrapping import EFFECT, wraps_in
from benchctl_instruments.arrays import BoolArray, FloatArray

TURN_DEG = 360.0

_WHOLE = 0.01
"""Tolerance, in turns, for a modulus to count as an integer number of turns."""

_ISOLATED = 5
"""Window of a running median, in samples, that removes spikes beyond the rail."""

_FITS = 0.5
"""A torque was wrapped if unwrapping reduces its misfit with the motion to less than this share."""

_BEYOND = 3.0
"""Deviations by which the motion must require more than a torque at its limit."""

_FEWEST_ROWS = 5
"""Minimum number of rows at a limit for a comparison with the motion."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Torque:
    """A corrected torque [N·m]: rows (m,), those still `spoilt` (m,), and the `faults`, with rows (m,)."""

    rows_nm: FloatArray
    spoilt: BoolArray
    faults: tuple[Fault, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class MovingRows:
    """Rows that a torque is compared with: `columns` (m, k), of which it is a linear combination while `moving`.

    `means` computes rows (m,) from samples (n,).
    """

    columns: FloatArray
    moving: BoolArray
    means: Callable[[FloatArray], FloatArray]

    def holding(self, samples: BoolArray) -> BoolArray:
        """Return a mask of the rows (m,) that contain any of the given samples (n,)."""
        return self.means(samples.astype(np.float64)) > 0.0


def angle_period_of(encoder_deg: FloatArray, runs: tuple[slice, ...]) -> tuple[float, Fault | None]:
    """Return the period [deg] of an encoder's angles (n,), and a fault without rows if it is not 360° or a multiple."""
    wraps = wraps_in(encoder_deg, runs, 0.0)
    turns = 1.0 if wraps is None else wraps.modulus / TURN_DEG
    if wraps is None or abs(turns - max(1, round(turns))) < _WHOLE:
        return TURN_DEG, None
    return wraps.modulus, Fault(
        effect=EFFECT,
        parameters={"modulus_deg": wraps.estimate("degree")},
        rows=np.zeros(0, np.bool_),
        gain=wraps.gain,
        says=f"The encoder's angle wraps {wraps.count} times by {wraps.modulus:.6g}°, not by a turn: it is unwrapped.",
        coordinate="angle",
    )


def put_right(read_nm: FloatArray, runs: tuple[slice, ...], rows: MovingRows) -> Torque:
    """Return a torque [N·m], samples (n,), without certain faults; single samples are interpolated."""
    step_nm = grid_of(read_nm, 0.0).step_v
    torque_nm, lost, wrap = _unwrapped(read_nm, runs, step_nm, rows)
    limits = _limits(torque_nm[~lost])
    near = binary_dilation(np.isin(torque_nm, limits), iterations=NEAR)
    shown = spikes_in(residual=torque_nm, usable=~lost & ~near, step_v=step_nm, sudden=())
    good = ~shown.masked
    torque_nm = np.interp(np.arange(torque_nm.size), np.flatnonzero(good), torque_nm[good])
    rows_nm, unread = rows.means(torque_nm), rows.holding(lost)
    known = replace(rows, moving=rows.moving & ~unread)
    rail = _rail(torque_nm, rows_nm, limits, step_nm, known) if limits else None
    spikes = [_spikes(one, read_nm[shown.masked], rows.holding(shown.masked)) for one in shown.found]
    return Torque(
        rows_nm=rows_nm,
        spoilt=unread if rail is None else unread | rail.rows,
        faults=tuple(one for one in (wrap, rail, *spikes) if one is not None),
    )


def _unwrapped(
    read_nm: FloatArray, runs: tuple[slice, ...], step_nm: float, rows: MovingRows
) -> tuple[FloatArray, BoolArray, Fault | None]:
    """Return the unwrapped torque (n,), a mask of the wrapped samples (n,), and the fault."""
    none = np.zeros(read_nm.size, np.bool_)
    wraps = wraps_in(read_nm, runs, step_nm)
    if wraps is None:
        return read_nm, none, None
    kinds, met = np.unique(wraps.turns, return_counts=True)
    turns = wraps.turns - kinds[np.argmax(met)]
    unwrapped_nm = read_nm + wraps.modulus * turns
    if _missed(rows, rows.means(unwrapped_nm)) > _FITS * _missed(rows, rows.means(read_nm)):
        return read_nm, none, None
    lost = turns != 0
    fault = Fault(
        effect=EFFECT,
        parameters={"modulus_nm": wraps.estimate("N m")},
        rows=rows.holding(lost),
        gain=wraps.gain,
        says=(
            f"The torque wraps like a counter, {wraps.count} times, by {wraps.modulus:.6g} N·m, while the motion goes"
            f" on: {int(lost.sum())} of {lost.size} samples are left out."
        ),
        coordinate="output",
    )
    return unwrapped_nm, lost, fault


def _missed(rows: MovingRows, rows_nm: FloatArray) -> float:
    """Return the share of a torque's spread, rows (m,), that the motion does not explain."""
    return _Law.of(rows, rows_nm, rows.moving).deviation / (float(np.std(rows_nm[rows.moving])) or math.inf)


def _limits(torque_nm: FloatArray) -> list[float]:
    """Return the ends of the range at which a torque (n,) accumulates, ignoring single samples beyond."""
    smooth = median_filter(torque_nm, _ISOLATED, mode="nearest")
    return limits_of(torque_nm[(torque_nm >= smooth.min()) & (torque_nm <= smooth.max())])


def _rail(
    torque_nm: FloatArray, rows_nm: FloatArray, limits: list[float], step_nm: float, rows: MovingRows
) -> Fault | None:
    """Return the fault of a torque, samples (n,) and rows (m,), at limits that the motion requires it to exceed."""
    law = _Law.of(rows, rows_nm, ~rows.holding(np.isin(torque_nm, limits)))
    middle = float(np.median(torque_nm))
    kept = [
        limit
        for limit in limits
        if law.is_beyond(rows, rows_nm, rows.holding(torque_nm == limit), math.copysign(1.0, limit - middle))
    ]
    if not kept:
        return None
    samples = np.isin(torque_nm, kept)
    effect, parameters = stated_limits(kept, step_nm, "nm", "N m")
    stated = " and ".join(f"{limit:.4g} N·m" for limit in kept)
    return Fault(
        effect=effect,
        parameters=parameters,
        rows=rows.holding(np.asarray(binary_dilation(samples, iterations=NEAR))),
        gain=gain_of(samples),
        says=(
            f"The torque is {stated} in {int(samples.sum())} of {samples.size} samples although the motion takes"
            " more: its converter is at the rail. They are left out."
        ),
        coordinate="output",
    )


def _spikes(found: Fault, read_nm: FloatArray, rows: BoolArray) -> Fault:
    """Return the spikes in terms of a torque; `read_nm` (k,) are their readings."""
    return replace(
        found,
        parameters={
            name.replace("_v", "_nm"): replace(one, unit=one.unit.replace("V", "N m"))
            for name, one in found.parameters.items()
        },
        rows=rows,
        says=(
            f"{read_nm.size} samples of the torque are spikes, between {float(read_nm.min()):.4g} and"
            f" {float(read_nm.max()):.4g} N·m, that have nothing to do with the motion: they are left out."
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class _Law:
    """A torque as a function of the motion: `factors` (k,) of the columns, residual `deviation`, and covariance.

    The covariance is in units of the squared deviation.
    """

    factors: FloatArray
    deviation: float
    covariance: FloatArray

    @classmethod
    def of(cls, rows: MovingRows, rows_nm: FloatArray, counted: BoolArray) -> _Law:
        """Fit the torque in the rows (m,) that move and are counted."""
        used = rows.moving & counted
        columns = rows.columns[used]
        inverse = np.linalg.pinv(columns)
        factors = inverse @ rows_nm[used]
        return cls(
            factors=factors,
            deviation=float(np.sqrt(np.mean((rows_nm[used] - columns @ factors) ** 2))) if used.any() else math.inf,
            covariance=inverse @ inverse.T,
        )

    def is_beyond(self, rows: MovingRows, rows_nm: FloatArray, at_limit: BoolArray, way: float) -> bool:
        """Return whether the motion requires more than was read in rows (m,) at a limit, in direction `way`."""
        judged = rows.moving & at_limit
        if int(judged.sum()) < _FEWEST_ROWS:
            return False
        columns = rows.columns[judged]
        missed = way * float(np.mean(columns @ self.factors - rows_nm[judged]))
        mean = columns.mean(axis=0)
        return missed > _BEYOND * self.deviation * math.sqrt(1.0 + float(mean @ self.covariance @ mean))
