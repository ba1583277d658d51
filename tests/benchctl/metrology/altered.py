"""Recordings as they could have come instead: steps with other facts, without a channel, with other samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from benchctl.metrology.acceptance import measured_in
from benchctl.metrology.observations import Settings
from benchctl.metrology.result import Measured
from benchctl.plan import Step as Planned
from benchctl.recordings.model import Meta, Step, axis_of
from benchctl.recordings.reader import Recording, StepsInMemory
from tests.benchctl.metrology.made_unit import MadeUnit, recorded

Change = Callable[[Step], Step]


def altered(recording: Recording, change: Change, meta: Meta | None = None) -> Recording:
    """The same recording with every step changed."""
    steps = [change(step) for step in recording.steps()]
    infos = [step.info for step in steps]
    return Recording(recording.path, meta or recording.meta, infos, StepsInMemory(steps), digest=recording.digest)


def without(*channels: str, kind: str | None = None) -> Change:
    """Every step, or those of a kind, without some channels."""

    def change(step: Step) -> Step:
        if kind not in (None, step.info.kind):
            return step
        return Step(step.info, {name: held for name, held in step.channels.items() if name not in channels})

    return change


def nan_in(channel: str, kind: str) -> Change:
    """All steps of a kind with nothing but NaN in a channel."""

    def change(step: Step) -> Step:
        if step.info.kind != kind or channel not in step.channels:
            return step
        return Step(step.info, {**step.channels, channel: np.full_like(step[channel], np.nan)})

    return change


def with_line(amplitude_v: float, frequency_hz: float, kind: str) -> Change:
    """All steps of a kind with a line in the spectrum of the output."""

    def change(step: Step) -> Step:
        if step.info.kind != kind:
            return step
        line_v = amplitude_v * np.sin(2.0 * np.pi * frequency_hz * step[axis_of("gyro_v")])
        return Step(step.info, {**step.channels, "gyro_v": step["gyro_v"] + line_v})

    return change


def stating(**facts: object) -> Change:
    """Every step with other facts."""
    return lambda step: Step(replace(step.info, **facts), step.channels)  # type: ignore[arg-type]


def results(
    steps: Sequence[Planned],
    unit: MadeUnit,
    *,
    change: Change | None = None,
    settings: Settings | None = None,
    seed: int = 3,
) -> dict[str, Measured]:
    """What an acceptance measures of a made unit on a bench without errors, by the tests' names."""
    recording, _ = recorded(steps, unit, seed, errors=False)
    if change is not None:
        recording = altered(recording, change)
    return {one.name: one for one in measured_in(recording, settings or Settings())}
