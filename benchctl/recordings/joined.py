"""Several recordings of one unit read as one."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

from benchctl.recordings.model import AXES, Step, StepInfo
from benchctl.recordings.reader import Recording
from benchctl.recordings.stored import StoredStep
from benchctl_instruments.errors import UsageError

APART_S = 86400.0
"""Recordings that are read as one are put a day apart: the bias has walked freely in between."""


def join(recordings: Sequence[Recording]) -> Recording:
    """One recording of the steps of all, numbered on, on one time axis; what describes it is that of the first.

    It closes none of them. Raises `UsageError` where they are of different units.
    """
    serials = sorted({recording.meta.unit.serial for recording in recordings})
    if len(serials) > 1:
        raise UsageError(f"these recordings are of different units: {', '.join(serials)}; take each by itself")
    first, *others = recordings
    if not others:
        return first
    infos: list[StepInfo] = []
    origins: dict[int, tuple[Recording, StepInfo]] = {}
    shift_s, starts_s = 0.0, list[float]()
    for recording in recordings:
        starts_s += [shift_s + start_s for start_s in recording.starts_s]
        before = max((info.index for info in infos), default=0)
        for info in recording.infos:
            moved = _moved(info, before, shift_s) if before else info
            infos.append(moved)
            origins[moved.index] = (recording, info)
        shift_s = max((info.t_end for info in infos), default=0.0) + APART_S
    notes = tuple(note for recording in recordings for note in recording.notes)
    return Recording(first.path, first.meta, infos, _Joined(origins), notes=notes, starts_s=tuple(starts_s))


def _moved(info: StepInfo, before: int, shift_s: float) -> StepInfo:
    return replace(info, index=before + info.index, t_start=info.t_start + shift_s, t_end=info.t_end + shift_s)


class _Joined:
    """Steps that are fetched from where they are, and moved in time."""

    def __init__(self, origins: dict[int, tuple[Recording, StepInfo]]) -> None:
        self._origins = origins

    def channels(self, index: int) -> tuple[str, ...]:
        recording, origin = self._origins[index]
        return recording.channels(origin.index)

    def load(self, info: StepInfo, names: Collection[str] | None = None) -> Step:
        recording, origin = self._origins[info.index]
        step = recording.step(origin.index, names)
        shift_s = info.t_start - origin.t_start
        if not shift_s:
            return Step(info, step.channels)
        return Step(info, {n: samples + shift_s if n in AXES else samples for n, samples in step.channels.items()})

    def stored(self, info: StepInfo) -> StoredStep:
        recording, origin = self._origins[info.index]
        return recording.stored_step(origin.index).of(info, info.t_start - origin.t_start)

    def close(self) -> None:
        """They are closed by who opened them."""
