"""A recording's frame with fewer rows, for a first look: a few pieces of a stretch, more of a long one.

What happened in between is known to whatever remembers the temperature: each piece begins behind a pause in which the
thermistor did what it did in the rows that were left out.
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
"""Between two points of a pause, and how many it has at most."""
_MOST_PIECES = 500
"""What has to be done for each piece takes longer than its rows; a campaign of weeks has thousands of steps."""


def pieces_of(frame: Frame, length: int) -> list[tuple[int, slice]]:
    """Stretch and rows of the pieces, each of `length` rows or all that a step has in a stretch.

    They are half as many as the root of what there is room for: ten times as long, three times as many. Of too many
    some are taken by lot, always the same: every other one might be all that turn to the left.
    """
    pieces = [
        (stretch, slice(first, min(first + length, rows.stop)))
        for stretch, whole in enumerate(frame.stretches)
        for rows in _of_one_step(frame, whole)
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
    """Where the pieces of some rows begin: evenly, from the first row on to the last."""
    spare = rows.stop - rows.start - length
    count = max(1, math.ceil(0.5 * math.sqrt((spare + length) / length)))
    for place in range(count):
        yield rows.start + (max(spare, 0) * place // (count - 1) if count > 1 else 0)


def thinned(frame: Frame, pieces: list[tuple[int, slice]]) -> tuple[Frame, IntArray]:
    """The frame of these pieces of its stretches, of one recording, in their order, and which rows they are, (m,)."""
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
    """The pause before each piece: the frame's own where no row was left out, else what all its rows know of it."""
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
