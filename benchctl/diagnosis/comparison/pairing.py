"""Pairs for a comparison: a recording with its predictions, or with another recording of the same procedure.

Two recordings of one procedure never move exactly alike: a sine starts with another phase, a rate is reached slightly
earlier. Steps are paired by name and order and aligned by the encoder's rate; the remaining difference of the motions
is corrected with the scale factor. What remains is the difference of the gyros.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.signal import correlate

from benchctl.diagnosis.comparison.parting import ComparedStep
from benchctl.diagnosis.gyro.frame import Frame
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.errors import UsageError

_LEAST_OVERLAP = 0.5
_AS_GOOD = 0.01
"""Share of the motion's mean square by which an alignment may be worse than the best and still be accepted."""

_MOVING_DPS = 0.5
"""Spread of the rate below which a step has no shape for an alignment."""


def with_predictions(frame: Frame, predictions: Mapping[str, FloatArray]) -> list[ComparedStep]:
    """Return the steps of a recording with the outputs predicted by models: name -> array (n,) on the frame's rows."""
    return [
        ComparedStep(
            name=frame.infos[index].name,
            kind=frame.infos[index].kind,
            time_s=frame.time_s[rows],
            measured_v=frame.volts[rows],
            simulated_v={name: volts[rows] for name, volts in predictions.items()},
            coordinates=_coordinates(frame, rows),
        )
        for index, rows in _rows_of_steps(frame)
    ]


def with_recording(measured: Frame, simulated: Frame, name: str) -> tuple[list[ComparedStep], list[str]]:
    """Return the steps that two recordings share, and sentences about those that only one of them has.

    Raises `UsageError` if they share none.
    """
    theirs = _by_label(simulated)
    scale = _scale(simulated)
    steps, alone = [], []
    for index, rows in _rows_of_steps(measured):
        label = _label(measured, index)
        if not theirs[label]:
            alone.append(f"only in the real one: {label[1]}")
            continue
        rows, partner = _overlay(measured, rows, simulated, theirs[label].pop(0))
        moved = scale * (measured.rate_dps[rows] - simulated.rate_dps[partner])
        steps.append(
            ComparedStep(
                name=label[1],
                kind=label[0],
                time_s=measured.time_s[rows],
                measured_v=measured.volts[rows],
                simulated_v={name: simulated.volts[partner] + moved},
                coordinates=_coordinates(measured, rows),
            )
        )
    alone += [f"only in the simulated one: {label[1]}" for label, left in theirs.items() for _ in left]
    if not steps:
        raise UsageError(
            f"these recordings share no step: one has {_some(measured)}, the other {_some(simulated)}; "
            "compare takes two recordings of one procedure"
        )
    return steps, alone


def _rows_of_steps(frame: Frame) -> Iterator[tuple[int, slice]]:
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(frame.step)) + 1, [frame.rows]])
    for first, last in pairwise(bounds):
        yield int(frame.step[first]), slice(int(first), int(last))


def _label(frame: Frame, index: int) -> tuple[str, str]:
    return frame.infos[index].kind, frame.infos[index].name


def _by_label(frame: Frame) -> dict[tuple[str, str], list[slice]]:
    found: dict[tuple[str, str], list[slice]] = defaultdict(list)
    for index, rows in _rows_of_steps(frame):
        found[_label(frame, index)].append(rows)
    return found


def _scale(frame: Frame) -> float:
    """Return volts per °/s, accurate enough to correct small differences of motion."""
    rate = frame.rate_dps - frame.rate_dps.mean()
    return float(rate @ frame.volts / (rate @ rate)) if np.ptp(frame.rate_dps) > _MOVING_DPS else 0.0


def _overlay(measured: Frame, rows: slice, simulated: Frame, partner: slice) -> tuple[slice, npt.NDArray[np.int64]]:
    """Return the rows of a step that its partner overlaps, and the partner's matching rows."""
    ours, theirs = measured.rate_dps[rows], simulated.rate_dps[partner]
    ratio = measured.interval_s / simulated.interval_s
    on_our_grid = np.interp(np.arange(int((theirs.size - 1) / ratio) + 1) * ratio, np.arange(theirs.size), theirs)
    lag = _lag(ours, on_our_grid)
    first, last = max(0, -lag), min(ours.size, on_our_grid.size - lag)
    place = np.round((np.arange(first, last) + lag) * ratio).astype(np.int64)
    return slice(rows.start + first, rows.start + last), partner.start + np.minimum(place, theirs.size - 1)


def _lag(ours: FloatArray, theirs: FloatArray) -> int:
    """Return the number of samples by which the other motion must be delayed; 0 if there is no motion to align.

    Of several equally good alignments of a periodic motion, the smallest delay is used, as other quantities also change
    along a step.
    """
    if min(np.ptp(ours), np.ptp(theirs)) < _MOVING_DPS:
        return 0
    lags = np.arange(-(ours.size - 1), theirs.size)
    overlap = np.minimum(ours.size, theirs.size - lags) - np.maximum(0, -lags)
    # mean square of the difference, from three running sums
    squares = [np.concatenate([[0.0], np.cumsum(x**2)]) for x in (ours, theirs)]
    first = np.maximum(0, -lags)
    power = (
        squares[0][first + overlap] - squares[0][first] + squares[1][first + overlap + lags] - squares[1][first + lags]
    )
    off = (power - 2 * correlate(theirs, ours, mode="full", method="fft")) / overlap
    allowed = overlap >= _LEAST_OVERLAP * min(ours.size, theirs.size)
    lags, off = lags[allowed], off[allowed]
    good = off <= off.min() + _AS_GOOD * float(np.mean(ours**2))
    dips = np.flatnonzero(good & (off <= np.roll(off, 1)) & (off <= np.roll(off, -1)))
    return int(lags[dips[np.argmin(np.abs(lags[dips]))]])


def _coordinates(frame: Frame, rows: slice) -> dict[str, FloatArray]:
    return {
        "time": frame.time_s[rows],
        "rate": frame.rate_dps[rows],
        "acceleration": frame.acceleration_dps2[rows],
        "angle": np.mod(frame.angle_deg[rows], 360.0),
        "gyro_temp": frame.temp_c[rows],
        "output": frame.volts[rows],
    }


def _some(frame: Frame) -> str:
    names: Sequence[str] = [info.name for info in frame.infos]
    return ", ".join(names[:3]) + (", …" if len(names) > 3 else "")
