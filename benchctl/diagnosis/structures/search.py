"""Models for what has no name: of the residual's coordinates the simplest shape that explains it.

What a fit leaves was located model-free (`rest`), which also sets the ceiling. Here shapes over those coordinates are
fitted like effects, jointly with the baseline and the findings, and compared by evidence, which pays for every
parameter (Schwarz, Annals of Statistics 6, 1978) and every place that was looked at; steps that nothing was fitted to
decide.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from benchctl.diagnosis.fitting.fit import Fit, Point, fit, gain_of
from benchctl.diagnosis.fitting.point import at_bound
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.keys import keys_of
from benchctl.diagnosis.rest.rest import Rest, rest_of
from benchctl.diagnosis.search.held_out import least_gain
from benchctl.diagnosis.search.pull import pull_of
from benchctl.diagnosis.search.scatter import scatter
from benchctl.diagnosis.search.selection import Evidence, Selection
from benchctl.diagnosis.signals.blocks import block_starts
from benchctl.diagnosis.structures.scan import Begun, places_along
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.structures import COORDINATES, Structure, StructureStage, structure

FloatArray = npt.NDArray[np.float64]

_NEAR_THE_BEST = 0.4
"""Share of the best coordinate's promise below which another one is not modelled."""
_MOST_COORDINATES, _FITTED = 4, 6
_KINDS = {
    "gyro_temp": "temperature",
    "gyro_temp_rate": "temperature",
    "chamber_temp": "temperature",
    "angle": "angle",
    "time": "time",
}
_TIE = 10.0
"""In twice the log likelihood: two coordinates whose models differ by less are not told apart."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Modelled:
    """A selection with structures in its model, and by coordinate what else would explain the first as well."""

    chosen: Selection
    structures: tuple[Structure, ...]
    ties: tuple[str, ...]
    left: Rest


@dataclass(frozen=True, slots=True, kw_only=True)
class _Candidate:
    fit: Fit
    evidence: float

    @property
    def structure(self) -> Structure:
        added = self.fit.point.effects[-1]
        assert isinstance(added, Structure)  # noqa: S101  # it was fitted as one
        return added


def modelled(
    problem: GyroProblem,
    chosen: Selection,
    rest: Rest,
    *,
    apart_from: Sequence[DescribedEffect] = (),
    most: int = 2,
    seed: int,
) -> Modelled | None:
    """The selection with what is left modelled by at most so many structures; None where no shape explains it.

    Shapes over coordinates along which one of the effects `apart_from` acts are not tried.
    """
    taken = {_kind(word) for effect in apart_from for word in _own(effect.coordinate)}
    found: list[Structure] = []
    ties: tuple[str, ...] = ()
    while len(found) < most and rest.significant:
        candidates = _candidates(problem, chosen, rest, taken)
        if not candidates:
            break
        best = max(candidates, key=lambda one: one.evidence)
        if best.structure.over == "output":  # which is nearly the rate, of which more is a function
            rates = [one for one in candidates if one.structure.over == "rate"]
            nearest = max(rates, key=lambda one: one.evidence, default=best)
            best = nearest if nearest.evidence > best.evidence - _TIE else best
        if not found:
            near = [one for one in candidates if one.evidence > best.evidence - _TIE]
            words = dict.fromkeys(one.structure.coordinate for one in near)
            ties = tuple(word for word in words if word != best.structure.coordinate)
        found.append(best.structure)
        chosen = _with(problem, chosen, best.fit)
        rest = rest_of(problem, chosen.whitener, chosen.after, seed=seed)
    if not found:
        return None
    return Modelled(chosen=chosen, structures=tuple(found), ties=ties, left=rest)


def _with(problem: GyroProblem, chosen: Selection, after: Fit) -> Selection:
    """The selection with a structure as the last effect of its model."""
    effects = (*chosen.whole.point.effects, after.point.effects[-1])
    everything = np.ones_like(after.fitted)
    whole = after
    if chosen.heldout.any():
        whole = fit(problem, chosen.whitener, Point(baseline=after.point.baseline, effects=effects), everything)
    gone = chosen.after
    evidence = Evidence(
        gain=gain_of(after, gone),
        heldout=gain_of(after, gone, chosen.heldout),
        scatter=1.0,
        excess=(gone.white**2 - after.white**2).astype(np.float32),
    )
    key = keys_of(after.point.effects)[-1]
    return replace(chosen, after=after, whole=whole, evidence={**chosen.evidence, key: evidence})


def _kind(word: str) -> str:
    """What a coordinate is of: motion, temperature, angle, time."""
    return _KINDS.get(word, "motion")


def _own(coordinate: str) -> list[str]:
    """The words of a coordinate; of two without the rate, in proportion to which a scale factor acts."""
    words = coordinate.split("*")
    return [word for word in words if word != "rate"] or words


def _candidates(problem: GyroProblem, chosen: Selection, rest: Rest, taken: set[str]) -> list[_Candidate]:
    """Models with one structure more that hold on steps which they were not fitted to."""
    pull = pull_of(problem, chosen.whitener, chosen.after)
    known = {effect.identifier for effect in chosen.after.point.effects}
    begun: list[Begun] = []
    for stage, over in _places_of(problem, rest):
        if _kind(over) in taken:
            continue
        begun += places_along(problem, pull, stage, over)
    looked = 2.0 * math.log(max(sum(one.places for one in begun), 1.0))
    begun = [one for one in begun if one.effect.identifier not in known]
    ranked = sorted(begun, key=lambda one: one.gain - len(one.effect.parameters) * math.log(chosen.after.rows))
    fitted = (_fitted(problem, chosen, one.effect, looked) for one in ranked[: -_FITTED - 1 : -1])
    return [one for one in fitted if one is not None]


def _fitted(problem: GyroProblem, chosen: Selection, begun: Structure, looked: float) -> _Candidate | None:
    """The model with a structure; None where it does not pass, also on steps that were held out."""
    present = chosen.after
    one = fit(problem, chosen.whitener, replace(present.point, effects=(*present.point.effects, begun)), present.fitted)
    added = one.point.effects[-1]
    if at_bound(added) and not (isinstance(added, Structure) and added.is_sharp):
        return None
    gain = gain_of(one, present)
    evidence = gain - len(begun.parameters) * math.log(one.rows) - looked
    starts = block_starts(one.white.size)
    rows = one.fitted[problem.step]
    if gain / scatter((present.white - one.white) * rows, present.white * rows, starts) - looked < chosen.least:
        return None
    held = chosen.heldout
    if held.any():
        rows = held[problem.step]
        if gain_of(one, present, held) < max(least_gain(one.white[rows], present.white[rows]), 0.0):
            return None
    return _Candidate(fit=one, evidence=evidence) if evidence > 0.0 else None


def _places_of(problem: GyroProblem, rest: Rest) -> list[tuple[StructureStage, str]]:
    """The stages and coordinates of which what is left may be a function, the most promising first."""
    # time and step follow everything, whichever coordinate it is a function of
    tied = [one.promise for one in rest.looked if {"time", "step"}.isdisjoint(one.words[0].split("*"))]
    most = max(tied, default=0.0)
    found: dict[tuple[StructureStage, str], None] = {}
    for one in rest.looked:
        if one.promise < _NEAR_THE_BEST * most or len(one.words) != 1:
            continue
        words = ["time" if word == "step" else word for word in one.words[0].split("*")]
        others = [word for word in words if word != "rate"]
        over = others[0] if others else "rate"
        stage: StructureStage = "scale" if len(words) > len(others) and others else "bias"
        if over in COORDINATES and len(others) <= 1:
            found[stage, over] = None
    allowed = [place for place in found if problem.band is None or not structure(place[0], place[1], "step").momentary]
    return allowed[:_MOST_COORDINATES]
