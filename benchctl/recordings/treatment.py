"""What was found in foreign stamps and what was done about it, in words and as JSON, for a recording's provenance."""

from __future__ import annotations

import json
from collections.abc import Sequence

from benchctl.recordings.column_map import TimeEntry
from benchctl.recordings.raw_columns import RawColumns
from benchctl.recordings.stamps import Survey, TimeBase


def tell(base: TimeBase, raw: RawColumns, entry: TimeEntry) -> str:
    """The account in words."""
    if entry.rate_hz is not None:
        return f"no stamps in the file; rows taken as uniform at {entry.rate_hz:.9g} Hz, as the map says"
    if base.survey is None:
        kept = "not uniform" if base.rate_hz is None else f"uniform at {base.rate_hz:.9g} Hz"
        return f"stamps as they stand ({kept}), counted from the first"
    survey, first = base.survey, raw.first_row
    lost = sum(gap.missing for gap in survey.gaps)
    told = [
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
        told.append(f"after {survey.restarts} of the gaps the clock begins anew between two of its places")
    filled = int(base.filled.sum())
    if filled:
        told.append(f"{filled} samples were filled in linearly and are marked in the channel filled")
    if len(base.starts) > 1:
        told.append(f"steps were cut at {len(base.starts) - 1} gaps")
    return ". ".join(part[:1].upper() + part[1:] for part in told) + "."


def told_as_json(base: TimeBase, survey: Survey, first_row: int) -> str:
    """The account for programs; rows and lines are the file's own numbers."""
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
    """The first rows in brackets; JSON has them all."""
    if not rows:
        return ""
    shown = ", ".join(str(row) for row in rows[:5])
    return f" ({word} {shown}{', …' if len(rows) > 5 else ''})"
