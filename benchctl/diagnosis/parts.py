"""The parts of a bench that can be diagnosed, each with its own problem."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from benchctl.diagnosis.chamber.problem import chamber_problem
from benchctl.diagnosis.drive.problem import drive_problem
from benchctl.diagnosis.gyro.points import has_points, points_problem
from benchctl.diagnosis.gyro.problem import gyro_problem
from benchctl.diagnosis.result import Part
from benchctl.estimation.problem import Problem
from benchctl.recordings.reader import Recording
from benchctl_instruments.errors import UsageError


def problem_of(
    recording: Recording, part: Part, *, model: Mapping[str, Any] | None = None, without: Collection[str] = ()
) -> Problem:
    """The problem of a part of the bench, of its recording and of the model that its lab believes in.

    `model` is the table of a model file that belongs to the part: `[simulation]` of the gyro, `[parts.drive]`,
    `[parts.chamber]`. Without one, a gyro's is that of the recording; a drive's or chamber's is the recording's own
    table of that name, in `meta.extra`, or else estimated from the recording.

    Raises `UsageError` where the recording does not have what the part takes, or the model has a wrong field.
    """
    if part == "gyro" and has_points(recording):
        return points_problem(recording, model=model, without=without)
    if part == "gyro":
        return gyro_problem(recording, model=model, without=without)
    foreign = recording.meta.extra.get("foreign_keys", {}).get("recording", {})
    told = model if model is not None else recording.meta.extra.get(part, foreign.get(part))
    if told is not None and not isinstance(told, Mapping):
        raise UsageError(f"{recording.path}: {part}: expected a table of numbers, got {told!r}")
    if part == "drive":
        return drive_problem(recording, model=told, without=without)
    return chamber_problem(recording, model=told, without=without)
