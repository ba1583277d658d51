"""The errors of each run in motion, in rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from benchctl.calibration.result import CalibrationResult
from benchctl.recordings.model import StepInfo
from benchctl.reports import text
from benchctl.reports.figures import level_names
from benchctl.reports.path_figures import shown_runs
from benchctl.reports.setup_section import kind_name

_MOST_RUNS = 60


@dataclass(frozen=True, slots=True, kw_only=True)
class RunLine:
    """One run: what was asked, and its largest and rms error in percent per level."""

    step: int
    kind: str
    temperature: str
    peak_rate: str
    frequency: str
    errors: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class RunTable:
    """The runs that are shown, and which they are; `left_out` counts those beyond the table's length."""

    verified: bool
    levels: tuple[str, ...]
    lines: tuple[RunLine, ...]
    left_out: int


def run_table(result: CalibrationResult, infos: Sequence[StepInfo]) -> RunTable | None:
    """The runs kept aside, or the fitted ones where there are none; None without runs."""
    runs = shown_runs(result)
    if not runs:
        return None
    levels = tuple(level_names(tuple({level for run in runs for level in run.error_percent})))
    asked = {info.index: info for info in infos}
    lines = [
        RunLine(
            step=run.step,
            kind=kind_name(asked[run.step].kind if run.step in asked else run.kind),
            temperature=text.plain(run.temperature_c),
            peak_rate=text.plain(run.peak_rate_dps),
            frequency=text.plain(asked[run.step].frequency_hz if run.step in asked else None, decimals=3),
            errors=tuple(
                (text.number(run.error_percent.get(level), 2), text.number(run.rms_percent.get(level), 2))
                for level in levels
            ),
        )
        for run in runs[:_MOST_RUNS]
    ]
    verified = runs[0].role == "verify"
    return RunTable(verified=verified, levels=levels, lines=tuple(lines), left_out=len(runs) - len(lines))
