"""Judge a value with its uncertainty against a limit: PASS, FAIL or INCONCLUSIVE, and what would make it conclusive.

The limits are narrowed by a guard band for acceptance and widened by it for rejection (JCGM 106:2012, 8.3; ILAC-G8):
with a band of one expanded uncertainty (k = 2) a unit at the limit is accepted, or rejected, in at most 2.3 % of all
cases. In between the verdict is INCONCLUSIVE. Without a band only the value counts and the risk is shared.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from scipy.special import ndtr

from benchctl.calibration.uncertainty import K
from benchctl.metrology.names import PROCEDURES
from benchctl.metrology.result import (
    Column,
    Judged,
    Limit,
    Measured,
    Message,
    Picture,
    Rule,
    Trace,
    Uncertainty,
    Verdict,
    message,
)
from benchctl.units import factor_between

_MOST_TIMES = 10_000
"""Longest extension of a measurement that is proposed, as a multiple of its duration."""


def rule_of(guard: float) -> Rule:
    """Return the decision rule for a guard band of so many expanded uncertainties."""
    if guard == 0.0:
        return Rule(guard=0.0, says=message("rule_simple"))
    return Rule(guard=guard, says=message("rule_guarded", guard=guard, risk_percent=100.0 * float(ndtr(-K * guard))))


def judged(measured: Measured, limit: Limit | None, rule: Rule) -> Judged:
    """Compare a result with its limit, in the limit's unit."""
    if limit is None:
        return Judged(measured=measured, limit=None, verdict=None)
    measured = in_unit(measured, limit.unit)
    if measured.value is None or measured.uncertainty is None:
        remedy = message("run_procedure", procedure=PROCEDURES[measured.name])
        return Judged(measured=measured, limit=limit, verdict="INCONCLUSIVE", remedy=remedy)
    band = rule.guard * measured.uncertainty.expanded
    verdict = _verdict(measured, limit, band)
    open_still = _remedy(measured, limit, rule) if verdict == "INCONCLUSIVE" else None
    return Judged(measured=measured, limit=limit, verdict=verdict, remedy=open_still)


def overall(every: tuple[Judged, ...]) -> Verdict:
    """Return FAIL if one result fails, INCONCLUSIVE if one is inconclusive, else PASS."""
    verdicts = {one.verdict for one in every}
    if "FAIL" in verdicts:
        return "FAIL"
    return "INCONCLUSIVE" if "INCONCLUSIVE" in verdicts else "PASS"


def in_unit(measured: Measured, unit: str) -> Measured:
    """Return the same result in another unit, with what its tables and plots show in the same unit."""
    return scaled(measured, factor_between(measured.unit, unit), unit)


def scaled(measured: Measured, factor: float, unit: str) -> Measured:
    """Return the same result in a unit in which its number is `factor` times as large."""
    value, uncertainty, own = measured.value, measured.uncertainty, measured.unit
    return replace(
        measured,
        unit=unit,
        value=None if value is None else factor * value,
        uncertainty=None if uncertainty is None else _scaled(uncertainty, factor),
        table=tuple(column_in(one, {own: (unit, factor)}) for one in measured.table),
        picture=None if measured.picture is None else picture_in(measured.picture, {own: (unit, factor)}),
    )


Units = Mapping[str, tuple[str, float]]
"""Unit -> the unit to be used in its place, and the factor of the numbers."""


def column_in(column: Column, units: Units) -> Column:
    """Return a column in another unit."""
    unit, factor = units.get(column.unit, (column.unit, 1.0))
    return replace(column, unit=unit, values=tuple(factor * value for value in column.values))


def picture_in(picture: Picture, units: Units) -> Picture:
    """Return a plot whose axes have other units."""
    x_unit, along = units.get(picture.x_unit, (picture.x_unit, 1.0))
    y_unit, up = units.get(picture.y_unit, (picture.y_unit, 1.0))
    left_unit, down = units.get(picture.left_unit, (picture.left_unit, 1.0))
    return replace(
        picture,
        x_unit=x_unit,
        y_unit=y_unit,
        left_unit=left_unit,
        traces=tuple(_trace(one, along, up) for one in picture.traces),
        left=tuple(_trace(one, along, down) for one in picture.left),
    )


def _trace(trace: Trace, along: float, up: float) -> Trace:
    standard = None if trace.standard is None else up * trace.standard
    return replace(trace, x=along * trace.x, y=up * trace.y, standard=standard)


def _scaled(uncertainty: Uncertainty, factor: float) -> Uncertainty:
    return replace(
        uncertainty,
        standard=factor * uncertainty.standard,
        expanded=factor * uncertainty.expanded,
        monte_carlo=factor * uncertainty.monte_carlo,
        contributors=tuple(replace(one, standard=factor * one.standard) for one in uncertainty.contributors),
    )


def _verdict(measured: Measured, limit: Limit, band: float) -> Verdict:
    """Compare with the limits widened and narrowed by the band; a bound decides only on its own side."""
    value = float(measured.value or 0.0)
    low = -math.inf if limit.low is None else limit.low
    high = math.inf if limit.high is None else limit.high
    known_low, known_high = measured.bound != "at most", measured.bound != "at least"
    if (value - band > high and known_low) or (value + band < low and known_high):
        return "FAIL"
    above = limit.low is None or (value - band >= low and known_low)
    below = limit.high is None or (value + band <= high and known_high)
    return "PASS" if above and below else "INCONCLUSIVE"


def _remedy(measured: Measured, limit: Limit, rule: Rule) -> Message:
    """Propose how much longer to average, so that the guard band no longer reaches the limit, if that can help."""
    uncertainty = measured.uncertainty
    if measured.bound or uncertainty is None or rule.guard == 0.0:
        return message("run_procedure", procedure=PROCEDURES[measured.name])
    value = float(measured.value or 0.0)
    nearest = min(abs(value - end) for end in (limit.low, limit.high) if end is not None)
    allowed = (nearest / (rule.guard * K)) ** 2
    if allowed == 0.0:
        return message("too_near")
    variances = {
        kind: math.fsum(one.standard**2 for one in uncertainty.contributors if one.kind == kind) for kind in "AB"
    }
    # the stated uncertainty may exceed the sum of the contributions: divide it in their proportion
    stated = (uncertainty.expanded / K) ** 2 / (math.fsum(variances.values()) or math.nan)
    scatter, others = stated * variances["A"], stated * variances["B"]
    if math.isnan(stated):
        return message("run_procedure", procedure=PROCEDURES[measured.name])
    if others >= allowed:
        largest = max((one for one in uncertainty.contributors if one.kind == "B"), key=lambda one: one.standard)
        return message("better_instrument", source=largest.source)
    times = scatter / (allowed - others)
    return (
        message("longer", times=math.floor(times) + 1, source="scatter") if times < _MOST_TIMES else message("too_near")
    )
