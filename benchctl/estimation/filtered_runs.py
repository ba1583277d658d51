"""A chain of second-order sections over run after run of rows, whose state goes on through the pauses between them.

A call for each run costs more than its rows do where there are thousands of short ones. The filter is linear: runs of
one length are filtered together as if each began at rest, and what the state before it puts out is added to each.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy.signal

from benchctl_instruments.arrays import FloatArray

_ALIKE = 4
"""So many runs of one length are worth it: what a state puts out in them takes a call of its own."""
_TOGETHER = 1 << 18
"""So many rows of a column are filtered at once: more would only take memory."""


def filtered(
    sections: FloatArray, values: FloatArray, runs: Sequence[slice], carried: Sequence[FloatArray]
) -> FloatArray:
    """Values (k, n) through sections (m, 6), run by run; 0 outside of them.

    `carried` is what becomes of the filter's state, shape (2·m, 2·m), in the pause before each run.
    """
    white = np.zeros_like(values)
    free: dict[int, tuple[FloatArray, FloatArray]] = {}
    ends: dict[int, FloatArray] = {}
    for length, alike in _of_one_length(runs):
        if length not in free:
            free[length] = _free(sections, length)
        passed, states = _passed(sections, np.stack([values[:, runs[i]] for i in alike], axis=1))
        for place, i in enumerate(alike):
            white[:, runs[i]] = passed[:, place]
            ends[i] = states[:, :, place]
    state = np.zeros((2 * len(sections), len(values)))
    for i, (rows, through) in enumerate(zip(runs, carried, strict=True)):
        state = through @ state
        if i in ends:
            response, onward = free[rows.stop - rows.start]
            white[:, rows] += (response @ state).T
            state = onward @ state + ends[i]
        else:
            white[:, rows], state = _passed(sections, values[:, rows], state)
    return white


def without_innovations(sections: FloatArray) -> FloatArray:
    """What a step that puts nothing out makes of the state of a chain of sections, shape (2·m, 2·m).

    What enters each section then follows from its state alone.
    """
    columns = []
    for state in np.eye(2 * len(sections)):
        left, after = 0.0, np.empty((len(sections), 2))
        for k in range(len(sections) - 1, -1, -1):
            _, b1, b2, _, a1, a2 = sections[k]
            entered = left - state[2 * k]
            after[k] = b1 * entered - a1 * left + state[2 * k + 1], b2 * entered - a2 * left
            left = entered
        columns.append(after.ravel())
    return np.stack(columns, axis=1)


def _of_one_length(runs: Sequence[slice]) -> Iterator[tuple[int, list[int]]]:
    """The places of runs of which there are several of one length, by that length; not too many rows at once."""
    places: dict[int, list[int]] = {}
    for i, rows in enumerate(runs):
        places.setdefault(rows.stop - rows.start, []).append(i)
    for length, alike in places.items():
        many = max(_TOGETHER // length, _ALIKE)
        for first in range(0, len(alike) if len(alike) >= _ALIKE else 0, many):
            yield length, alike[first : first + many]


def _free(sections: FloatArray, length: int) -> tuple[FloatArray, FloatArray]:
    """What each state puts out in so many rows in which nothing enters, shape (length, 2·m), and what becomes of it."""
    states = np.eye(2 * len(sections))
    response, onward = _passed(sections, np.zeros((len(states), length)), states)
    return response.T, onward


def _passed(sections: FloatArray, values: FloatArray, state: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
    """Values (k, …, n) through sections that begin in a state, shape (2·m, k, …), or at rest; that at the end, too."""
    count, others = len(sections), values.shape[:-1]
    begun = np.zeros((2 * count, *others)) if state is None else state
    passed, ended = scipy.signal.sosfilt(sections, values, zi=np.moveaxis(begun.reshape(count, 2, *others), 1, -1))
    return passed, np.moveaxis(ended, -1, 1).reshape(2 * count, *others)
