"""Channels of a recording in one row after another, and what rows are made of them, for parts that have few samples.

A table's drive and a chamber are diagnosed on means over blocks of samples, so long that their noise is independent.
A recording of theirs is often one step: it is cut into pieces of time, so that whole pieces can be held out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchctl.limits import listed, require_memory
from benchctl.recordings.model import StepInfo
from benchctl.recordings.reader import Recording
from benchctl.recordings.runs import gap_free
from benchctl.recordings.step_entries import UNASSIGNED
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.errors import UsageError

_PIECES = 36
_FEWEST_IN_A_PIECE = 8
_LATE = 9.0
"""Intervals that a sample may come late: answers of a chamber or a servo that are asked for once or twice a second.

Means and models that run freely in time bridge some missing ones; a soak that nobody recorded is hundreds.
"""

_BYTES_A_ROW = 110
"""What a diagnosis of a drive or a chamber holds at its peak for each sample that it averages, measured."""

_UNITS = {
    "_nm": "N m",
    "_rad_s": "rad s-1",
    "_dps": "degree s-1",
    "_a": "A",
    "_percent": "percent",
    "_w": "W",
    "_c": "degC",
}
"""Endings of names, and the units that they promise."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """Samples in the order of time, shape (n,): `step` is the place of a sample's step in `infos`, `runs` have no gaps.

    `columns` are channels by name; one that only some steps have is NaN in the others.
    """

    infos: tuple[StepInfo, ...]
    time_s: FloatArray
    step: IntArray
    columns: dict[str, FloatArray]
    interval_s: float
    runs: tuple[slice, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pieces:
    """The steps of a problem: what each is (`infos`) and which row belongs to which, `step` of shape (n,)."""

    infos: tuple[StepInfo, ...]
    step: IntArray


def series_of(recording: Recording, needed: Sequence[str], further: Sequence[str] = (), *, polled: bool) -> Series:
    """The steps of a recording that have all channels `needed`; `polled` ones where asked, under their plain names.

    What an import's list of steps does not name is left out, and so are cut attempts and what a person did.

    Raises `UsageError` where no step has them, or this machine's memory does not hold the samples.
    """
    prefix = "poll_" if polled else ""
    left_out = {UNASSIGNED} if {info.kind for info in recording.infos} != {UNASSIGNED} else set()
    asked = {f"{prefix}{name}" for name in needed}
    kept = [info for info in recording.infos if info.kind not in left_out and not info.is_left_out]
    there = [(info, set(recording.channels(info.index))) for info in kept]
    holding = [(info, channels) for info, channels in there if asked <= channels]
    if not polled:
        rows = sum(info.samples for info, _ in holding)
        require_memory(recording.path, _BYTES_A_ROW * rows, f"all of {listed([*needed])} at once")
    found = []
    for info, channels in holding:
        names = [name for name in (*needed, *further) if f"{prefix}{name}" in channels]
        step = recording.step(info.index, (f"{prefix}time_s", *(f"{prefix}{name}" for name in names)))
        if step[f"{prefix}time_s"].size > 1:
            found.append((info, {name: step[f"{prefix}{name}"] for name in ("time_s", *names)}))
    if not found:
        raise UsageError(
            f"{recording.path}: no step has the channels {', '.join(needed)} together;"
            f" it has {channels_of(recording)}; an import names them in its map"
        )
    _check_units(recording, (*needed, *further))
    sizes = [columns["time_s"].size for _, columns in found]
    columns = {
        name: np.concatenate(
            [columns.get(name, np.full(size, np.nan)) for (_, columns), size in zip(found, sizes, strict=True)]
        )
        for name in ("time_s", *needed, *further)
    }
    time_s = columns.pop("time_s")
    interval_s = float(np.median(np.diff(time_s)))
    return Series(
        infos=tuple(info for info, _ in found),
        time_s=time_s,
        step=np.repeat(np.arange(len(found)), sizes),
        columns=columns,
        interval_s=interval_s,
        runs=tuple(gap_free(time_s, interval_s, _LATE)),
    )


def since_recorded_s(recording: Recording, time_s: FloatArray) -> FloatArray:
    """Times [s], shape (n,), since the recording began that each belongs to, where several were joined."""
    starts_s = np.unique([0.0, *recording.starts_s])
    return np.asarray(time_s - starts_s[np.searchsorted(starts_s, time_s, side="right") - 1])


def _check_units(recording: Recording, names: Sequence[str]) -> None:
    """Raise `UsageError` where a channel is not in the unit that its name promises."""
    units = recording.meta.extra.get("channel_units", {})
    for name in names:
        expected = next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), None)
        if expected is not None and units.get(name, expected) != expected:
            raise UsageError(
                f"{recording.path}: {name} is in {units[name]!r}, its name promises {expected!r}; say another unit or"
                " scale in the map file"
            )


def channels_of(recording: Recording) -> str:
    """The names of all channels of a recording, for a message."""
    names = {name for info in recording.infos for name in recording.channels(info.index)}
    return ", ".join(sorted(names)) or "none"


def cut(infos: Sequence[StepInfo], step: IntArray, time_s: FloatArray) -> Pieces:
    """A recording's own steps where there are a dozen; fewer are each cut into up to a dozen pieces of time.

    `step` and `time_s`, shape (n,), are those of the rows; steps without a row are left out.
    """
    pieces: list[StepInfo] = []
    place = np.zeros(step.size, np.int64)
    most = 1 if len(infos) >= _PIECES else _PIECES
    for index, info in enumerate(infos):
        rows = np.flatnonzero(step == index)
        parts = [part for part in np.array_split(rows, max(1, min(most, rows.size // _FEWEST_IN_A_PIECE))) if part.size]
        for number, part in enumerate(parts, start=1):
            place[part] = len(pieces)
            name = info.name if len(parts) == 1 else f"{info.name}, {number} of {len(parts)}"
            begin, end = float(time_s[part[0]]), float(time_s[part[-1]])
            pieces.append(replace(info, index=len(pieces), name=name, t_start=begin, t_end=end))
    return Pieces(infos=tuple(pieces), step=place)
