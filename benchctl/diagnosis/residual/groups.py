"""Coordinates in which a mismatch can occur, each as columns that follow any smooth function of it.

The columns along a coordinate are hat functions, 1 at one knot and 0 at its neighbours; their sums are all broken
lines. Unlike bins, they do not separate the rows of one set point by the encoder's noise. A column by itself changes
the bias; multiplied by the rate, the scale factor; multiplied by the distance from the reference temperature, the
temperature dependence of either.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np
import scipy.sparse

from benchctl.diagnosis.residual.score_test import Columns
from benchctl.signals.binning import hats, pairs
from benchctl_instruments.arrays import FloatArray
from benchctl_instruments.physics.effects.thermal_hysteresis import play

_TURN = 360.0
_ROUND = 36
_TIME_S = 10.0
_MOST_KNOTS = 400
_BACKLASHES = (0.0025, 0.005, 0.01, 0.02, 0.04, 0.08, 0.16, 0.32)
"""Half-widths as shares of the largest rate; sums of such play operators are any hysteresis (Prandtl, Ishlinskii)."""
_STANDING = 0.002
"""Share of the largest rate above which the sign column reaches ±1."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Group:
    """A coordinate in which a mismatch can occur. `words` are those of `result.COORDINATES`, or two joined by `*`.

    `along` (n,) is the coordinate itself, if the range with the largest mismatch can be stated; `form` is the generic
    form that the columns follow; `places` is the number of places among which the data chose this one. `columns`
    computes the columns, shape (n, k), not whitened.
    """

    words: tuple[str, ...]
    form: str
    columns: Callable[[], Columns]
    along: FloatArray | None = None
    places: float = 1.0


@dataclass(frozen=True, slots=True, kw_only=True)
class _Along:
    """The knots along a coordinate; with a `power` above one they are closer together at zero."""

    word: str
    knots: int
    power: float = 1.0
    noun: str


_BIAS = (
    _Along(word="rate", knots=47, noun="the rate"),
    _Along(word="abs_rate", knots=24, noun="the rate, the same in both directions"),
    _Along(word="acceleration", knots=25, power=2.0, noun="the acceleration"),
    _Along(word="gyro_temp", knots=20, noun="the gyro's temperature"),
    _Along(word="gyro_temp_rate", knots=21, power=2.0, noun="the rate of the gyro's temperature"),
    _Along(word="chamber_temp", knots=20, noun="the chamber's temperature"),
    _Along(word="output", knots=47, noun="the output"),
)
_SCALE = ("gyro_temp", "gyro_temp_rate", "chamber_temp")


def groups_of(
    coordinates: Mapping[str, FloatArray], *, output: FloatArray, reference_c: float, slow: bool = False
) -> Iterator[Group]:
    """Yield all groups that the coordinates of a recording, (n,) each, allow; those of time and step are the last.

    `output` is the predicted output: sorted by the measured one, noise would look like a structure. With `slow` noise
    the number of knots is halved and time is left out, because slow noise follows the same functions.
    """
    known = {name: values for name, values in coordinates.items() if _varies(values)} | {"output": output}
    rate = known.get("rate")
    share = None if rate is None else rate / float(np.abs(rate).max())
    for one in _BIAS:
        if one.word in known:
            yield _smooth(known[one.word], one, slow)
    if rate is not None:
        yield from _of_direction(rate, known, slow)
    if share is not None:
        for one in _BIAS:
            if one.word in _SCALE and one.word in known:
                yield _smooth(known[one.word], one, slow, share)
    if share is not None and rate is not None and "gyro_temp" in known:
        warm = _unit(known["gyro_temp"] - reference_c)
        yield Group(
            words=("gyro_temp*rate",),
            form="a response to the rate that changes its shape with the gyro's temperature",
            columns=lambda: hats(rate, _knots(rate, 24, 1.0, slow), warm),
            along=rate,
        )
    if "angle" in known:
        yield from _of_angle(known["angle"], share, known.get("gyro_temp"), reference_c, slow)
    if not slow:
        yield from _of_time(known, share)


def _varies(values: FloatArray) -> bool:
    return bool(np.isfinite(values).all()) and float(np.ptp(values)) > 0.0


def _unit(values: FloatArray) -> FloatArray:
    return np.asarray(values / (float(np.abs(values).max()) or 1.0))


def _smooth(values: FloatArray, cut: _Along, slow: bool, share: FloatArray | None = None) -> Group:
    """Return the group for a smooth function of one coordinate in the bias, or with `share` in the scale factor."""
    words = cut.word if share is None else "*".join(sorted((cut.word, "rate")))
    return Group(
        words=(words,),
        form=f"{'a bias' if share is None else 'a scale factor'} that depends on {cut.noun}",
        columns=lambda: hats(values, _knots(values, cut.knots, cut.power, slow), share),
        along=values,
    )


def _of_direction(rate: FloatArray, known: Mapping[str, FloatArray], slow: bool) -> Iterator[Group]:
    """Yield groups of the sign of the rate, of hysteresis in the rate, and of the acceleration in the scale factor."""
    largest = float(np.abs(rate).max())
    sign = np.clip(rate / (_STANDING * largest), -1.0, 1.0)
    yield Group(
        words=("rate_sign",),
        form="a bias that depends on the direction of rotation",
        columns=lambda: np.stack([sign, np.abs(sign)], axis=1),
    )
    acceleration = known.get("acceleration")
    if acceleration is None:
        return
    yield Group(
        words=("rate", "acceleration"),
        form="a response that depends on whence the rate came",
        columns=lambda: np.stack([play(rate, half * largest, rate[0]) - rate for half in _BACKLASHES], axis=1),
        along=rate,
    )
    yield Group(
        words=("acceleration*rate",),
        form="a scale factor that depends on the acceleration",
        columns=lambda: hats(acceleration, _knots(acceleration, 25, 2.0, slow), rate / largest),
        along=acceleration,
    )


def _of_angle(
    angle: FloatArray, share: FloatArray | None, temp: FloatArray | None, reference_c: float, slow: bool
) -> Iterator[Group]:
    knots = _ROUND // 2 if slow else _ROUND
    yield Group(
        words=("angle",),
        form="a bias that depends on the table's angle",
        columns=lambda: _ring(angle, knots),
        along=angle,
    )
    if share is None:
        return
    yield Group(
        words=("angle*rate",),
        form="a scale factor that depends on the table's angle",
        columns=lambda: _ring(angle, knots, share),
        along=angle,
    )
    if temp is None:
        return
    warm = _unit(temp - reference_c)
    yield Group(
        words=("angle*gyro_temp",),
        form="a dependence on the table's angle that grows with the gyro's temperature",
        columns=lambda: _side_by_side(_ring(angle, knots // 2, warm), _ring(angle, knots // 2, warm * share)),
        along=angle,
    )


def _of_time(known: Mapping[str, FloatArray], share: FloatArray | None) -> Iterator[Group]:
    for word, noun in (("time", "time"), ("step", "the step")):
        if word not in known:
            continue
        values = known[word]
        for factor in (None, share) if share is not None else (None,):
            yield Group(
                words=(word,) if factor is None else ("*".join(sorted((word, "rate"))),),
                form=f"{'a bias' if factor is None else 'a scale factor'} that changes with {noun}",
                columns=_time_columns(word, values, factor),
                along=values if word == "time" else None,
            )


def _time_columns(word: str, values: FloatArray, factor: FloatArray | None) -> Callable[[], Columns]:
    if word == "step":
        return lambda: _levels(values, factor)
    lasts = float(np.ptp(values))
    apart = max(_TIME_S if factor is None else 3.0 * _TIME_S, lasts / _MOST_KNOTS)
    knots = float(values.min()) + apart * np.arange(int(lasts / apart) + 2, dtype=np.float64)
    return lambda: hats(values, knots, factor)


def _knots(values: FloatArray, count: int, power: float, slow: bool) -> FloatArray:
    """Return knots from the smallest to the largest value, shape (k,); a power above one makes them denser at zero."""
    count = count // 2 + 1 if slow else count
    low, high = float(values.min()), float(values.max())
    if power == 1.0:
        return np.linspace(low, high, count, dtype=np.float64)
    place = np.linspace(-1.0, 1.0, count, dtype=np.float64)
    return np.asarray(max(-low, high) * np.sign(place) * np.abs(place) ** power)


def _levels(values: FloatArray, factor: FloatArray | None) -> scipy.sparse.csr_array:
    """Return one column per step, with 1 or the factor in its rows: a sparse matrix (n, steps)."""
    place = values.astype(np.int32)
    data = np.ones(values.size) if factor is None else factor
    ends = np.arange(values.size + 1, dtype=np.int32)
    return scipy.sparse.csr_array((data, place, ends), shape=(values.size, int(place.max()) + 1))


def _side_by_side(first: scipy.sparse.csr_array, second: scipy.sparse.csr_array) -> scipy.sparse.csr_array:
    return scipy.sparse.csr_array(scipy.sparse.hstack([first, second], format="csr"))


def _ring(angle_deg: FloatArray, count: int, factor: FloatArray | None = None) -> scipy.sparse.csr_array:
    """Return hat functions around the turn, times a factor (n,): a sparse matrix (n, count), two entries per row."""
    place = np.mod(angle_deg, _TURN) * (count / _TURN)
    left = place.astype(np.int32) % count
    part = place - np.floor(place)
    return pairs(left, (left + 1) % count, part, factor, count)
