"""Points of output over rate, without drift, and their uncertain quantities."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchctl.metrology.drift import Means, Noises, settled
from benchctl.metrology.propagation import Offsets, Quantity, independent, scattered, single
from benchctl.metrology.stretches import Reading, Stretch
from benchctl.recordings.stated import StatedUncertainties
from benchctl_instruments.arrays import BoolArray, FloatArray, IntArray

UP, DOWN, REST = 1, -1, 0
_ALIKE_DPS = 1e-6
_SLOWEST_DPS = 1.0
_ARCSEC_PER_DEG = 3600.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Points:
    """Outputs over rates, (n,) each; for every stretch first the rest, as one point, then its rates in time order.

    `output_v` includes the bias, without drift; its covariance `covariance_v2` (n, n) has `dof` degrees of freedom.
    `leg`: `UP` if the previous rate of the same sign was smaller or there was none, `DOWN` if it was larger, `REST`.
    `stretch` is the index of the stretch, `step` that of the recording's step, for rest that of its first one;
    `rest_steps` has all steps at rest, by stretch.
    `swept` are the points to which a line is fitted: rest, and of every rate from 1 °/s in both directions the first
    visit on either leg, so that repeated rates, or small changes about one, do not weigh more. `begins_s` is the start
    of the point's stretch, `walk_v2_per_s` the strength of the bias walk.
    """

    rate_dps: FloatArray
    set_dps: FloatArray
    output_v: FloatArray
    covariance_v2: FloatArray
    duration_s: FloatArray
    temperature_c: FloatArray
    coarse_v: FloatArray
    stretch: IntArray
    leg: IntArray
    step: IntArray
    swept: BoolArray
    begins_s: FloatArray
    walk_v2_per_s: float
    dof: float
    rest_steps: Mapping[int, tuple[int, ...]]

    @property
    def steps(self) -> tuple[int, ...]:
        """Every step that the points come from, including all the rest of a stretch."""
        resting = {int(one) for one in self.stretch[self.leg == REST]}
        return tuple(sorted({*map(int, self.step), *(step for one in resting for step in self.rest_steps[one])}))

    def of(self, chosen: BoolArray | IntArray) -> Points:
        """Return some of the points."""
        places = np.flatnonzero(chosen) if chosen.dtype == np.bool_ else chosen
        shared = ("covariance_v2", "walk_v2_per_s", "dof", "rest_steps")
        own = {name: getattr(self, name)[places] for name in self.__dataclass_fields__ if name not in shared}
        return Points(
            **own,
            covariance_v2=self.covariance_v2[np.ix_(places, places)],
            walk_v2_per_s=self.walk_v2_per_s,
            dof=self.dof,
            rest_steps=self.rest_steps,
        )

    def quantities(self, stated: StatedUncertainties, *, drifting: bool = True) -> list[Quantity]:
        """Return the uncertain quantities of rates and outputs; `moved` takes their offsets.

        If `drifting`, the bias walk from one stretch to another is included, for the comparison of stretches.
        """
        walked_s = np.minimum.outer(self.begins_s, self.begins_s) - np.min(self.begins_s, initial=np.inf)
        covariance = self.covariance_v2 + (self.walk_v2_per_s * walked_s if drifting else 0.0)
        per_angle = np.sqrt(2.0) * stated.encoder_arcsec.standard / _ARCSEC_PER_DEG
        return [
            scattered("scatter", covariance, "scatter of the readings, drift of the bias included", self.dof),
            independent("encoder", per_angle / self.duration_s * (self.leg != REST), stated.encoder_arcsec.says),
            single("clock", 1e-6 * stated.clock_ppm.standard, stated.clock_ppm.says),
            single("mounting", float(np.deg2rad(stated.mounting_deg.standard)), stated.mounting_deg.says),
            single("converter's gain", 1e-6 * stated.gain_ppm.standard, stated.gain_ppm.says),
            single("converter's offset", stated.offset_v.standard, stated.offset_v.says),
            independent("converter's steps", self.coarse_v, "its steps, where noise does not blur them", uniform=True),
        ]

    def moved(self, offsets: Offsets) -> tuple[FloatArray, FloatArray]:
        """Return true rates about the gyro's axis and true volts, (d, n) each, for these offsets of the readings."""
        rate_dps = (self.rate_dps + offsets["encoder"]) * (1.0 + offsets["clock"]) * np.cos(offsets["mounting"])
        output_v = self.output_v + offsets["scatter"] + offsets["converter's steps"]
        return rate_dps, output_v * (1.0 + offsets["converter's gain"]) + offsets["converter's offset"]


def points_of(stretches: Sequence[Stretch], noises: Noises) -> Points:
    """Return the points of stretches, in their order; `noises` give the strength of the bias walk."""
    means = [means_of(stretch.readings) for stretch in stretches]
    parts = [settled(one, noises) for one in means]
    sizes = [part.output_v.size for part in parts]
    covariance = np.zeros((sum(sizes), sum(sizes)))
    edges = np.concatenate([[0], np.cumsum(sizes)]).astype(int)
    for part, first, last in zip(parts, edges[:-1], edges[1:], strict=True):
        covariance[first:last, first:last] = part.covariance_v2
    begins_s = [float(np.min(one.middle_s - 0.5 * one.duration_s)) for one in means]
    rows = [row for number, stretch in enumerate(stretches) for row in _rows(stretch.readings, number)]
    return Points(
        rate_dps=np.array([row.reading.rate_dps for row in rows]),
        set_dps=np.array([row.reading.set_dps for row in rows]),
        output_v=np.concatenate([part.output_v for part in parts]) if parts else np.zeros(0),
        covariance_v2=covariance,
        duration_s=np.array([row.reading.duration_s for row in rows]),
        temperature_c=np.array([row.reading.temperature_c for row in rows]),
        coarse_v=np.array([row.reading.coarse_v for row in rows]),
        stretch=np.array([row.stretch for row in rows], dtype=np.int64),
        leg=np.array([row.leg for row in rows], dtype=np.int64),
        step=np.array([row.reading.step for row in rows], dtype=np.int64),
        swept=_swept(rows),
        begins_s=np.array([begins_s[row.stretch] for row in rows]),
        walk_v2_per_s=float(sum(weight * noise.walk for noise, weight in noises)),
        dof=min((part.dof for part in parts), default=math.inf),
        rest_steps={
            number: tuple(sorted({one.step for one in stretch.readings if one.set_dps == 0.0}))
            for number, stretch in enumerate(stretches)
        },
    )


def _swept(rows: Sequence[_Row]) -> BoolArray:
    """Return `Points.swept`; if a stretch has no rate in both directions, all its rates count."""
    rates = {(row.stretch, row.rate) for row in rows if abs(row.reading.set_dps) >= _SLOWEST_DPS}
    paired = {(stretch, rate) for stretch, rate in rates if (stretch, -rate) in rates}
    of_pairs = {stretch for stretch, _ in paired}
    visited: set[tuple[int, float, int]] = set()
    found = []
    for row in rows:
        rate, visit = (row.stretch, row.rate), (row.stretch, row.rate, row.leg)
        counts = rate in (paired if row.stretch in of_pairs else rates)
        found.append(row.leg == REST or (counts and visit not in visited))
        visited.add(visit)
    return np.array(found, dtype=np.bool_)


@dataclass(frozen=True, slots=True, kw_only=True)
class _Row:
    reading: Reading
    stretch: int
    leg: int

    @property
    def rate(self) -> float:
        """The commanded rate, rounded to tell rates apart."""
        return round(self.reading.set_dps, 6)


def means_of(readings: Sequence[Reading]) -> Means:
    """Convert readings to arrays."""
    return Means(
        output_v=np.array([one.output_v for one in readings]),
        middle_s=np.array([one.middle_s for one in readings]),
        duration_s=np.array([one.duration_s for one in readings]),
        white_v2=np.array([one.white_v2 for one in readings]),
        rest=np.array([one.set_dps == 0.0 for one in readings]),
    )


def _rows(readings: Sequence[Reading], stretch: int) -> list[_Row]:
    """Return one row for the rest and one for each rate, in the order of `settled`."""
    rows: list[_Row] = []
    rest = [one for one in readings if one.set_dps == 0.0]
    if rest:
        together = replace(
            rest[0],
            rate_dps=0.0,
            duration_s=sum(one.duration_s for one in rest),
            temperature_c=float(np.mean([one.temperature_c for one in rest])),
            coarse_v=max(one.coarse_v for one in rest),
        )
        rows.append(_Row(reading=together, stretch=stretch, leg=REST))
    before: dict[bool, float] = {}
    for one in readings:
        if one.set_dps == 0.0:
            continue
        forward = one.set_dps > 0.0
        leg = DOWN if before.get(forward, 0.0) > abs(one.set_dps) + _ALIKE_DPS else UP
        before[forward] = abs(one.set_dps)
        rows.append(_Row(reading=one, stretch=stretch, leg=leg))
    return rows


def line(rate_dps: FloatArray, output_v: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return slope [V/(deg/s)] and intercept [V] of the least-squares line of each draw, (d,) each; points (d, n)."""
    x = rate_dps - rate_dps.mean(axis=1, keepdims=True)
    slope = (x * output_v).sum(axis=1) / (x**2).sum(axis=1)
    return slope, output_v.mean(axis=1) - slope * rate_dps.mean(axis=1)


def misfit(rate_dps: FloatArray, output_v: FloatArray) -> FloatArray:
    """Return the residual of the least-squares line through all points [V], shape (d, n)."""
    slope, intercept = line(rate_dps, output_v)
    return np.asarray(output_v - slope[:, None] * rate_dps - intercept[:, None])
