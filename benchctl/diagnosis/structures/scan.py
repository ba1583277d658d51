"""Starting points of the search for structures: a scan of all places of all shapes over all coordinates.

A structure is a function of one coordinate, times a factor of its stage: the volts due to the rate for the scale
factor, the acceleration for a delay. The pull of the residual (its gradient) is therefore summed once over narrow bins
of the coordinate; the expected gain of any function then follows from products of these sums.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import oaconvolve

from benchctl.diagnosis.drive.problem import DriveProblem
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.search.pull import Pull, peaks
from benchctl.diagnosis.structures.along import UNSEEN, Along, Begun, Place, everywhere
from benchctl.estimation.fit import Fit
from benchctl.side_by_side import shared_out
from benchctl.signals.blocks import consecutive
from benchctl_instruments.arrays import FloatArray, IntArray
from benchctl_instruments.physics.effects.thermal_hysteresis import play
from benchctl_instruments.physics.structure_places import CHAMBER_C, OVER, Span, StructureStage, last_sign
from benchctl_instruments.physics.structures import Structure, lagged_in_parts, structure

Structurable = GyroProblem | DriveProblem
"""Problems of the parts of the bench in which structures are searched."""
_MEMORIES_S = np.geomspace(2.0, 2000.0, 13)
_REMEMBERED = ("abs_rate", "rate", "rate_sign", "gyro_temp", "gyro_temp_rate", "setpoint")
_BLOCKS_A_MEMORY = 16
_BACKLASHES = np.geomspace(0.005, 0.4, 14)
_FACTORS: Mapping[StructureStage, tuple[str, ...]] = {
    "scale": ("abs_rate", "gyro_temp_rate"),
    "bias": ("abs_rate", "rate_sign", "last_sign"),
}
_PRODUCTS: tuple[Place, ...] = tuple(
    (stage, over, times)
    for stage, factors in _FACTORS.items()
    for over in ("gyro_temp", "angle", "time")
    for times in factors
)
"""Pairs of coordinates: a function of the first, in proportion to the second, which has a natural zero."""
_CLEARLY_MORE = 1.1
"""Minimum expected gain of a function of two coordinates, as a multiple of the best function of one."""
_OF_STAGE: Mapping[StructureStage, tuple[str, ...]] = {
    "scale": ("gyro_temp", "gyro_temp_rate", "time", "angle", "chamber_temp", "setpoint", "abs_rate", "last_sign"),
    "bias": tuple(OVER),
    "sampling": ("gyro_temp", "gyro_temp_rate", "time", "abs_rate"),
    "torque": ("time", "angle", "swing_angle", "rate", "abs_rate", "rate_sign", "acceleration"),
}
"""Coordinates over which structures of a stage are searched."""
_MOST_JUMPS = 6
_LEAST_JUMP = 60.0
_STANDS_OUT, _NOISY = 4.0, 4.0
"""Minimum gain relative to the next best place, and maximum residual power relative to the noise, of a jump."""


def begun_everywhere(problem: Structurable, pull: Pull, in_time: Pull) -> list[Begun]:
    """Return the best place of each shape at each stage over each coordinate, if it has an expected gain.

    `in_time` is the pull of all steps: an event at an instant is visible only in the step of that instant.
    """
    scanned = {over_time: _seen(problem, one) for over_time, one in ((False, pull), (True, in_time))}
    stages = scanned[False][2].keys()
    places = [(stage, over, "") for stage in stages for over in _OF_STAGE.get(stage, ())]
    band = problem.band if isinstance(problem, GyroProblem) else None

    def begun(places: Sequence[Place]) -> list[Begun]:
        over = places[0][1]
        pulling, known, factors, coordinates = scanned[over == "time"]
        share = pull.fitted.rows / pulling.fitted.rows
        factored = {
            place: factors[place[0]] * coordinates[place[2]] if place[2] else factors[place[0]] for place in places
        }
        found = _places_along(problem, pulling, known, factored, coordinates[over])
        return [replace(one, share=share) for one in found]

    known = [
        one
        for one in (*places, *(place for place in _PRODUCTS if place[0] in stages))
        if {*one[1:]} - {""} <= scanned[False][-1].keys()
        and (band is None or not structure(one[0], one[1], "line", times=one[2]).momentary)
    ]
    of_each = [[one for one in known if one[1] == over] for over in dict.fromkeys(one[1] for one in known)]
    found = list(itertools.chain.from_iterable(shared_out(begun, of_each)))
    most = max((one.promise for one in found if not one.effect.times), default=0.0)
    return [one for one in found if not one.effect.times or one.promise > _CLEARLY_MORE * most]


def _seen(
    problem: Structurable, pull: Pull
) -> tuple[Pull, list[FloatArray], Mapping[StructureStage, FloatArray], Mapping[str, FloatArray]]:
    """Return the pull of a fit's residual, that of its derivatives, the factors of the stages, and the coordinates.

    The part of the residual that the fit's own parameters would still remove at full convergence is subtracted.
    """
    fitted = pull.fitted
    known = [pull.of_known(i) for i in range(len(fitted.numbers))]
    left = pull.pull.copy()
    for one, step in zip(known, (fitted.step_left / fitted.deviation).tolist(), strict=True):
        left -= step * one
    return replace(pull, pull=left), known, factors_of(problem, fitted), coordinates_of(problem, fitted)


def coordinates_of(problem: Structurable, fitted: Fit) -> dict[str, FloatArray]:
    """Return every coordinate that varies in a recording, as structures use it; arrays of shape (n,).

    `output` is the predicted output: the measured output contains the residual, so a function of it would follow any
    residual.
    """
    values = {name: one for name, one in problem.coordinates.items() if name in OVER} | {"output": fitted.predicted}
    values["time"] = problem.clock_s
    if isinstance(problem, DriveProblem) and float(values["angle"].min()) < 0.0:
        values["swing_angle"] = values.pop("angle")
    if isinstance(problem, GyroProblem):
        frame, band = problem.frame, problem.band
        made = {"last_sign": last_sign(frame.rate_dps)}
        made["chamber_temp"] = frame.auxiliary.get(CHAMBER_C, np.zeros(frame.rows))
        values |= {name: one if band is None else one[band.rows] for name, one in made.items()}
    rows = problem.usable
    return {name: one for name, one in values.items() if np.isfinite(one[rows]).all() and np.ptp(one[rows]) > 0.0}


def factors_of(problem: Structurable, fitted: Fit) -> Mapping[StructureStage, FloatArray]:
    """Return the factor of each stage from its function to the measured quantity; arrays of shape (n,)."""
    if isinstance(problem, DriveProblem):
        return {"torque": np.ones_like(fitted.predicted)}
    K0, U0 = fitted.point.baseline[:2].tolist()
    return {
        "scale": fitted.predicted - U0,
        "bias": np.ones_like(fitted.predicted),
        "sampling": -K0 * problem.coordinates["acceleration"],
    }


def _places_along(
    problem: Structurable,
    pull: Pull,
    known: list[FloatArray],
    factors: Mapping[Place, FloatArray],
    values: FloatArray,
) -> Iterator[Begun]:
    """Yield the best place of each shape over a coordinate, for each stage with its factor."""
    rows = pull.rows
    span = float(values[rows].min()), float(values[rows].max())
    if not span[0] < span[1]:
        return
    yield from everywhere(Along.of(pull, known, values, factors, span))
    for (stage, over, times), factor in factors.items():
        if isinstance(problem, GyroProblem) and over in _REMEMBERED and stage != "sampling" and not times:
            yield from _remembered(problem, pull, known, (stage, over, times), values, factor, span)


def _remembered(
    problem: GyroProblem,
    pull: Pull,
    known: list[FloatArray],
    place: Place,
    values: FloatArray,
    factor: FloatArray,
    span: Span,
) -> Iterator[Begun]:
    """Yield the best first-order lag of a coordinate, and the best backlash of the gyro temperature."""
    stage, over, _ = place
    longest, wide = float(np.ptp(problem.time_s)), span[1] - span[0]
    taus = [tau for tau in _MEMORIES_S.tolist() if tau < 0.5 * longest]
    looked: list[tuple[str, str, list[float]]] = [("memory", "tau", taus)]
    if over == "gyro_temp" and not problem.recorded.any():
        looked.append(("hysteresis", "width", (wide * _BACKLASHES).tolist()))
    blocks = _Blocks.of(problem)
    mean = blocks.means(values)
    pulled, informed = blocks.sums(factor * pull.pull), blocks.sums(factor**2 * pull.information)
    crossed = np.stack([blocks.sums(factor * one) for one in known])
    for shape, name, lengths in looked:
        kind = structure(stage, over, shape, span)
        best: tuple[float, float, float] | None = None
        for length in lengths:
            column = blocks.lag(mean, length) if shape == "memory" else play(mean, length, float(mean[0])) - mean
            score = float(column @ pulled)
            power = float(column**2 @ informed)
            shared = crossed @ column
            own = power - float(shared @ pull.fitted.inverse_information @ shared)
            if own > UNSEEN * power > 0.0 and (best is None or score**2 / own > best[0]):
                best = score**2 / own, score / own, length
        if best is not None:
            yield Begun(effect=kind.make({"c1": best[1], name: best[2]}), gain=best[0], places=len(lengths))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Blocks:
    """Blocks of rows, short compared with the memories that are searched; `rows` (b,) are their numbers of rows.

    `parts` are those of `lagged_in_parts`: the blocks of each stretch, their interval, and the origin of their time.
    """

    first: IntArray
    rows: IntArray
    time_s: FloatArray
    parts: list[tuple[slice, float, float]]

    @classmethod
    def of(cls, problem: GyroProblem) -> _Blocks:
        """Return the blocks of a problem's rows; each stretch starts a new block."""
        size = max(int(_MEMORIES_S[0] / _BLOCKS_A_MEMORY / problem.interval_s), 1)
        firsts = [np.arange(rows.start, rows.stop, size) for rows in problem.stretches]
        first = np.concatenate(firsts)
        begun = zip(consecutive([one.size for one in firsts]), problem.frame.origins_s, strict=True)
        return cls(
            first=first,
            rows=np.diff(first, append=problem.time_s.size),
            time_s=problem.time_s[first],
            parts=[(blocks, size * problem.interval_s, origin_s) for blocks, origin_s in begun],
        )

    def means(self, values: FloatArray) -> FloatArray:
        """Return the means of values (n,); at the ends of a stretch the values themselves, which last over a pause."""
        mean = self.sums(values) / self.rows
        begins = [blocks.start for blocks, *_ in self.parts]
        ends = [blocks.stop - 1 for blocks, *_ in self.parts]
        mean[begins] = values[self.first[begins]]
        mean[ends] = values[self.first[ends] + self.rows[ends] - 1]
        return mean

    def sums(self, values: FloatArray) -> FloatArray:
        """Return the sums over each block of values, shape (n,)."""
        return np.asarray(np.add.reduceat(values, self.first))

    def lag(self, mean: FloatArray, tau_s: float) -> FloatArray:
        """Return the first-order lag of the blocks' means (b,), through all pauses; each recording starts anew."""
        return lagged_in_parts(mean, self.time_s, self.parts, tau_s)


def encoder_jumps(problem: GyroProblem, pull: Pull, noise: float) -> list[Structure]:
    """Return the permanent jumps of the encoder's angle, the largest first.

    A jump appears in the rate as the step response of the filters. It is accepted only if there are few such places, if
    its gain clearly exceeds that of all others, and if only `noise` (whitened) remains there. An error of the response
    to motion appears at every start and stop of the table; the ends of a temporary bias change do not match a jump.
    """
    motion = problem.frame.motions[0]
    if problem.band is not None:
        return []
    responses = [np.cumsum(kernel) for kernel in motion.filters]
    longest = max(one.size for one in responses)
    narrow, wide = (np.pad(one, (longest - one.size) // 2) for one in responses)
    K0 = float(pull.fitted.point.baseline[0])
    sudden = problem.frame.sudden
    calm = 1.0 - sudden

    def met(values: FloatArray, response: FloatArray) -> FloatArray:
        return np.asarray(oaconvolve(values, response[::-1], mode="same"))

    score = -K0 * (met(calm * pull.pull, narrow) + met(sudden * pull.pull, wide))
    power = K0**2 * (
        met(calm**2 * pull.information, narrow**2)
        + met(sudden**2 * pull.information, wide**2)
        + 2.0 * met(calm * sudden * pull.information, narrow * wide)
    )
    power = np.maximum(power, 1e-3 * float(np.median(power)))
    gain = score**2 / power
    reach = longest // 2
    places = peaks(gain, _MOST_JUMPS + 1, 2 * reach)
    gains = [float(gain[place]) for place in places]
    count = max(
        (i + 1 for i in range(min(len(places) - 1, _MOST_JUMPS)) if gains[i] > _STANDS_OUT * gains[i + 1]), default=0
    )
    if not count or gains[count - 1] < _LEAST_JUMP:
        return []
    clock = problem.clock_s
    rows = pull.rows
    squares = np.where(rows, pull.fitted.white, 0.0) ** 2

    def leaves_noise(place: int) -> bool:
        near = slice(max(place - reach, 0), place + reach + 1)
        left = float(squares[near].sum()) - float(gain[place]) * pull.fitted.deviation**2
        return left < _NOISY * noise**2 * float(np.count_nonzero(rows[near]))

    kind = structure("encoder", "time", "jump", (float(clock[rows].min()), float(clock[rows].max())))
    found = []
    for place in filter(leaves_noise, places[:count]):
        at = 0.5 * float(clock[max(place - 1, 0)] + clock[place])
        found.append(kind.make({"change": 3600.0 * float(score[place] / power[place]), "at": at}))
    return found
