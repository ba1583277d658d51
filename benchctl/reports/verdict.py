"""The result of a calibration in sentences."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from benchctl.calibration.result import CalibrationResult
from benchctl.recordings.model import Meta
from benchctl.reports import text
from benchctl.reports.figures import PATH_LEVELS, level_names

_STATUS: Mapping[str, str] = {
    "complete": "complete",
    "imported": "imported from another bench's files",
    "simulated": "simulated",
    "interrupted": "interrupted by the operator",
    "aborted": "aborted by an error or a limit",
    "running": "still running",
}
_UNFINISHED = ("interrupted", "aborted", "running")


@dataclass(frozen=True, slots=True, kw_only=True)
class Tile:
    """One level of the calibration: its largest and its rms error on the held-out runs, percent."""

    level: str
    name: str
    error_percent: float
    rms_percent: float | None


def tiles(result: CalibrationResult) -> list[Tile]:
    """Return the error of each level on held-out runs; empty without such runs."""
    return [
        Tile(
            level=level,
            name=level_name(result, level),
            error_percent=result.error_percent[level],
            rms_percent=result.rms_percent.get(level),
        )
        for level in level_names(tuple(result.error_percent))
    ]


def level_name(result: CalibrationResult, level: str) -> str:
    """Return a level's short name; the joint fit's includes its law."""
    return f"{PATH_LEVELS[level]} ({result.best.law})" if level == "joint" and result.joint else PATH_LEVELS[level]


def sentence(result: CalibrationResult) -> str:
    """Return a sentence with the errors reached and the runs they were measured on."""
    path = tiles(result)
    if not path:
        return (
            "No run was kept aside for verification, so no error is stated for this calibration: "
            "an error measured on the runs that were fitted would flatter it."
        )
    kept = [run for run in result.runs if run.role == "verify"]
    rates = text.plain(max((run.peak_rate_dps for run in kept), default=0.0), "°/s")
    temperatures = [run.temperature_c for run in kept if math.isfinite(run.temperature_c)]
    where = f" at {text.span(min(temperatures), max(temperatures), '°C')}" if temperatures else ""
    where += f"{' and' if where else ''} up to {rates}" if kept else ""
    many = "1 run" if len(kept) == 1 else f"{len(kept)} runs"
    if len(path) == 1:
        return f"On {many} that were held out{where}, the largest error with one straight line is {_error(path[0])}."
    steps = [f"{_error(tile)} {_WITH[tile.level]}" for tile in path[1:]]
    steps = [", ".join(steps[:-1]) + " and " + steps[-1]] if len(steps) > 1 else steps
    return (
        f"On {many} that were held out{where}, the largest error falls from {_error(path[0])} with one straight line "
        f"to {steps[0]}."
    )


def status_text(meta: Meta) -> str:
    """Return the status of the recording in words."""
    return _STATUS[meta.status]


def cautions(meta: Meta, cut: list[str]) -> list[str]:
    """Return the warnings at the head of a report: an unfinished campaign, cut steps."""
    found = []
    if meta.status in _UNFINISHED:
        found.append(
            f"The campaign is not complete: it was {_STATUS[meta.status]}. This report covers what was recorded."
        )
    if cut:
        more = f", and {len(cut) - 5} more" if len(cut) > 5 else ""
        found.append(f"Recorded with losses: {'; '.join(cut[:5])}{more}.")
    return found


def is_simulated(meta: Meta) -> bool:
    """Return whether the gyro was simulated."""
    return meta.status == "simulated" or bool(meta.provenance.get("bench_physics"))


_WITH: Mapping[str, str] = {
    "raw": "with one straight line",
    "stage_1": "after stage 1",
    "stage_2": "after stage 2",
    "joint": "with the joint fit",
}


def _error(tile: Tile) -> str:
    return text.percent(tile.error_percent)
