"""The end of the range of static points whose largest rates leave the law: two rails, or an overload.

The law is that of `benchctl.calibration.static_points_fit`, through the points that follow it. On either side the means
beyond it may be constant, at a rail; a stated deviation then collapses, as a rail has no noise. Or the output decreases
again with increasing rate: beyond full scale the electronics are overloaded. A fold of the interferometer also
decreases, but follows the law backwards: that is the effect `fringe_ambiguity` in the fit.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import numpy as np
from scipy.optimize import minimize_scalar

from benchctl.calibration.static_points_fit import (
    FEWEST_RATES,
    RESTING_DPS,
    PointsFit,
    fit_static_points,
)
from benchctl.diagnosis.faults.fault import Fault, bounded_gain
from benchctl.diagnosis.result import Estimate, Where
from benchctl.recordings.static_points import StaticPoints
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.physics.effects.fringe_ambiguity import folded_dps
from benchctl_instruments.physics.effects.overload import Overload

_WITHIN = 3.0
"""Factor on the largest residual within the law; means that differ by less agree."""
_COLLAPSED = 2.0 / 3.0
"""Share of the smallest deviation stated within the law; a smaller deviation is not the gyro's noise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PointRails:
    """The rails [V] at which means are constant; one that no point reaches is at the end of the outputs.

    `places` is the number of pairs of outputs that they are chosen from.
    """

    lower_v: float
    upper_v: float
    places: float


@dataclass(frozen=True, kw_only=True)
class PointsEnd:
    """Points, the law through those up to `follows_to_dps`, and a mask (n,) of those `off` the law beyond that rate.

    Means that differ by less than `tolerance_v` agree.
    """

    points: StaticPoints
    law: PointsFit
    follows_to_dps: float
    tolerance_v: float
    off: BoolArray

    @classmethod
    def of(cls, points: StaticPoints) -> Self | None:
        """Find the end of a table; None if all points follow the law, or if there are too few points."""
        rate, known = points.rate_dps, np.isfinite(points.mean_v)
        if np.unique(rate[known & (np.abs(rate) > RESTING_DPS)]).size < FEWEST_RATES:
            return None
        fitted = fit_static_points(rate[known], points.mean_v[known])
        law, size = fitted.rotating, np.abs(rate)
        away_v = np.abs(points.mean_v - law.output_v(rate))
        inside = known & (size <= fitted.follows_to_dps) & (size > RESTING_DPS)
        tolerance_v = _WITHIN * float(away_v[inside].max())
        off = known & (size > fitted.follows_to_dps) & (away_v > tolerance_v)
        if not off.any():
            return None
        return cls(points=points, law=law, follows_to_dps=fitted.follows_to_dps, tolerance_v=tolerance_v, off=off)

    @cached_property
    def upper(self) -> BoolArray:
        """Points on the side of the larger outputs, shape (n,)."""
        return np.asarray(self.points.rate_dps * self.law.K0_v_per_dps > 0.0)

    @cached_property
    def collapsed(self) -> BoolArray:
        """Points off the law whose stated deviation is too small for the gyro's noise, shape (n,)."""
        stated = self.points.std_v
        if stated is None:
            return np.zeros_like(self.off)
        within = stated[(np.abs(self.points.rate_dps) <= self.follows_to_dps) & (stated > 0.0)]
        least = float(within.min()) if within.size else 0.0
        return np.asarray(self.off & (stated < _COLLAPSED * least))

    def rails(self) -> PointRails | None:
        """Return the rails; None if a side deviates from the law in another way, or if no side has a rail."""
        mean = self.points.mean_v
        upper, lower = self._stands(self.upper), self._stands(~self.upper)
        if upper is None or lower is None or not (upper.any() or lower.any()):
            return None
        return PointRails(
            lower_v=float(mean[lower].mean() if lower.any() else np.nanmin(mean)),
            upper_v=float(mean[upper].mean() if upper.any() else np.nanmax(mean)),
            places=0.5 * mean.size * (mean.size - 1.0),
        )

    def _stands(self, side: BoolArray) -> BoolArray | None:
        """Return a mask (n,) of a side's points at a rail, empty if none is off the law; None if they do not agree.

        Several rates must agree, or the deviation stated at a single one must have collapsed.
        """
        off = self.off & side
        if not off.any():
            return off
        rates = np.unique(self.points.rate_dps[off]).size
        agree = float(np.ptp(self.points.mean_v[off])) < self.tolerance_v
        return off if agree and (rates > 1 or bool(self.collapsed[off].all())) else None

    def overload(self) -> Fault | None:
        """Return the overload as a fault of all points beyond the law; None without decrease, or for a fold."""
        if not any(self._falls(side) for side in (self.upper, ~self.upper)) or self._folds():
            return None
        rate, mean = np.abs(self.points.rate_dps), self.points.mean_v
        beyond = np.isfinite(mean) & (rate > self.follows_to_dps)
        first, largest = float(rate[self.off].min()), float(rate.max())
        law = self.law.output_v(self.points.rate_dps)
        lost = np.abs(law - self.law.U0_v) - np.abs(mean - self.law.U0_v)
        onsets = np.array([self.follows_to_dps, 0.5 * (self.follows_to_dps + first), first])
        past = np.maximum(rate[beyond] - onsets[:, None], 0.0)
        losses = past @ lost[beyond] / np.maximum(np.sum(past**2, axis=1), 1e-300)
        low, loss, high = np.sort(losses).tolist()
        effect = Overload(onset_dps=float(onsets[1]), loss_v_per_dps=max(loss, 0.0))
        described = effect.parameters
        tops = [float(mean[beyond & side][np.argmax(np.abs(mean[beyond & side]))]) for side in self._sides(beyond)]
        return Fault(
            effect=effect.identifier,
            parameters={
                "onset_dps": Estimate(
                    value=effect.onset_dps,
                    low=self.follows_to_dps,
                    high=first,
                    unit=described["onset_dps"].unit,
                ),
                "loss_v_per_dps": Estimate(
                    value=effect.loss_v_per_dps, low=low, high=high, unit=described["loss_v_per_dps"].unit
                ),
            },
            rows=beyond,
            gain=bounded_gain(0.5 * float(np.sum((lost[self.off] / self.tolerance_v) ** 2))),
            says=(
                f"Beyond {first:g} °/s the gyro is overloaded: the output reaches"
                f" {' and '.join(f'{top:.4g} V' for top in tops)} and falls again as the rate grows. The"
                f" {int(beyond.sum())} points there are left out of the law, which holds up to"
                f" {self.follows_to_dps:g} °/s."
            ),
            where=Where(coordinate=effect.coordinate, ranges=((first, largest),), share_of_excess=1.0),
        )

    def _sides(self, beyond: BoolArray) -> Iterator[BoolArray]:
        yield from (side for side in (~self.upper, self.upper) if bool(np.any(beyond & side)))

    def _falls(self, side: BoolArray) -> bool:
        """Return whether a side's output decreases with increasing rate anywhere beyond the law."""
        rows = side & (np.abs(self.points.rate_dps) >= self.follows_to_dps) & np.isfinite(self.points.mean_v)
        rows = rows[np.argsort(np.abs(self.points.rate_dps), kind="stable")]
        by_rate = self.points.mean_v[np.argsort(np.abs(self.points.rate_dps), kind="stable")][rows]
        size = np.abs(by_rate - self.law.U0_v)
        return bool(size.size and np.any(np.maximum.accumulate(size) - size > self.tolerance_v))

    def _folds(self) -> bool:
        """Return whether the law at folded rates reproduces all points off it."""
        rate, mean = self.points.rate_dps[self.off], self.points.mean_v[self.off]

        def away_v(fold: float) -> FloatArray:
            return self.law.output_v(folded_dps(rate, fold)) - mean

        fold = minimize_scalar(
            lambda fold: float(np.sum(away_v(fold) ** 2)),
            bounds=(self.follows_to_dps, float(np.abs(rate).min())),
            method="bounded",
        )
        return bool(np.all(np.abs(away_v(float(fold.x))) < self.tolerance_v))

    def remarks(self) -> Iterator[str]:
        """Yield what the stated deviations, if any, show about the points off the law."""
        stated, rows = self.points.std_v, self.collapsed
        if stated is None or not rows.any():
            return
        rates = ", ".join(f"{rate:g}" for rate in np.unique(self.points.rate_dps[rows]).tolist())
        others = stated[(np.abs(self.points.rate_dps) <= self.follows_to_dps) & (stated > 0.0)]
        yield (
            f"The stated deviation collapses at {rates} °/s, to {1e3 * float(stated[rows].max()):.2g} mV or less where"
            f" the law is followed by {1e3 * float(others.min()):.2g} mV at least: the output is at a limit there."
        )
