"""The records of the index as frozen dataclasses, and the series of each figure over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from benchctl.recordings.campaign_manifest import Integrity

Source = Literal["acceptance", "coefficients"]
SOURCES: tuple[Source, ...] = get_args(Source)
"""The files that state figures of a campaign, in the order of presentation."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Campaign:
    """The description of a recording. `started_utc` is ISO 8601 in UTC, to the second; `path` is in the folder.

    `parameters` are those of the procedure, as JSON; empty if they are not known. `integrity` is the result of the
    check against the manifest of its folder.
    """

    path: str
    serial: str
    model: str
    procedure: str
    started_utc: str
    status: str
    digest: str
    parameters: str
    integrity: Integrity = "not verified"


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """One number that a document states of a campaign, in `unit`.

    `uncertainty` is expanded (95.45 %). `temperature_c` is the temperature it applies to: a test's, or T0 of
    coefficients. `bound` is `at least` or `at most` if the value is only a limit of what the recording can show. `low`
    and `high` are the limits of an acceptance, `verdict` its result; empty or None if there is none.
    """

    name: str
    unit: str
    value: float
    uncertainty: float | None = None
    temperature_c: float | None = None
    bound: str = ""
    verdict: str = ""
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Document:
    """A file of coefficients or of an acceptance; `digests` are those of the recordings that it names, in order."""

    source: Source
    digests: tuple[str, ...]
    verdict: str
    figures: tuple[Figure, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """A figure as one campaign states it, in the series' unit; the fields are those of `Campaign` and `Figure`.

    `calibrated`: coefficients were fitted to that campaign. `integrity` is the result of the check of the document that
    states the figure against the manifest next to it.
    """

    started_utc: str
    campaign: str
    value: float
    uncertainty: float | None
    temperature_c: float | None
    bound: str
    verdict: str
    low: float | None
    high: float | None
    calibrated: bool
    integrity: Integrity = "not verified"


@dataclass(frozen=True, slots=True, kw_only=True)
class FigureSeries:
    """A figure of a unit over time: at least one point, ordered by start, then by path."""

    serial: str
    model: str
    source: Source
    name: str
    unit: str
    points: tuple[Point, ...]

    @property
    def latest(self) -> Point:
        """The last of its points."""
        return self.points[-1]

    @property
    def known(self) -> tuple[Point, ...]:
        """The points that state a value, not only a detection limit."""
        return tuple(point for point in self.points if not point.bound)


@dataclass(frozen=True, slots=True, kw_only=True)
class Drift:
    """The latest value less an earlier one, in the series' unit.

    `uncertainty` is √(U1² + U2²), expanded (95.45 %), and `e_n` the difference divided by it, as in ISO/IEC 17043:
    beyond ±1 the two disagree. Both are None if an uncertainty is not known. Contributions that both campaigns share,
    such as the bench and its certificates, are in U1 and in U2 but not in the difference: `e_n` is then smaller than it
    could be.
    """

    difference: float
    uncertainty: float | None
    e_n: float | None
    since: Point

    @property
    def is_significant(self) -> bool:
        """Whether |E_n| > 1."""
        return self.e_n is not None and abs(self.e_n) > 1.0


def drifts(points: Sequence[Point]) -> tuple[Drift, Drift] | None:
    """Return the drift of the last point since the previous one, and since the first; None without an earlier one.

    Earlier points are those at a campaign with a calibration; if there are none, all of them.
    """
    if len(points) < 2:
        return None
    *earlier, latest = points
    references = [point for point in earlier if point.calibrated] or earlier
    return drift_between(references[-1], latest), drift_between(references[0], latest)


def drift_between(before: Point, after: Point) -> Drift:
    """Return the drift from one point to another."""
    difference = after.value - before.value
    if before.uncertainty is None or after.uncertainty is None:
        return Drift(difference=difference, uncertainty=None, e_n=None, since=before)
    combined = math.hypot(before.uncertainty, after.uncertainty)
    e_n = difference / combined if combined > 0.0 else None
    return Drift(difference=difference, uncertainty=combined, e_n=e_n, since=before)
