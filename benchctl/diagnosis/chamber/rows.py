"""A recording of a chamber laid out for a diagnosis: what drives the air, and how far the air moves in equal times.

What a simulation of the air leaves out acts on its warming, not on its temperature: a draught is felt long after it is
gone. Residuals of a temperature are therefore correlated over all of a time constant, and any smooth term would seem
to fit them; those of its increments are nearly independent. Rows are increments, over times in which the air typically
moves by two steps of its thermometer, so that these steps do not count for more than the air.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.signals.series import Pieces, Series, block_mean, channels_of, consecutive, cut, series_of
from benchctl.recordings.reader import Recording
from instruments.errors import UsageError
from instruments.physics.chamber_effects.effect import Drive

FloatArray = npt.NDArray[np.float64]

_AIR, _SETPOINT, _ROOM = "chamber_temp_c", "chamber_setpoint_c", "ambient_temp_c"
DRIVES = {"heater_percent": "percent", "heater_w": "W", "current_a": "A"}
"""Channels of power, in the order in which they are looked for, and their units."""

_MOST_SAMPLES = 6000
_FEWEST_ROWS, _MOST_ROWS = 60, 2000
_STEPS_A_ROW = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class ChamberRows:
    """Samples of shape (n,), equidistant within `runs`; rows of shape (m,), within `stretches`.

    A row is the step from the mean of one block of `block` samples to that of the next, `increment_c` [K]; the first of
    a run from its first sample, with which a simulation begins, so that their sums are temperatures again.
    `room_c` is NaN where it was not measured. `time_s` is that of the rows.
    """

    infos_of_rows: Pieces
    kind: Drive
    channel: str
    interval_s: float
    block: int
    runs: tuple[slice, ...]
    run_s: FloatArray
    air_c: FloatArray
    drive: FloatArray
    room_c: FloatArray
    stretches: tuple[slice, ...]
    time_s: FloatArray
    increment_c: FloatArray

    def increments(self, samples: FloatArray) -> FloatArray:
        """Values of the samples (n,) as increments from row to row, (m,)."""
        return np.concatenate([_increments(samples[run], self.block) for run in self.runs])

    def means(self, samples: FloatArray) -> FloatArray:
        """Values of the samples (n,) as means over a row's block, (m,)."""
        return np.concatenate([block_mean(samples[run], self.block) for run in self.runs])


def _increments(samples: FloatArray, block: int) -> FloatArray:
    return np.diff(block_mean(samples, block), prepend=samples[0])


def chamber_rows_of(recording: Recording) -> ChamberRows:
    """Read a recording of a chamber: `chamber_temp_c` with a power (`DRIVES`) or with `chamber_setpoint_c`.

    Raises `UsageError` where the air or what drives it is missing, does not change, or the recording is too short.
    """
    series, channel = _series(recording)
    factor = max(1, -(-series.time_s.size // _MOST_SAMPLES))
    grids = [_grid(series, run, channel, factor) for run in series.runs if run.stop - run.start > 2 * factor]
    if not grids:
        raise UsageError(
            f"{recording.path}: no two readings of the chamber follow each other within ten intervals; "
            "record it evenly, without gaps"
        )
    if all(float(np.ptp(grid[1])) == 0.0 for grid in grids):
        raise UsageError(
            f"{recording.path}: the air never changes; record steps of its set point or power, or name "
            "another column in the import's map"
        )
    block = _block([grid[1] for grid in grids], series.columns[_AIR])
    grids = [grid for grid in grids if grid[0].size >= 2 * block]
    rows = sum(grid[0].size // block for grid in grids)
    if rows < _FEWEST_ROWS:
        raise UsageError(
            f"{recording.path}: the air moves by two steps of its thermometer {rows} times only;"
            f" a diagnosis of a chamber needs {_FEWEST_ROWS} or more"
        )
    interval_s = factor * series.interval_s
    time_s = np.concatenate([block_mean(grid[0], block) for grid in grids])
    step = np.concatenate([grid[4][: grid[4].size // block * block : block] for grid in grids])
    sizes = [grid[0].size // block * block for grid in grids]
    samples = [np.concatenate([grid[i][:size] for grid, size in zip(grids, sizes, strict=True)]) for i in (1, 2, 3)]
    if float(np.ptp(samples[1])) == 0.0 and channel == _SETPOINT:
        raise UsageError(
            f"{recording.path}: the set point never changes, and so the air has nothing to follow; record steps of it"
        )
    return ChamberRows(
        infos_of_rows=cut(series.infos, step.astype(np.int64), time_s),
        kind="setpoint" if channel == _SETPOINT else "power",
        channel=channel,
        interval_s=interval_s,
        block=block,
        runs=consecutive(sizes),
        run_s=np.concatenate([np.arange(size) * interval_s for size in sizes]),
        air_c=samples[0],
        drive=samples[1],
        room_c=samples[2],
        stretches=consecutive([size // block for size in sizes]),
        time_s=time_s,
        increment_c=np.concatenate([_increments(grid[1], block) for grid in grids]),
    )


def _series(recording: Recording) -> tuple[Series, str]:
    """The samples with the first power, or else the set point, that lies on one time axis with the air."""
    for polled, channel in [(False, name) for name in (*DRIVES, _SETPOINT)] + [(True, _SETPOINT)]:
        prefix = "poll_" if polled else ""
        for info in recording.infos:
            if {f"{prefix}{_AIR}", f"{prefix}{channel}"} <= set(recording.channels(info.index)):
                return series_of(recording, (_AIR, channel), (_ROOM,), polled=polled), channel
    raise UsageError(
        f"{recording.path}: a chamber needs {_AIR} together with one of {', '.join(DRIVES)} or {_SETPOINT};"
        f" it has {channels_of(recording)}; an import names them in its map"
    )


def _grid(series: Series, run: slice, channel: str, factor: int) -> tuple[FloatArray, ...]:
    """Time, air, drive, room and step of a run at equal intervals, each of shape (n,), means over `factor` samples."""
    time_s = series.time_s[run]
    even = time_s[0] + np.arange(int((time_s[-1] - time_s[0]) / series.interval_s + 1e-6) + 1) * series.interval_s
    near = np.clip(np.searchsorted(time_s, even + series.interval_s / 2) - 1, 0, time_s.size - 1)
    air, room = (np.interp(even, time_s, series.columns[name][run]) for name in (_AIR, _ROOM))
    values = (even, air, series.columns[channel][run][near], room)
    step = series.step[run][near].astype(np.float64)
    return (*(block_mean(one, factor) for one in values), step[: even.size // factor * factor : factor])


def _block(runs: list[FloatArray], read_c: FloatArray) -> int:
    """How many samples make a row: the air then typically moves by two of its thermometer's steps."""
    total = sum(run.size for run in runs)
    moved = np.abs(np.diff(read_c))
    quantum = float(moved[moved > 0.0].min()) if (moved > 0.0).any() else 0.0
    block = max(1, total // _MOST_ROWS)
    while block < total // _FEWEST_ROWS:
        moved = np.concatenate([np.abs(np.diff(block_mean(run, block))) for run in runs if run.size >= 2 * block])
        if quantum > 0.0 and float(np.median(moved)) >= _STEPS_A_ROW * quantum:
            break
        block += max(1, block // 4)
    return block
