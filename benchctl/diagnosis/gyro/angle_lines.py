"""Lines of angle: whether a signal that repeats with the shaft's angle is true motion or an error of a sensor.

A stepper shakes its shaft at every step, a motor cogs. Both sensors measure such motion with the same amplitude and
phase. An error of the encoder's marks appears only in the rate computed from them; an error of the gyro appears only in
its output. So the two signals are compared directly, without any model.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from benchctl.signals.binning import line_scores
from benchctl_instruments.arrays import BoolArray, ComplexArray, FloatArray

_LOWEST, _HIGHEST = 9, 400
"""Range of orders per turn; a lower order is not distinguishable from the sweep of the motion itself."""

_PIECES = 12
_FEWEST_ROWS = 200
_SLOW_S, _STEADY = 0.5, 0.3
"""Averaging time of the rate, and its maximum relative deviation from the median rate for rows that are used."""

_AROUND = 31
_STANDS_OUT = 10.0
"""Minimum power relative to neighbouring orders for a line of angle; less may be the shape of the motion."""

_SKIRT = 3
_MOST = 3
_BOTH, _ALONE = 0.9, 0.3
"""Coherence above which both sensors measure the same motion, and up to which they have nothing in common."""


def lines_of_angle(
    *, angle_deg: FloatArray, rate_dps: FloatArray, felt: FloatArray, rows: BoolArray, interval_s: float
) -> tuple[str, ...]:
    """Return sentences that attribute the strongest lines to motion, encoder or gyro; empty if there are none.

    `angle_deg` is the encoder's angle, unwrapped, `rate_dps` the table's rate, `felt` the rate measured by the gyro
    [deg/s], `rows` a mask of the rows to use; all of shape (n,).
    """
    measured = np.diff(angle_deg, append=angle_deg[-1]) / interval_s
    if not rows.any():
        return ()
    usual = float(np.median(np.abs(rate_dps[rows])))
    slow = uniform_filter1d(rate_dps, max(1, round(_SLOW_S / interval_s)))
    pairs = []
    for sense in (-1.0, 1.0):
        # a reversal is not a line, but it adds power at every order
        turning = np.flatnonzero(rows & (np.abs(slow - sense * usual) < _STEADY * usual))
        scores = [
            np.array([_score(values[part] - sense * usual, angle_deg[part]) for values in (measured, felt)])
            for part in np.array_split(turning, _PIECES)
            if part.size > _FEWEST_ROWS
        ]
        if scores:
            pairs.append(np.array(scores))
    return tuple(_sentences(pairs, usual, interval_s)) if pairs else ()


def _score(values: FloatArray, angle_deg: FloatArray) -> ComplexArray:
    return line_scores(values - values.mean(), angle_deg, _HIGHEST)[_LOWEST:]


def _sentences(pairs: list[ComplexArray], usual_dps: float, interval_s: float) -> Iterator[str]:
    """Yield sentences from scores of shape (pieces, 2, orders), one array per direction, as delays rotate phases."""
    measured, felt = (sum(np.sum(np.abs(one[:, i]) ** 2, axis=0) for one in pairs) for i in (0, 1))
    cross = sum(np.abs(np.sum(np.conj(one[:, 0]) * one[:, 1], axis=0)) for one in pairs)
    excess = [power / np.maximum(median_filter(power, _AROUND), 1e-300) for power in (measured, felt)]
    sampled = (np.arange(measured.size) + _LOWEST) * usual_dps / 360.0 * interval_s < 0.5
    for place in _strongest(np.maximum(*excess)[sampled]):
        order = place + _LOWEST
        coherence = float(cross[place] ** 2 / max(measured[place] * felt[place], 1e-300))
        hz = order * usual_dps / 360.0
        name = f"A line at {360.0 / order:.3g}° of angle ({order} a turn, {hz:.3g} Hz at {usual_dps:.3g} °/s)"
        if coherence > _BOTH:
            yield f"{name} is true motion: encoder and gyro both see it, with a coherence of {coherence:.3f}."
        elif coherence > _ALONE:
            yield f"{name} is partly motion that both see, partly an error of one of them (coherence {coherence:.2f})."
        else:
            alone, other = ("encoder", "gyro") if excess[0][place] > excess[1][place] else ("gyro", "encoder")
            yield f"{name} is an error of the {alone}: the {other} does not see it (coherence {coherence:.2f})."


def _strongest(excess: FloatArray) -> list[int]:
    """Return the places of the strongest lines, in order; places close to a stronger line are skipped."""
    found: list[int] = []
    for place in np.argsort(-excess).tolist():
        if excess[place] < _STANDS_OUT or len(found) == _MOST:
            break
        if all(abs(place - other) > _SKIRT for other in found):
            found.append(place)
    return sorted(found)
