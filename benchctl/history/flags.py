"""What of a series a reader must look at, each in one sentence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from benchctl.history.control import Control, outside, runs
from benchctl.history.series import Drift, Series
from benchctl.history.siblings import Siblings

Kind = Literal["fails", "outside_limits", "run_on_one_side", "drift", "apart_from_siblings"]
_OTHER_TEMPERATURE_C = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Flag:
    """One thing to look at: `campaign` is the path of the one that shows it, `says` the sentence."""

    kind: Kind
    campaign: str
    says: str


def flags_of(
    series: Series,
    control: Control | None,
    drift: Drift | None,
    since_first: Drift | None,
    siblings: Siblings | None,
) -> tuple[Flag, ...]:
    """All flags of a series, the most serious kind first."""
    found = []
    latest, points = series.latest, series.known
    if latest.verdict == "FAIL":
        found.append(Flag(kind="fails", campaign=latest.campaign, says="the latest value fails its limit"))
    if control is not None:
        values = [point.value for point in points]
        for index in outside(values, control):
            says = f"outside the control limits on {_date(points[index].started_utc)}"
            found.append(Flag(kind="outside_limits", campaign=points[index].campaign, says=says))
        for first, last in runs(values, control):
            side = "above" if values[first] > control.centre else "below"
            said = f"{last - first + 1} in a row {side} the mean, {_date(points[first].started_utc)} to "
            says = f"{said}{_date(points[last].started_utc)}"
            found.append(Flag(kind="run_on_one_side", campaign=points[last].campaign, says=says))
    for one, which in ((drift, "last"), (since_first, "first")):
        if one is not None and one.is_significant and (which == "last" or one != drift):
            says = f"drifted since the {which} {'calibration' if one.since.calibrated else 'campaign'}"
            found.append(Flag(kind="drift", campaign=points[-1].campaign, says=f"{says}{_how_far(series, one)}"))
    if siblings is not None and not latest.bound and siblings.is_apart(latest.value, latest.uncertainty):
        z = siblings.z(latest.value)
        says = f"apart from the other units of its model (robust z = {z:.1f}, limit {siblings.limit:.1f})"
        found.append(Flag(kind="apart_from_siblings", campaign=latest.campaign, says=says))
    return tuple(found)


def _how_far(series: Series, drift: Drift) -> str:
    before, after = drift.since.temperature_c, series.known[-1].temperature_c
    also = ""
    if before is not None and after is not None and abs(after - before) > _OTHER_TEMPERATURE_C:
        also = f"; then at {before:.1f} °C, now at {after:.1f} °C"
    return f", {_date(drift.since.started_utc)} (E_n = {drift.e_n:.2g}{also})"


def _date(started_utc: str) -> str:
    return started_utc[:10]
