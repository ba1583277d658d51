"""A chamber's recording as rows for a diagnosis: the drive and the resulting air temperature.

Rows are thermometer readings, or means over a few if there are very many. A simulation runs from the first row without
feedback, so that its errors are those a user of the model would have.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchctl.diagnosis.chamber.spoilt import open_in, spikes_in, wrapped_in
from benchctl.diagnosis.chamber.standing import rail_in
from benchctl.diagnosis.faults.fault import Fault
from benchctl.diagnosis.series import Pieces, Series, channels_of, cut, series_of, since_recorded_s
from benchctl.recordings.reader import Recording
from benchctl.signals.blocks import block_mean, consecutive
from benchctl_instruments.arrays import BoolArray, FloatArray
from benchctl_instruments.errors import UsageError
from benchctl_instruments.physics.chamber_effects.effect import Drive

AIR, SETPOINT, _ROOM = "chamber_temp_c", "chamber_setpoint_c", "ambient_temp_c"
_SECOND, _OPEN = "second_temp_c", "chamber_temp_open"
DRIVES = {"heater_percent": "percent", "heater_w": "W", "current_a": "A"}
"""Channels of power, in order of preference, with their units."""

_MOST_SAMPLES = 6000
_FEWEST_ROWS, _MOST_ROWS = 60, 2000
_NEAR = 0.75
"""Maximum distance of a reading from the instant that it represents, in intervals."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ChamberRows:
    """Samples of shape (n,), equidistant within `runs`; rows of shape (m,), within `stretches`.

    A row is the mean over a block of `block` samples. `room_c` and `second_c`, the temperature of a second body, are
    NaN where they were not measured. `clock_s` is the time of the samples since the start of the recording that they
    belong to, `time_s` the time of the rows; `usable` marks rows that were read and are not spoilt. `step_c` is the
    thermometer's step, 0 if none is visible. `faults` are the faults of the data, with rows (m,).
    """

    infos_of_rows: Pieces
    kind: Drive
    channel: str
    interval_s: float
    block: int
    runs: tuple[slice, ...]
    run_s: FloatArray
    clock_s: FloatArray
    air_c: FloatArray
    drive: FloatArray
    room_c: FloatArray
    second_c: FloatArray
    stretches: tuple[slice, ...]
    time_s: FloatArray
    temperature_c: FloatArray
    usable: BoolArray
    step_c: float
    faults: tuple[Fault, ...]

    def means(self, samples: FloatArray) -> FloatArray:
        """Return the means of samples (n,) over each row's block, (m,)."""
        return samples if self.block == 1 else block_mean(samples, self.block)


def chamber_rows_of(recording: Recording) -> ChamberRows:
    """Read a recording of a chamber: `chamber_temp_c` with a power (`DRIVES`) or with `chamber_setpoint_c`.

    Raises `UsageError` if the air or its drive is missing or constant, or if the recording is too short.
    """
    series, channel = _series(recording)
    step_c = _step_of(series.columns[AIR])
    shown, spoilt = _spoilt_in(series, channel, step_c)
    factor = max(1, -(-series.time_s.size // _MOST_SAMPLES))
    laid = [_grid(series, run, channel, factor, spoilt) for run in series.runs if run.stop - run.start > 2 * factor]
    grids = [grid for grid in laid if grid is not None]
    if not grids:
        raise UsageError(
            f"{recording.path}: no two readings of the chamber follow each other within ten intervals; "
            "record it evenly, without gaps"
        )
    if all(float(np.ptp(grid.columns[0])) == 0.0 for grid in grids):
        raise UsageError(
            f"{recording.path}: the air never changes; record steps of its set point or power, or name "
            "another column in the import's map"
        )
    block = -(-sum(grid.time_s.size for grid in grids) // _MOST_ROWS)
    sizes = [grid.time_s.size // block * block for grid in grids]
    time_s, step, bad, of_row = (
        np.concatenate([one[:size] for one, size in zip(ones, sizes, strict=True)])
        for ones in (
            [grid.time_s for grid in grids],
            [grid.step for grid in grids],
            [grid.bad for grid in grids],
            [grid.nearest for grid in grids],
        )
    )
    samples = [
        np.concatenate([grid.columns[i][:size] for grid, size in zip(grids, sizes, strict=True)]) for i in range(4)
    ]
    if float(np.ptp(samples[1])) == 0.0 and channel == SETPOINT:
        raise UsageError(
            f"{recording.path}: the set point never changes, and so the air has nothing to follow; record steps of it"
        )

    def in_rows(samples: BoolArray) -> BoolArray:
        return np.asarray(samples.reshape(-1, block).any(axis=1))

    usable = ~in_rows(bad > 0.0)
    if int(usable.sum()) < _FEWEST_ROWS:
        raise UsageError(
            f"{recording.path}: {int(usable.sum())} readings of the chamber's air; a diagnosis of a chamber needs"
            f" {_FEWEST_ROWS} or more"
        )
    interval_s = factor * series.interval_s
    row_s = block_mean(time_s, block)
    return ChamberRows(
        infos_of_rows=cut(series.infos, step[::block].astype(np.int64), row_s),
        kind="setpoint" if channel == SETPOINT else "power",
        channel=channel,
        interval_s=interval_s,
        block=block,
        runs=consecutive(sizes),
        run_s=np.concatenate([np.arange(size) * interval_s for size in sizes]),
        clock_s=since_recorded_s(recording, time_s),
        air_c=samples[0],
        drive=samples[1],
        room_c=samples[2],
        second_c=samples[3],
        stretches=consecutive([size // block for size in sizes]),
        time_s=row_s,
        temperature_c=block_mean(samples[0], block),
        usable=usable,
        step_c=step_c,
        faults=tuple(
            one.on_rows(in_rows(its_rows[of_row.astype(np.int64)])) for one, its_rows in shown if one is not None
        ),
    )


def _series(recording: Recording) -> tuple[Series, str]:
    """Return the samples with the first power, or else the set point, that has the same time axis as the air."""
    for polled, channel in [(False, name) for name in (*DRIVES, SETPOINT)] + [(True, SETPOINT)]:
        prefix = "poll_" if polled else ""
        for info in recording.infos:
            if {f"{prefix}{AIR}", f"{prefix}{channel}"} <= set(recording.channels(info.index)):
                return series_of(recording, (AIR, channel), (_ROOM, _SECOND, _OPEN), polled=polled), channel
    raise UsageError(
        f"{recording.path}: a chamber needs {AIR} together with one of {', '.join(DRIVES)} or {SETPOINT};"
        f" it has {channels_of(recording)}; an import names them in its map"
    )


def _spoilt_in(series: Series, channel: str, step_c: float) -> tuple[list[tuple[Fault | None, BoolArray]], BoolArray]:
    """Return the thermometer's faults with their rows (n,), and all rows (n,) that are spoilt or missing.

    Each kind is searched in the rows that the previous ones have left.
    """
    read_c = series.columns[AIR]
    opened = open_in(series.columns[_OPEN])
    spoilt = opened[1] | ~np.isfinite(read_c)
    wrapped = wrapped_in(read_c, spoilt, step_c)
    spoilt |= wrapped[1]
    spikes = spikes_in(read_c, spoilt, step_c, series.runs)
    spoilt |= spikes[1]
    rail = rail_in(read_c, spoilt, series.columns[channel], step_c, series.runs, asked=channel == SETPOINT)
    return [opened, wrapped, spikes, rail], spoilt | rail[1]


@dataclass(frozen=True, slots=True, kw_only=True)
class _Grid:
    """A run at equal intervals, each of shape (n,): `columns` are air, drive, room and second temperature.

    `bad` is above 0 where a reading is spoilt or missing; `nearest` is the index of the reading that represents an
    instant.
    """

    time_s: FloatArray
    columns: tuple[FloatArray, ...]
    step: FloatArray
    bad: FloatArray
    nearest: FloatArray


def _grid(series: Series, run: slice, channel: str, factor: int, spoilt: BoolArray) -> _Grid | None:
    """Return a run at equal intervals, as means over `factor` samples; None if none of its readings is usable."""
    time_s, bad = series.time_s[run], spoilt[run]
    if bad.all():
        return None
    even = time_s[0] + np.arange(int((time_s[-1] - time_s[0]) / series.interval_s + 1e-6) + 1) * series.interval_s
    near = np.clip(np.searchsorted(time_s, even + series.interval_s / 2) - 1, 0, time_s.size - 1)
    air = np.interp(even, time_s[~bad], series.columns[AIR][run][~bad])
    room, second = (np.interp(even, time_s, series.columns[name][run]) for name in (_ROOM, _SECOND))
    missing = np.abs(time_s[near] - even) > _NEAR * series.interval_s
    values = (air, series.columns[channel][run][near], room, second)
    first = slice(None, even.size // factor * factor, factor)
    return _Grid(
        time_s=block_mean(even, factor),
        columns=tuple(block_mean(one, factor) for one in values),
        step=series.step[run][near].astype(np.float64)[first],
        bad=block_mean((bad[near] | missing).astype(np.float64), factor),
        nearest=(run.start + near).astype(np.float64)[first],
    )


def _step_of(read_c: FloatArray) -> float:
    """Return the smallest step [K] between two readings; 0 if they are constant."""
    moved = np.abs(np.diff(read_c[np.isfinite(read_c)]))
    moved = moved[moved > 1e-9]
    return float(moved.min()) if moved.size else 0.0
