"""Build a recording from columns and a map: units and signs, the clock, the steps, and a report of the treatment."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from benchctl.limits import HIGHEST_RATE_HZ
from benchctl.recordings import units
from benchctl.recordings.column_map import TIME, AngleColumn, ColumnMap, RawColumns, TimeEntry, converted
from benchctl.recordings.import_open import Description
from benchctl.recordings.model import BenchFacts, Meta, Step, Unit
from benchctl.recordings.stamps import (
    StampError,
    Survey,
    TimeBase,
    as_stamped,
    printed_resolution,
    repair,
    require_increase,
    require_uniform,
)
from benchctl.recordings.step_entries import StepEntry, cut_into_steps
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

FILLED = "filled"
"""The channel that is 1 where a sample was filled in instead of measured, and 0 elsewhere."""


def build_recording(
    raw: RawColumns, mapping: ColumnMap, map_name: str, description: Description | None = None
) -> tuple[Meta, list[Step]]:
    """Build a recording in memory; unit, bench and steps that the map does not state are taken from the description.

    The output of a digital gyro stays in `gyro_v`, in deg/s; `Meta.extra["gyro_output_unit"]` is then `deg/s`, else
    `V`. K0 of such a gyro is a number near 1, in (deg/s) per (deg/s).

    Raises
    ------
    UsageError
        Stamps that the map's policy does not allow, steps that do not fit, no unit.
    """
    if mapping.time is None or mapping.channels is None:
        raise UsageError(f"{map_name}: maps no samples, expected [time] and [channels.…]")
    entries = mapping.channels.columns
    base = _clock(raw, mapping.time, _stated_rate(mapping, description))
    channels: dict[str, FloatArray] = {TIME: base.time_s}
    for name, entry in entries.items():
        values = converted(raw, name, entry)
        if isinstance(entry, AngleColumn):
            channels[name] = _summed(base, values) if entry.is_rate else _place_angle(base, values)
        else:
            channels[name] = base.place(values)
    if base.filled.any():
        channels[FILLED] = base.filled.astype(np.float64)
    steps = cut_into_steps(
        _entries(mapping, description),
        channels,
        rate_hz=base.rate_hz,
        where=lambda k: f"{map_name}, steps[{k}]",
        starts=base.starts,
    )
    extra: dict[str, Any] = {"channel_units": {name: entry.channel_unit for name, entry in entries.items()}}
    extra |= {part: table for part in ("drive", "chamber") if (table := getattr(mapping, part))}
    if FILLED in channels:
        extra["channel_units"][FILLED] = "1"
    if "gyro_v" in entries:
        extra["gyro_output_unit"] = "V" if entries["gyro_v"].conversion.cf == "V" else "deg/s"
    if TIME in raw.values:
        extra["time_origin_s"] = float(units.TIME[mapping.time.unit].apply(raw.values[TIME][:1])[0])
    provenance = {"treatment": _treatment(base, raw, mapping.time)}
    if base.survey is not None:
        provenance["treatment_json"] = _told_as_json(base, base.survey, raw.first_row)
    meta = Meta(
        status="imported",
        unit=unit_of(mapping, description, map_name),
        bench=bench_of(mapping, description, base.rate_hz),
        provenance=provenance,
        simulation=None if description is None else description.simulation,
        extra=extra,
    )
    return meta, steps


def unit_of(mapping: ColumnMap, description: Description | None, map_name: str) -> Unit:
    """Return the gyro under test; raises `UsageError` if neither map nor description states it."""
    if mapping.unit is not None:
        return Unit(**mapping.unit.model_dump())
    if description is None:
        raise UsageError(f"{map_name}: [unit] is needed: at least serial, the gyro under test")
    return description.unit


def bench_of(mapping: ColumnMap, description: Description | None, rate_hz: float | None) -> BenchFacts:
    """Return the facts about the bench, from the map, else from the description; the rate is that of the clock."""
    stated = {name: getattr(mapping.bench, name) for name in mapping.bench.model_fields_set}
    known = {**({} if description is None else asdict(description.bench)), **stated, "sample_rate_hz": rate_hz or 0.0}
    return BenchFacts(**known)


def _entries(mapping: ColumnMap, description: Description | None) -> Sequence[StepEntry]:
    if mapping.steps:
        return mapping.steps
    if description is not None and description.steps:
        return description.steps
    return [StepEntry(name="recording", kind="motion")]


def _stated_rate(mapping: ColumnMap, description: Description | None) -> float | None:
    if mapping.bench.sample_rate_hz is not None:
        return mapping.bench.sample_rate_hz
    return None if description is None else description.bench.sample_rate_hz


def _clock(raw: RawColumns, entry: TimeEntry, stated_hz: float | None) -> TimeBase:
    rows = next(iter(raw.values.values())).size
    if entry.rate_hz is not None:
        return as_stamped(np.arange(rows) / entry.rate_hz, entry.rate_hz)
    with np.errstate(over="ignore"):
        stamps = units.TIME[entry.unit].apply(raw.values[TIME])
    try:
        if entry.stamps == "repair":
            return repair(stamps, _repeats(raw.values), fill=entry.gaps == "fill")
        require_increase(stamps)
        if entry.stamps == "keep":
            return as_stamped(stamps, None)
        rate_hz = stated_hz or _mean_rate(stamps)
        require_uniform(stamps, rate_hz, printed_resolution(stamps))
    except StampError as err:
        advice = "leave rows out (file.first_line)" if entry.stamps == "repair" else 'see time.stamps: "repair", "keep"'
        raise UsageError(f"{raw.place(err.row, TIME)}: {err.message}; {advice}") from err
    return as_stamped(stamps, rate_hz)


def _mean_rate(stamps_s: FloatArray) -> float:
    """Return the rate of the rows (Hz) from the median step, refined over the full span without gaps; 12 digits."""
    if stamps_s.size < 2:
        raise StampError(0, "one row defines no rate; say bench.sample_rate_hz")
    steps = np.diff(stamps_s)
    median = float(np.median(steps))
    if median < 1.0 / HIGHEST_RATE_HZ:
        raise StampError(1, f"rows follow each other after {median:.3g} s, faster than {HIGHEST_RATE_HZ:g} Hz")
    span = float(stamps_s[-1] - stamps_s[0])
    intervals = round(span / median)
    return float(f"{intervals / span if intervals == steps.size else 1.0 / median:.12g}")


def _repeats(values: Mapping[str, FloatArray]) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which rows repeat the values of the row before in all mapped columns, shape (rows,)."""
    same = [np.r_[False, column[1:] == column[:-1]] for name, column in values.items() if name != TIME]
    return np.asarray(np.logical_and.reduce(same), dtype=np.bool_)


def _place_angle(base: TimeBase, angle_deg: FloatArray) -> FloatArray:
    """Return an angle on the clock, wrapped to 0…360; filled in along the rotation, not across the wrap."""
    if base.filled.any():
        angle_deg = np.unwrap(angle_deg, period=360.0)
    return np.mod(base.place(angle_deg), 360.0)


def _summed(base: TimeBase, rate_dps: FloatArray) -> FloatArray:
    """Return the angle that an encoder's mean rates since the row before add up to, in 0…360, 0 before each stretch."""
    placed = base.place(rate_dps)
    usual_s = 1.0 / base.rate_hz if base.rate_hz else 0.0
    lasted_s = np.diff(base.time_s, prepend=base.time_s[0] - usual_s)
    lasted_s[list(base.starts)] = usual_s
    return np.mod(np.cumsum(placed * lasted_s), 360.0)


def _treatment(base: TimeBase, raw: RawColumns, entry: TimeEntry) -> str:
    """Return the report in words."""
    if entry.rate_hz is not None:
        return f"no stamps in the file; rows taken as uniform at {entry.rate_hz:.9g} Hz, as the map states"
    if base.survey is None:
        kept = "not uniform" if base.rate_hz is None else f"uniform at {base.rate_hz:.9g} Hz"
        return f"stamps unchanged ({kept}), counted from the first"
    survey, first = base.survey, raw.first_row
    lost = sum(gap.missing for gap in survey.gaps)
    sentences = [
        f"{survey.rows} rows from {raw.row_word} {first}; stamps printed to {survey.resolution_s * 1e3:g} ms"
        if survey.resolution_s
        else f"{survey.rows} rows from {raw.row_word} {first}; stamps printed in full",
        f"{len(survey.repeated_rows)} rows repeat the row before, stamp and values, and were dropped"
        + _listed(raw.row_word, [row + first for row in survey.repeated_rows]),
        f"{lost} samples are missing in {len(survey.gaps)} gaps"
        + _listed(f"after {raw.row_word}", [gap.after_row + first for gap in survey.gaps]),
        f"the stamps follow one clock of period {survey.period_s * 1e3:.7g} ms ({1 / survey.period_s:.7g} Hz) within "
        f"{survey.scatter_rms_s * 1e3:.3g} ms rms, where rounding alone leaves {survey.rounding_rms_s * 1e3:.3g} ms; "
        f"against it they wander by {survey.drift_s * 1e3:.3g} ms in all",
        "each row got its place on that clock, its columns unmoved against each other",
    ]
    if survey.restarts:
        sentences.append(f"after {survey.restarts} of the gaps the clock begins anew between two of its places")
    filled = int(base.filled.sum())
    if filled:
        sentences.append(f"{filled} samples were filled in linearly and are marked in the channel filled")
    if len(base.starts) > 1:
        sentences.append(f"the recording was cut into {len(base.starts)} steps")
    return ". ".join(part[:1].upper() + part[1:] for part in sentences) + "."


def _told_as_json(base: TimeBase, survey: Survey, first_row: int) -> str:
    """Return the report for programs; rows and lines are the file's own numbers."""
    return json.dumps(
        {
            "rows": survey.rows,
            "resolution_s": survey.resolution_s,
            "period_s": survey.period_s,
            "rate_hz": 1.0 / survey.period_s,
            "repeated_rows": [row + first_row for row in survey.repeated_rows],
            "gaps": [
                {"after_row": gap.after_row + first_row, "missing": gap.missing, "stamp_s": gap.stamp_s}
                for gap in survey.gaps
            ],
            "missing": sum(gap.missing for gap in survey.gaps),
            "restarts": survey.restarts,
            "filled": int(base.filled.sum()),
            "stretches": len(base.starts),
            "scatter_rms_s": survey.scatter_rms_s,
            "rounding_rms_s": survey.rounding_rms_s,
            "drift_s": survey.drift_s,
        }
    )


def _listed(word: str, rows: Sequence[int]) -> str:
    """Return the first rows in brackets; the JSON report contains all of them."""
    if not rows:
        return ""
    shown = ", ".join(str(row) for row in rows[:5])
    return f" ({word} {shown}{', …' if len(rows) > 5 else ''})"
