"""Withdrawal of findings that leave too much of what they explain; the residual is then reported as unexplained."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.keys import place_of
from benchctl.diagnosis.residual.residual_structure import (
    ResidualStructure,
    imperfect,
    instead_of,
    lack_of_fit,
    of_the_motion,
    residual_structure_of,
    residual_structure_with_disturbance,
    withdrawn,
)
from benchctl.diagnosis.result import Unexplained
from benchctl.diagnosis.search.scans import swinging_hz
from benchctl.diagnosis.search.select import reduced, settled_again, without
from benchctl.diagnosis.search.selection import Selection
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.disturbance import whitened_for_disturbance
from benchctl.estimation.fit import Fit, fit, gain_of
from benchctl.estimation.wandering import PROCESSES
from benchctl_instruments.arrays import BoolArray
from benchctl_instruments.physics.effects.kinds import ClockEffect, EncoderEffect, FilterEffect

_ROUNDS = 5
_ARCSEC, _DIGITS = 3600.0, 7
_SECTOR_DEG = 10.0
"""Where a motion passes all sectors of this size, the rounding of the angle averages out over the turn."""
_ROUNDED = 0.1
"""Share of the rounding's variance that may remain in lines, if the motion sweeps the steps alike each time."""
_REPLACED = 0.5
"""Share of the gain of a finding above which what is found in its place replaces it."""
NOTHING = Unexplained(significant=False, share=0.0)


def named(
    problem: PartProblem, chosen: Selection, *, rounding_v2: float = 0.0, contested: bool = False, seed: int
) -> tuple[Selection, Unexplained, tuple[str, ...]]:
    """Return the selection without the findings that the residual forbids, the unexplained residual, and notes.

    `rounding_v2` is the variance of a coarse converter's rounding, which repeats with the motion and is not noise. As a
    withdrawn finding uncovers what it had followed, the residual is tested again until no more are withdrawn. If the
    findings were `contested` and no other model does as well, only those small relative to the residual are withdrawn.
    """
    if problem.disturbed:
        return chosen, _unexplained_with_disturbance(problem, chosen), ()
    chosen, noted = without_the_tables_own(problem, chosen)
    for _ in range(_ROUNDS):
        rest = residual_structure_of(problem, chosen.whitener, chosen.after, seed=seed)
        if not rest.significant or math.sqrt(rest.power) < problem.rate_error_v:
            return chosen, NOTHING, noted
        if rest.power < _ROUNDED * rounding_v2:
            return chosen, NOTHING, (f"{rest.says} It is small enough to be caused by the converter's steps.",)
        judged = rest if problem.in_motion else _without_time(rest, chosen.after)
        less = {name: without(problem, chosen, *shared) for name, shared in _shared(chosen).items()}
        agreed = _agreed(problem, chosen)
        noises = _noises(chosen, rest)
        gains = {name: _explained_power(judged, chosen.after, one) for name, one in less.items()} | noises
        instead = dict.fromkeys(agreed, 0.0)
        for name, one in less.items():
            if name not in agreed:
                own = instead_of(problem, chosen.whitener, one, judged, seed=seed)
                own = min(own, _in_rows(problem, chosen.after, one))
                instead[name] = own * gains[name] / max(gain_of(chosen.after, one), 1.0)
        effects = dict(zip(chosen.evidence, chosen.after.point.effects, strict=True))
        forbidden = withdrawn(noises if contested else gains, judged, instead)
        if not forbidden:
            kept = agreed | _independent(problem, judged, gains, instead)
            forbidden = _too_small(problem, chosen, rest, kept)
        if not forbidden:
            break
        fallen = {place_of(effect) for key, effect in effects.items() if key in forbidden}
        chosen = settled_again(problem, reduced(problem, chosen, forbidden), fallen, seed=seed)
    if problem.in_motion:
        chosen = _as_uncertain(chosen, rest)
    all_gains = {name: _explained_power(rest, chosen.after, one) for name, one in less.items()} | noises
    if imperfect(all_gains, rest, instead):
        return chosen, NOTHING, (f"{rest.says} It is small enough to be an error in the model of the findings.",)
    before = fit(problem, chosen.noise.plain, chosen.before.point, chosen.before.fitted)
    ceiling = residual_structure_of(problem, chosen.noise.plain, before, seed=seed)
    unexplained = Unexplained(
        significant=True, share=rest.share_of(ceiling), coordinates=rest.coordinates, says=rest.says
    )
    return chosen, unexplained, ()


def _too_small(problem: PartProblem, chosen: Selection, rest: ResidualStructure, kept: set[str]) -> tuple[str, ...]:
    """Return the key of the weakest finding along the motion if chance can gain as much with this residual, else ().

    The power it explains in the rows is compared with the lack of fit (an F-test), because the logarithm of a
    likelihood is small if much is left. The gain in quantities compared in addition to the rows counts in full, as the
    residual does not contain them. The errors of other findings, which are not chance, the search has compared with
    the gain itself. A finding on which several recordings agree is kept, and so is one that the residual cannot follow
    (`kept`). An encoder error smaller than one encoder step is rounding that repeats with a motion of less than a turn.
    """
    gains: dict[str, float] = {}
    chance = chosen.screening.threshold
    for key, effect in zip(chosen.evidence, chosen.after.point.effects, strict=True):
        if isinstance(effect, EncoderEffect) and _is_rounding(problem, effect):
            return (key,)
        ratio = lack_of_fit(rest, effect.coordinate)
        if key not in kept and of_the_motion(effect.coordinate) and chosen.evidence[key].gain < ratio * chance:
            gain, less = chosen.evidence[key].gain, without(problem, chosen, key)
            rows = chosen.after.fitted[problem.step]
            gains[key] = max(gain - _in_rows(problem, chosen.after, less), 0.0)
            gains[key] += _by_power(rest, chosen.after, _squares(less, rows) - _squares(chosen.after, rows)) / ratio
    return tuple(key for key, gain in gains.items() if gain == min(gains.values()) and gain < chance)


def _independent(
    problem: PartProblem, rest: ResidualStructure, gains: Mapping[str, float], instead: Mapping[str, float]
) -> set[str]:
    """Return the keys of findings that a function of the residual's coordinate, found `instead`, does not replace.

    None if the residual changes from step to step or in time, or in a swing at one frequency, in which all coordinates
    of the motion are equivalent: such a residual may follow anything.
    """
    if swinging_hz(problem) or {"time", "step"} & {*"*".join(rest.coordinates).split("*")}:
        return set()
    return {key for key, gain in instead.items() if gain < _REPLACED * gains[key]}


def _is_rounding(problem: PartProblem, effect: EncoderEffect) -> bool:
    if not isinstance(problem, GyroProblem):
        return False
    angles_deg = np.unique(np.mod(problem.frame.encoder_deg, 360.0).round(_DIGITS))
    steps_deg = np.diff(angles_deg)
    if steps_deg.size == 0 or np.unique(angles_deg // _SECTOR_DEG).size * _SECTOR_DEG >= 360.0:
        return False
    size = max(abs(effect.values[name]) for name, one in effect.parameters.items() if one.role == "size")
    return size < _ARCSEC * float(np.median(steps_deg))


def _as_uncertain(chosen: Selection, rest: ResidualStructure) -> Selection:
    """Return the selection with the losses of its rivals divided by the lack of fit along the motion."""
    share = 1.0 / lack_of_fit(rest)
    evidence = {
        key: replace(one, rivals={name: share * loss for name, loss in one.rivals.items()})
        for key, one in chosen.evidence.items()
    }
    return replace(chosen, evidence=evidence)


def _agreed(problem: PartProblem, chosen: Selection) -> set[str]:
    """Return the keys of delays and filters that several recordings confirm.

    At a single frequency a function of the acceleration could replace them; at several frequencies it cannot.
    """
    if not problem.recorded.any():
        return set()
    effects = zip(chosen.evidence, chosen.after.point.effects, strict=True)
    return {key for key, effect in effects if isinstance(effect, ClockEffect | FilterEffect)}


def _shared(chosen: Selection) -> dict[str, tuple[str, ...]]:
    """Return, by key of each finding, the findings that share its explanation: itself and its look-alikes.

    A compliant mount, for example, adds little to a delay, and a delay little to the mount; their joint gain is shared.
    """
    effects = dict(zip(chosen.evidence, chosen.after.point.effects, strict=True))
    return {
        key: tuple(other for other, its in effects.items() if other == key or effect.identifier in its.look_alikes)
        for key, effect in effects.items()
    }


def _unexplained_with_disturbance(problem: PartProblem, chosen: Selection) -> Unexplained:
    """Return what is unexplained in addition to a disturbance; every finding has already competed with it."""
    after = whitened_for_disturbance(problem, chosen.after)
    rest = residual_structure_with_disturbance(problem, after.whitener, after)
    if not rest.significant:
        return NOTHING
    before = fit(problem, after.whitener, chosen.before, chosen.before.fitted, rounds=0)
    share = rest.share_of(residual_structure_with_disturbance(problem, after.whitener, before))
    return Unexplained(significant=True, share=share, coordinates=rest.coordinates, says=rest.says)


def _explained_power(rest: ResidualStructure, fitted: Fit, less: Fit) -> float:
    """Return the power that a finding explains, on the scale of the gain of the residual structure."""
    return _by_power(rest, fitted, less.squares - fitted.squares)


def _by_power(rest: ResidualStructure, fitted: Fit, squares: float) -> float:
    """Return an explained sum of squares on the scale of the gain of the residual structure."""
    return max(squares, 0.0) / max(fitted.rows, 1.0) / max(rest.power, 1e-300) * rest.gain


def _squares(fitted: Fit, rows: BoolArray) -> float:
    return float(fitted.white[rows] @ fitted.white[rows])


def _in_rows(problem: PartProblem, fitted: Fit, less: Fit) -> float:
    """Return a finding's gain in the rows alone, because a coordinate cannot explain the spectral residual."""
    rows = fitted.fitted[problem.step]
    good, bad = (max(_squares(one, rows), 1e-300) for one in (fitted, less))
    return max(fitted.rows * math.log(bad / good), 0.0)


def _without_time(rest: ResidualStructure, fitted: Fit) -> ResidualStructure:
    """Return the residual structure along coordinates other than time and step, for a drive or a chamber.

    These change state only once or twice per recording: time and step follow any residual and argue against no finding.
    """
    others = [one for one in rest.looked if not {"time", "step"} & {*"*".join(one.words).split("*")}]
    best = max(others, key=lambda one: one.promise, default=None)
    gain, words = (0.0, ()) if best is None else (best.gain, best.words)
    power = fitted.squares / max(fitted.rows, 1.0) * -math.expm1(-gain / max(fitted.rows, 1.0))
    return replace(rest, gain=gain, power=power, coordinates=words)


def _noises(chosen: Selection, rest: ResidualStructure) -> dict[str, float]:
    """Return the gains of the noise findings; for a slow process its gain with the remaining effects in the model."""
    return {name: rest.noise_gain if name in PROCESSES else one.gain for name, one in chosen.noise.found.items()}


def without_the_tables_own(problem: PartProblem, chosen: Selection) -> tuple[Selection, tuple[str, ...]]:
    """Return the selection without effects that the table may have caused, the smallest first, and notes.

    The rates of static points were commanded, not measured. Their errors repeat with every visit, so that scatter does
    not show them, and look like a nonlinearity or asymmetry of the gyro. For other parts, and for recordings with an
    encoder, all effects are kept.
    """
    dropped: list[str] = []
    while chosen.evidence and problem.rate_error_v:
        changes = {key: _change_v(chosen.after, without(problem, chosen, key)) for key in chosen.evidence}
        smallest = min(changes, key=lambda key: changes[key])
        if not changes[smallest] < problem.rate_error_v:
            break
        dropped.append(smallest.replace("_", " "))
        chosen = reduced(problem, chosen, {smallest})
    if not dropped:
        return chosen, ()
    return chosen, (
        f"The points also follow a {' and a '.join(dropped)}, by less than commanded rates may be wrong by:"
        f" {problem.rate_error_v:.2g} {problem.unit}, 0.1 % of the largest. That may be the table's own and is not"
        " named; an encoder would show which.",
    )


def _change_v(one: Fit, other: Fit) -> float:
    """Return the maximum difference of two fits on rows that count."""
    counted = one.whitener.weight > 0.0
    return float(np.abs(one.predicted - other.predicted)[counted].max())
