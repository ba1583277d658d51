"""Lines of angle: whether what repeats with the shaft's angle is true motion, or an error of encoder or gyro.

A stepper shakes its shaft at every step, a motor cogs. Such motion both sensors see, with one amplitude and one phase.
An error of the encoder's marks makes the rate that is made of them seem to shake, and the gyro knows nothing of it; of
what only the gyro says, the encoder knows nothing. So the two are compared as they came, without any model.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d

from benchctl.signals.binning import line_scores
from benchctl_instruments.arrays import BoolArray, ComplexArray, FloatArray

_LOWEST, _HIGHEST = 9, 400
"""Below so many waves a turn a line cannot be told from the sweep of the motion itself."""

_PIECES = 12
_FEWEST_ROWS = 200
_SLOW_S, _STEADY = 0.5, 0.3
"""Rows count where the rate, averaged over so long, is the usual one to within such a share."""

_AROUND = 31
_STANDS_OUT = 10.0
"""Power over the usual one of the orders around: a line of angle, not the motion's own shape."""

_SKIRT = 3
_MOST = 3
_BOTH, _ALONE = 0.9, 0.3
"""Coherence from which on both see one motion, and up to which they see nothing in common."""


def lines_of_angle(
    *, angle_deg: FloatArray, rate_dps: FloatArray, felt: FloatArray, rows: BoolArray, interval_s: float
) -> tuple[str, ...]:
    """Of the strongest lines, in sentences, who sees them; none where there is none.

    `angle_deg` is the encoder's, unwrapped, `rate_dps` the table's, `felt` what the gyro says [deg/s], `rows` those to
    be used; all of shape (n,).
    """
    seen = np.diff(angle_deg, append=angle_deg[-1]) / interval_s
    if not rows.any():
        return ()
    usual = float(np.median(np.abs(rate_dps[rows])))
    slow = uniform_filter1d(rate_dps, max(1, round(_SLOW_S / interval_s)))
    pairs = []
    for sense in (-1.0, 1.0):
        # a reversal is no line, but it leaves something at every order
        turning = np.flatnonzero(rows & (np.abs(slow - sense * usual) < _STEADY * usual))
        scores = [
            np.array([_score(values[part] - sense * usual, angle_deg[part]) for values in (seen, felt)])
            for part in np.array_split(turning, _PIECES)
            if part.size > _FEWEST_ROWS
        ]
        if scores:
            pairs.append(np.array(scores))
    return tuple(_sentences(pairs, usual, interval_s)) if pairs else ()


def _score(values: FloatArray, angle_deg: FloatArray) -> ComplexArray:
    return line_scores(values - values.mean(), angle_deg, _HIGHEST)[_LOWEST:]


def _sentences(pairs: list[ComplexArray], usual_dps: float, interval_s: float) -> Iterator[str]:
    """From scores of shape (pieces, 2, orders), of one sense of rotation each: a delay turns their phases apart."""
    seen, felt = (sum(np.sum(np.abs(one[:, i]) ** 2, axis=0) for one in pairs) for i in (0, 1))
    cross = sum(np.abs(np.sum(np.conj(one[:, 0]) * one[:, 1], axis=0)) for one in pairs)
    excess = [power / np.maximum(median_filter(power, _AROUND), 1e-300) for power in (seen, felt)]
    sampled = (np.arange(seen.size) + _LOWEST) * usual_dps / 360.0 * interval_s < 0.5
    for place in _strongest(np.maximum(*excess)[sampled]):
        order = place + _LOWEST
        coherence = float(cross[place] ** 2 / max(seen[place] * felt[place], 1e-300))
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
    """The places of the lines that stand out most, in order; what is beside a stronger one is its skirt."""
    found: list[int] = []
    for place in np.argsort(-excess).tolist():
        if excess[place] < _STANDS_OUT or len(found) == _MOST:
            break
        if all(abs(place - other) > _SKIRT for other in found):
            found.append(place)
    return sorted(found)
