"""A recording in memory of a few channels: what an import would have made of them."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.search.select import select
from benchctl.diagnosis.search.subsets import select_subset
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.fit import Point
from benchctl.recordings.model import BenchFacts, Meta, Step, StepInfo, Unit
from benchctl.recordings.reader import Recording
from benchctl.recordings.stored import StoredStep, stored_of
from benchctl_instruments.physics.effects.effect import DescribedEffect

FloatArray = npt.NDArray[np.float64]


class _Held:
    def __init__(self, step: Step) -> None:
        self._step = step

    def channels(self, index: int) -> tuple[str, ...]:
        return tuple(self._step.channels)

    def load(self, info: StepInfo, names: Collection[str] | None = None) -> Step:
        kept = self._step.channels if names is None else {name: self._step.channels[name] for name in names}
        return Step(info, kept)

    def stored(self, info: StepInfo) -> StoredStep:
        return stored_of(self.load(info))

    def close(self) -> None:
        pass


def recording_of(channels: Mapping[str, FloatArray], *, kind: str = "motion", **extra: Any) -> Recording:
    """One step "whole" of these channels (with `time_s`, or `poll_time_s`); `extra` goes to the recording's own."""
    time_s = channels.get("time_s", channels.get("poll_time_s"))
    assert time_s is not None
    info = StepInfo(
        index=1,
        name="whole",
        kind=kind,
        t_start=float(time_s[0]),
        t_end=float(time_s[-1]),
        chamber_setpoint_c=20.0,
        samples=time_s.size,
    )
    meta = Meta(
        status="imported",
        unit=Unit(serial="made", range_dps=0.0),
        bench=BenchFacts(sample_rate_hz=float(1.0 / np.median(np.diff(time_s)))),
        extra=extra,
    )
    return Recording(Path("made.h5"), meta, [info], _Held(Step(info, channels)))


def found_in(problem: PartProblem) -> dict[str, DescribedEffect]:
    """What the engine's selection adds to a problem's baseline, by identifier."""
    return {effect.identifier: effect for effect in model_found(problem).effects}


def model_found(problem: PartProblem) -> Point:
    """The model that the engine's selection ends with."""
    search = select_subset if problem.disturbed else select
    return search(problem, seed=0, progress=lambda _name, _share: None).after.point
