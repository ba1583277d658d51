"""Channels of a recording as one continuous series, for parts with few samples, and the pieces it is cut into.

A table's drive and a chamber are diagnosed on block means; the blocks are long enough to make their noise independent.
Such a recording often consists of one step: it is cut into pieces of time so that complete pieces can be held out.
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
"""Number of intervals that a sample may be late: chamber and servo are polled only once or twice a second.

Means and time-domain models bridge some missing samples; a soak that was not recorded lacks hundreds.
"""

_BYTES_A_ROW = 110
"""Measured peak memory [bytes] of a drive or chamber diagnosis per averaged sample."""

_UNITS = {
    "_nm": "N m",
    "_rad_s": "rad s-1",
    "_dps": "degree s-1",
    "_a": "A",
    "_percent": "percent",
    "_w": "W",
    "_c": "degC",
}
"""Name endings and the units that they require."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Series:
    """Samples in order of time, shape (n,): `step` is the index of a sample's step in `infos`; `runs` have no gaps.

    `columns` are the channels by name; a channel that only some steps have is NaN in the others.
    """

    infos: tuple[StepInfo, ...]
    time_s: FloatArray
    step: IntArray
    columns: dict[str, FloatArray]
    interval_s: float
    runs: tuple[slice, ...]


@dataclass(frozen=True, slots=True, kw_only=True)
class Pieces:
    """The steps of a problem: their `infos`, and for each row the index of its step, `step` of shape (n,)."""

    infos: tuple[StepInfo, ...]
    step: IntArray


def series_of(recording: Recording, needed: Sequence[str], further: Sequence[str] = (), *, polled: bool) -> Series:
    """Return the steps that have all channels `needed`; if `polled`, the polled channels under their plain names.

    Steps that an import's step list does not name, aborted attempts and manual actions are left out.

    Raises `UsageError` if no step has these channels, or if the samples do not fit into memory.
    """
    prefix = "poll_" if polled else ""
    left_out = {UNASSIGNED} if {info.kind for info in recording.infos} != {UNASSIGNED} else set()
    all_needed = {f"{prefix}{name}" for name in needed}
    kept = [info for info in recording.infos if info.kind not in left_out and not info.is_left_out]
    candidates = [(info, set(recording.channels(info.index))) for info in kept]
    holding = [(info, channels) for info, channels in candidates if all_needed <= channels]
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
    """Return, for times [s] of shape (n,), the time since the start of the joined recording that each belongs to."""
    starts_s = np.unique([0.0, *recording.starts_s])
    return np.asarray(time_s - starts_s[np.searchsorted(starts_s, time_s, side="right") - 1])


def _check_units(recording: Recording, names: Sequence[str]) -> None:
    """Raise `UsageError` if a channel is not in the unit that its name requires."""
    units = recording.meta.extra.get("channel_units", {})
    for name in names:
        expected = next((unit for ending, unit in _UNITS.items() if name.endswith(ending)), None)
        if expected is not None and units.get(name, expected) != expected:
            raise UsageError(
                f"{recording.path}: {name} is in {units[name]!r}, its name promises {expected!r}; say another unit or"
                " scale in the map file"
            )


def channels_of(recording: Recording) -> str:
    """Return the names of all channels of a recording, for a message."""
    return ", ".join(sorted(channel_names(recording))) or "none"


def channel_names(recording: Recording) -> set[str]:
    """Return the names of all channels of a recording."""
    return {name for info in recording.infos for name in recording.channels(info.index)}


def cut(infos: Sequence[StepInfo], step: IntArray, time_s: FloatArray) -> Pieces:
    """Return a recording's own steps if there are enough; otherwise cut each step into several pieces of time.

    `step` and `time_s`, shape (n,), are those of the rows; steps without rows are left out.
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
