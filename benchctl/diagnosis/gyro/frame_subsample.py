"""A reduced frame for a first search: a few pieces of each stretch, more of a long one.

Effects that remember the temperature need the time in between: each piece starts after a pause that holds the
thermistor readings of the omitted rows.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from benchctl.diagnosis.gyro.frame import Frame
from benchctl.signals.temperature import Pause
from benchctl_instruments.arrays import IntArray

_ALONG = ("time_s", "step", "encoder_deg", "angle_deg", "rate_dps", "acceleration_dps2", "sudden", "volts")
_OF_AIR = ("temp_c", "temp_rate_c_per_s", "chamber_c")
_OF_MOTION = ("angle_deg", "rate_dps", "acceleration_dps2", "sudden")
_POINT_S, _MOST_POINTS = 1.0, 2000
"""Interval of the points of a pause, and their maximum number."""
_MOST_PIECES = 500
"""Maximum number of pieces: the work per piece exceeds that of its rows, and long campaigns have thousands of steps."""


def pieces_of(frame: Frame, length: int) -> list[tuple[int, slice]]:
    """Return stretch and rows of the pieces, each of `length` rows, or fewer if the step is shorter.

    Their number per stretch is half the square root of the number that would fit: for ten times the length, three times
    as many. If there are too many, a reproducible random sample is used; every other piece might turn the same way.
    """
    pieces = [
        (stretch, slice(first, min(first + length, rows.stop)))
        for stretch, part in enumerate(frame.stretches)
        for rows in _of_one_step(frame, part)
        for first in _begins(rows, length)
    ]
    if len(pieces) <= _MOST_PIECES:
        return pieces
    drawn = np.random.default_rng(0).choice(len(pieces), _MOST_PIECES, replace=False)
    return [pieces[place] for place in np.sort(drawn).tolist()]


def _of_one_step(frame: Frame, stretch: slice) -> Iterator[slice]:
    changes = stretch.start + 1 + np.flatnonzero(np.diff(frame.step[stretch]))
    for first, last in itertools.pairwise([stretch.start, *changes.tolist(), stretch.stop]):
        yield slice(first, last)


def _begins(rows: slice, length: int) -> Iterator[int]:
    """Yield the starts of the pieces of some rows, evenly spaced from the first row to the last."""
    spare = rows.stop - rows.start - length
    count = max(1, math.ceil(0.5 * math.sqrt((spare + length) / length)))
    for place in range(count):
        yield rows.start + (max(spare, 0) * place // (count - 1) if count > 1 else 0)


def thinned(frame: Frame, pieces: list[tuple[int, slice]]) -> tuple[Frame, IntArray]:
    """Return the frame of these pieces of one recording, in their order, and the indices of their rows, (m,)."""
    rows = np.concatenate([np.arange(piece.start, piece.stop) for _, piece in pieces])
    ends = np.cumsum([piece.stop - piece.start for _, piece in pieces]).tolist()
    stretches = tuple(slice(first, last) for first, last in zip([0, *ends[:-1]], ends, strict=True))
    taken: dict[str, Any] = {name: getattr(frame, name)[rows] for name in (*_ALONG, *_OF_AIR)}
    motions = []
    for (stretch, _), own in zip(pieces, stretches, strict=True):
        parts: dict[str, Any] = {name: taken[name][own] for name in _OF_MOTION}
        motions.append(replace(frame.motions[stretch], **parts))
    return (
        replace(
            frame,
            **taken,
            stretches=stretches,
            origins_s=tuple(frame.origins_s[stretch] for stretch, _ in pieces),
            motions=tuple(motions),
            auxiliary={name: values[rows] for name, values in frame.auxiliary.items()},
            pauses=tuple(_pauses(frame, pieces)),
            filled=None if frame.filled is None else frame.filled[rows],
        ),
        rows,
    )


def _pauses(frame: Frame, pieces: list[tuple[int, slice]]) -> Iterator[Pause | None]:
    """Yield the pause before each piece: the frame's own if no row was omitted, else interpolated from all rows."""
    known = [pause for pause in frame.pauses if pause is not None]
    time_s = np.concatenate([frame.time_s, *(pause.time_s for pause in known)])
    order = np.argsort(time_s, kind="stable")
    time_s = time_s[order]
    temp_c = np.concatenate([frame.temp_c, *(pause.temp_c for pause in known)])[order]
    rate = np.concatenate([frame.temp_rate_c_per_s, *(pause.temp_rate_c_per_s for pause in known)])[order]
    before: tuple[int, slice] | None = None
    for stretch, piece in pieces:
        begins = before is None or before[1].stop == piece.start
        if before is None or begins:
            yield frame.pauses[stretch] if frame.pauses and piece.start == frame.stretches[stretch].start else None
        else:
            from_s, to_s = float(frame.time_s[before[1].stop - 1]), float(frame.time_s[piece.start])
            count = min(_MOST_POINTS, max(int((to_s - from_s) / _POINT_S), 1))
            at_s = np.linspace(from_s, to_s, count + 1, endpoint=False)[1:]
            yield Pause(
                interval_s=(to_s - from_s) / (count + 1),
                time_s=at_s,
                temp_c=np.interp(at_s, time_s, temp_c),
                temp_rate_c_per_s=np.interp(at_s, time_s, rate),
            )
        before = stretch, piece
