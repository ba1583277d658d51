"""Collect from a recording what all tests of a gyro use: stretches, points, and the reference stretch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from benchctl.metrology.drift import Noises, noises_of
from benchctl.metrology.names import UNITS
from benchctl.metrology.points import REST, Points, means_of, points_of
from benchctl.metrology.propagation import Quantity
from benchctl.metrology.result import Bound, Column, Measured, Message, Picture, Trace, Uncertainty
from benchctl.metrology.stretches import Stretch, stretches_of
from benchctl.recordings.reader import Recording
from benchctl.recordings.stated import StatedUncertainties, stated_of
from benchctl.tables import Table
from benchctl_instruments.arrays import FloatArray

ROOM_C = 20.0
"""Reference temperature if none is stated (ISO 1)."""
SAME_C = 1.0
"""Largest difference of set points that count as one temperature."""
_FEWEST_RATES = 3


class Settings(Table):
    """Settings of the tests: thresholds that belong to a test's definition.

    `low_rate_dps`: upper end of the rates to which the line for errors of reading is fitted. `linearity_percent` bounds
    the input range. `warm_deg_per_h`: distance from the final bias at which a unit counts as warm. Bias stability is
    the standard deviation of means over `mean_s`, of a rest of at least `rest_s`.
    """

    low_rate_dps: float = Field(default=40.0, gt=0)
    linearity_percent: float = Field(default=1.0, gt=0)
    warm_deg_per_h: float = Field(default=10.0, gt=0)
    mean_s: float = Field(default=10.0, gt=0)
    rest_s: float = Field(default=600.0, gt=0)


@dataclass(frozen=True, slots=True, kw_only=True)
class Observations:
    """A recording for the tests. `reference` is the index of a stretch, None if no stretch has three rates.

    `noises` describe the random walk of the bias, estimated from all rests.
    """

    recording: Recording
    stated: StatedUncertainties
    settings: Settings
    stretches: Sequence[Stretch]
    noises: Noises
    points: Points
    reference: int | None

    def in_stretch(self, number: int) -> Points:
        """Return the points of one stretch."""
        return self.points.of(self.points.stretch == number)

    def swept_in(self, numbers: Sequence[int]) -> Points:
        """Return the points of some stretches to which lines are fitted."""
        return self.points.of(np.isin(self.points.stretch, numbers) & self.points.swept)

    @property
    def at_reference(self) -> Points | None:
        """Points of the reference: the sweep with the highest rate, at the temperature nearest to room temperature."""
        return None if self.reference is None else self.swept_in([self.reference])

    @property
    def scale_v_per_dps(self) -> float:
        """Slope of the reference's line; NaN if there is no reference."""
        points = self.at_reference
        if points is None:
            return float("nan")
        return float(np.polyfit(points.rate_dps, points.output_v, 1)[0])

    def quantities(self, points: Points, *, drifting: bool = True) -> list[Quantity]:
        """Return the uncertain quantities of some points."""
        return points.quantities(self.stated, drifting=drifting)


def observe(recording: Recording, settings: Settings) -> Observations:
    """Collect the observations of a recording."""
    stretches = list(stretches_of(recording))
    noises = noises_of([means_of(stretch.readings) for stretch in stretches])
    points = points_of(stretches, noises)
    room_c = float((recording.meta.simulation or {}).get("T0_c", ROOM_C))
    return Observations(
        recording=recording,
        stated=stated_of(recording.meta),
        settings=settings,
        stretches=stretches,
        noises=noises,
        points=points,
        reference=_reference(stretches, points, room_c),
    )


def _reference(stretches: Sequence[Stretch], points: Points, room_c: float) -> int | None:
    def merit(number: int) -> tuple[float, float, int]:
        rates = points.set_dps[(points.stretch == number) & points.swept]
        away = np.round(abs(stretches[number].temperature_c - room_c) / SAME_C)
        return float(np.round(np.max(np.abs(rates)))), -float(away), -number

    usable = [
        number
        for number, stretch in enumerate(stretches)
        if not stretch.across
        and np.unique(points.set_dps[(points.stretch == number) & points.swept]).size >= _FEWEST_RATES
    ]
    return max(usable, key=merit, default=None)


def refused(name: str, why: Message) -> Measured:
    """Return the result of a test that the recording does not contain."""
    return Measured(name=name, unit=UNITS[name], refused=why)


def measured(
    name: str,
    value: float,
    uncertainty: Uncertainty,
    points: Points,
    *,
    notes: tuple[Message, ...] = (),
    bound: Bound = "",
    table: tuple[Column, ...] = (),
    picture: Picture | None = None,
) -> Measured:
    """Return a result of some points, with their steps and mean temperature."""
    return Measured(
        name=name,
        unit=UNITS[name],
        value=value,
        uncertainty=uncertainty,
        bound=bound,
        notes=notes,
        temperature_c=celsius_of(*points.temperature_c),
        steps=points.steps,
        table=table,
        picture=picture,
    )


def celsius_of(*celsius: float) -> float | None:
    """Return the mean temperature; None if it is not known."""
    mean = float(np.mean(celsius))
    return mean if np.isfinite(mean) else None


def same_set_point(one_c: float, other_c: float) -> bool:
    """Return whether two set points are one temperature, or both unknown."""
    return abs(one_c - other_c) < SAME_C or bool(np.isnan(one_c) and np.isnan(other_c))


def column(name: str, unit: str, values: FloatArray) -> Column:
    """Return a column of a table of points."""
    return Column(name=name, unit=unit, values=tuple(values.tolist()))


def dots(x: Column, y: Column, *, standard: FloatArray | None = None, limited: Literal["", "x", "y"] = "") -> Picture:
    """Return a plot of one column over another; `standard` are the standard uncertainties of the latter."""
    trace = Trace(label="readings", x=np.array(x.values), y=np.array(y.values), standard=standard)
    return Picture(x=x.name, x_unit=x.unit, y=y.name, y_unit=y.unit, traces=(trace,), limited=limited)


def both_directions(points: Points) -> bool:
    """Return whether there are at least two rates in either direction."""
    return all(np.unique(points.set_dps[side]).size > 1 for side in (points.set_dps > 0, points.set_dps < 0))


def has_rest(points: Points) -> bool:
    """Return whether there is a reading at rest."""
    return bool((points.leg == REST).any())
