"""Flag what a reader must examine in a series: values outside control limits, runs, drift, outliers among units.

Control limits are those of the individuals chart with moving ranges: centre ± 3·MR/d2, with MR the mean of |x[i] −
x[i−1]| and d2 = 1.128 for ranges of two (3/1.128 = 2.66). They are exceeded by 3 in 1000 values of a process that has
only its usual scatter. Eight values in a row on one side of the centre show that the level has moved (Western
Electric's fourth rule); by chance once in 128 such rows. Sources: NIST/SEMATECH e-Handbook of Statistical Methods,
6.3.2.2 and 6.3.2; Montgomery, Introduction to Statistical Quality Control.

Units are compared by a robust z = 0.6745·(x − median)/MAD, MAD the median of |x − median| (Iglewicz and Hoaglin 1993;
NIST/SEMATECH e-Handbook, 1.3.5.17, which calls |z| > 3.5 an outlier). For few units the MAD is uncertain, and 3.5 would
flag one in every fifth group of five like ones; therefore the limit is 3.5 + 8/(n − 3), which one group in twenty
exceeds by chance (by simulation; one in eight groups of 200 units).
"""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from benchctl.history.series import Drift, FigureSeries

FEWEST_UNITS = 5
"""Minimum number of units of a model for a comparison."""
TO_DEVIATIONS = 0.6745
"""MAD of a normal distribution, in standard deviations."""
_LIMIT, _OF_FEW, _LOST = 3.5, 8.0, 3


@dataclass(frozen=True, slots=True, kw_only=True)
class Siblings:
    """The units of a model: median and MAD of their latest values, and the limit of |z| for an outlier."""

    median: float
    mad: float
    limit: float
    units: int

    def z(self, value: float) -> float:
        """Return the robust z of a value."""
        return TO_DEVIATIONS * (value - self.median) / self.mad

    def is_apart(self, value: float, uncertainty: float | None) -> bool:
        """Return whether a value is beyond the limit, and further from the median than its own expanded uncertainty."""
        return abs(self.z(value)) > self.limit and abs(value - self.median) > (uncertainty or 0.0)

    @property
    def half_width(self) -> float:
        """The distance from the median that corresponds to `limit`, in the unit of the values."""
        return self.limit * self.mad / TO_DEVIATIONS


def siblings_of(values: Sequence[float]) -> Siblings | None:
    """Compare the latest values of all units of a model; None for too few units or if half are equal."""
    if len(values) < FEWEST_UNITS:
        return None
    median = statistics.median(values)
    mad = statistics.median(abs(value - median) for value in values)
    if mad == 0.0:
        return None
    limit = _LIMIT + _OF_FEW / (len(values) - _LOST)
    return Siblings(median=median, mad=mad, limit=limit, units=len(values))


FEWEST = 8
"""Minimum number of values for control limits; with fewer the moving range is too uncertain."""
RUN = 8
_D2 = 1.128


@dataclass(frozen=True, slots=True, kw_only=True)
class Control:
    """Centre and limits of an individuals chart, in the unit of its values."""

    centre: float
    low: float
    high: float


def control_of(values: Sequence[float]) -> Control | None:
    """Compute the chart of values in the order of time; None for fewer than `FEWEST`."""
    if len(values) < FEWEST:
        return None
    centre = statistics.mean(values)  # exactly rounded: equal values are exactly on it
    half = 3.0 * statistics.fmean(abs(after - before) for before, after in pairwise(values)) / _D2
    return Control(centre=centre, low=centre - half, high=centre + half)


def outside(values: Sequence[float], control: Control) -> list[int]:
    """Return the indices of the values beyond the limits."""
    return [index for index, value in enumerate(values) if not control.low <= value <= control.high]


def runs(values: Sequence[float], control: Control) -> list[tuple[int, int]]:
    """Return first and last index of each run of `RUN` or more values on one side of the centre."""
    found, start = [], 0
    sides = [(value > control.centre) - (value < control.centre) for value in values]
    for index, side in enumerate([*sides, 0]):
        if index == len(sides) or side != sides[start]:
            if sides[start] and index - start >= RUN:
                found.append((start, index - 1))
            start = index
    return found


Kind = Literal["fails", "outside_limits", "run_on_one_side", "drift", "apart_from_siblings"]
_OTHER_TEMPERATURE_C = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Flag:
    """One warning: `campaign` is the path of the campaign concerned, `says` the sentence."""

    kind: Kind
    campaign: str
    says: str


def flags_of(
    series: FigureSeries,
    control: Control | None,
    drift: Drift | None,
    since_first: Drift | None,
    siblings: Siblings | None,
) -> tuple[Flag, ...]:
    """Return all flags of a series, the most serious kind first."""
    found = []
    latest, points = series.latest, series.known
    if latest.verdict == "FAIL":
        found.append(Flag(kind="fails", campaign=latest.campaign, says="the latest value fails its limit"))
    if control is not None:
        values = [point.value for point in points]
        for index in outside(values, control):
            message = f"outside the control limits on {_date(points[index].started_utc)}"
            found.append(Flag(kind="outside_limits", campaign=points[index].campaign, says=message))
        for first, last in runs(values, control):
            side = "above" if values[first] > control.centre else "below"
            beginning = f"{last - first + 1} in a row {side} the mean, {_date(points[first].started_utc)} to "
            message = f"{beginning}{_date(points[last].started_utc)}"
            found.append(Flag(kind="run_on_one_side", campaign=points[last].campaign, says=message))
    for one, which in ((drift, "last"), (since_first, "first")):
        if one is not None and one.is_significant and (which == "last" or one != drift):
            message = f"drifted since the {which} {'calibration' if one.since.calibrated else 'campaign'}"
            found.append(Flag(kind="drift", campaign=points[-1].campaign, says=f"{message}{_how_far(series, one)}"))
    if siblings is not None and not latest.bound and siblings.is_apart(latest.value, latest.uncertainty):
        z = siblings.z(latest.value)
        message = f"apart from the other units of its model (robust z = {z:.1f}, limit {siblings.limit:.1f})"
        found.append(Flag(kind="apart_from_siblings", campaign=latest.campaign, says=message))
    return tuple(found)


def _how_far(series: FigureSeries, drift: Drift) -> str:
    before, after = drift.since.temperature_c, series.known[-1].temperature_c
    also = ""
    if before is not None and after is not None and abs(after - before) > _OTHER_TEMPERATURE_C:
        also = f"; then at {before:.1f} °C, now at {after:.1f} °C"
    return f", {_date(drift.since.started_utc)} (E_n = {drift.e_n:.2g}{also})"


def _date(started_utc: str) -> str:
    return started_utc[:10]
