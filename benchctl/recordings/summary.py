"""What is in a recording, as `benchctl show` says it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from benchctl.recordings.model import StepInfo, axis_of
from benchctl.recordings.reader import Recording
from benchctl.recordings.schema import unit_of
from benchctl.recordings.verify import verify


def summarise(recording: Recording) -> dict[str, Any]:
    """The keys that `benchctl show --json` promises; reads all samples to check the digests.

    `status`; `steps` with `name`, `kind`, `role`, `whole`, `samples`, `t_start`, `t_end`, of a digital gyro also
    `frames_lost` and `frames_bad`, of a unit mounted across also `mounting`; `channels` with `name`, `unit` and
    `rate_hz` (None for what is polled); `provenance`; `digest_ok` (None where a recording has no digests yet);
    `problems`, in words.
    """
    problems = [str(problem) for problem in verify(recording.path)] if recording.digest else []
    return {
        "status": recording.meta.status,
        "steps": [_step(info) for info in recording.infos],
        "channels": _channels(recording),
        "provenance": dict(recording.meta.provenance),
        "digest_ok": not problems if recording.digest else None,
        "problems": [*recording.notes, *problems],
    }


def _step(info: StepInfo) -> dict[str, Any]:
    keys = ("index", "name", "kind", "role", "whole", "samples", "gaps", "t_start", "t_end", "chamber_setpoint_c")
    frames = {key: value for key in ("frames_lost", "frames_bad") if (value := getattr(info, key)) is not None}
    mounting = {"mounting": info.mounting} if info.mounting else {}
    return {key: getattr(info, key) for key in keys} | frames | mounting


def _channels(recording: Recording) -> list[dict[str, Any]]:
    """Every channel that any step has, in the order of their first appearance."""
    names = dict.fromkeys(name for info in recording.infos for name in recording.channels(info.index))
    rates_hz = {
        "time_s": _common(info.sample_rate_hz for info in recording.infos if info.samples),
        "frame_time_s": _common(info.frame_rate_hz for info in recording.infos if info.frame_rate_hz),
    }
    return [
        {
            "name": name,
            "unit": unit_of(name, recording.meta),
            "rate_hz": rates_hz.get(axis_of(name)),
        }
        for name in names
    ]


def _common(rates: Iterable[float | None]) -> float | None:
    """The rate of all steps, or None where they differ or do not say."""
    found = set(rates)
    return found.pop() if len(found) == 1 else None
