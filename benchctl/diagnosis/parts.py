"""The parts of a bench that can be diagnosed, and the problem of each."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from benchctl.diagnosis.chamber.problem import chamber_problem
from benchctl.diagnosis.chamber.rows import AIR, DRIVES, SETPOINT
from benchctl.diagnosis.drive.problem import drive_problem
from benchctl.diagnosis.drive.rows import ANGLES, TORQUES
from benchctl.diagnosis.gyro.points import has_points, points_problem
from benchctl.diagnosis.gyro.problem import gyro_problem
from benchctl.diagnosis.result import Part
from benchctl.diagnosis.series import channel_names
from benchctl.diagnosis.stepped import PartProblem
from benchctl.recordings.reader import Recording
from benchctl_instruments.errors import UsageError


def part_of(recording: Recording) -> Part:
    """Return the part of the bench that a recording is of: without a gyro the drive or the chamber, else the gyro."""
    channels = channel_names(recording)
    if any(name.startswith(("gyro", "frame", "point")) for name in channels):
        return "gyro"
    if channels & {*ANGLES} and channels & {*TORQUES}:
        return "drive"
    return "chamber" if AIR in channels and channels & {SETPOINT, *DRIVES} else "gyro"


def problem_of(
    recording: Recording, part: Part, *, model: Mapping[str, Any] | None = None, without: Collection[str] = ()
) -> PartProblem:
    """Return the problem of a part of the bench for a recording and the lab's model.

    `model` is the table of a model file for the part: `[simulation]` for the gyro, `[parts.drive]`, `[parts.chamber]`.
    Without it, the gyro's model is that of the recording; the model of the drive or chamber is the recording's table of
    that name in `meta.extra`, or else is estimated from the recording.

    Raises `UsageError` if the recording lacks what the part requires, or if the model has a wrong field.
    """
    if part == "gyro" and has_points(recording):
        return points_problem(recording, model=model, without=without)
    if part == "gyro":
        return gyro_problem(recording, model=model, without=without)
    foreign = recording.meta.extra.get("foreign_keys", {}).get("recording", {})
    stated = model if model is not None else recording.meta.extra.get(part, foreign.get(part))
    if stated is not None and not isinstance(stated, Mapping):
        raise UsageError(f"{recording.path}: {part}: expected a table of numbers, got {stated!r}")
    if part == "drive":
        return drive_problem(recording, model=stated, without=without)
    return chamber_problem(recording, model=stated, without=without)
