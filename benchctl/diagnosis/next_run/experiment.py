"""The next experiment: of the possible runs of the bench, the one that best decides what a recording leaves open.

For each run the output is predicted with the finding's model, and the rival's parameters are refitted to it, with the
recording's information on them as a constraint. The remaining difference relative to the noise is the expected
separation of the two models in twice the log likelihood. The quickest run that separates all pairs is chosen, else the
one that separates most.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from benchctl.bench import Bench
from benchctl.campaign.check import bench_time_s
from benchctl.diagnosis.gyro.chain import GyroChain
from benchctl.diagnosis.gyro.problem import GyroProblem
from benchctl.diagnosis.next_run.candidates import LONGEST_H, called, candidates, shown_bench, two_digits
from benchctl.diagnosis.next_run.planned import Planned, planned
from benchctl.diagnosis.next_run.sampled import SampleNoise
from benchctl.diagnosis.result import NextExperiment
from benchctl.estimation.closest import Known, distance, known_from
from benchctl.estimation.fit import Fit
from benchctl.plan import Plan

ALIKE = 10.0
"""Two effects are alike if twice the log likelihood separates them by less: odds of at most 150 to 1."""
SETTLED = 50.0
"""Required expected separation; the actual value varies by 2·√50 because of noise and is still significant."""
_MOST_PAIRS = 3
NOTHING_OPEN = NextExperiment(says="No further experiment is needed to separate the candidates.")


@dataclass(frozen=True, slots=True, kw_only=True)
class OpenPair:
    """Two models that a recording leaves open, each fitted to it: the finding's, and the one with a rival instead."""

    finding: str
    rival: str
    first: Fit
    second: Fit


@dataclass(frozen=True, slots=True, kw_only=True)
class Expected:
    """A candidate run and its expected separation of each pair, in twice the log likelihood."""

    given: Mapping[str, Any]
    plan: Plan
    hours: float
    separations: tuple[float, ...]

    @property
    def settles(self) -> bool:
        """Whether all pairs are separated."""
        return min(self.separations) >= SETTLED

    @property
    def worth(self) -> float:
        """The total separation; for each pair at most the required one counts."""
        return sum(min(one, SETTLED) for one in self.separations)


def next_experiment(
    problem: GyroProblem,
    noise: SampleNoise,
    pairs: Sequence[OpenPair],
    *,
    bench: Bench | None = None,
    progress: Callable[[str], None] = lambda _: None,
) -> NextExperiment:
    """Return the run that separates pairs of models; without a bench, within the limits this recording shows.

    It is the quickest run expected to separate every pair by `SETTLED`, else the one that separates most, of up to a
    day.
    """
    if not pairs:
        return NOTHING_OPEN
    considered = sorted(pairs, key=lambda one: one.second.squares)[:_MOST_PAIRS]
    target = bench or shown_bench(problem)
    known = [known_from(one.second, anew="U0_v") for one in considered]
    tried: list[Expected] = []
    priced = [(bench_time_s(plan, target) / 3600.0, given, plan) for given, plan in candidates(target)]
    for hours, given, plan in sorted(priced, key=lambda one: one[0]):
        if hours > LONGEST_H or (tried and tried[-1].settles):
            break
        progress(called(given, plan))
        rows = planned(plan, target, tuple(problem.frame.auxiliary))
        parts = tuple(
            expected_separation(problem, noise, one.first, two, rows)
            for one, two in zip(considered, known, strict=True)
        )
        tried.append(Expected(given=given, plan=plan, hours=hours, separations=parts))
    return _said(considered, best_of(tried))


def expected_separation(problem: GyroProblem, noise: SampleNoise, first: Fit, second: Known, rows: Planned) -> float:
    """Return the expected separation of two models in a plan's rows, with the second refitted to the first."""
    there = replace(
        problem,
        frame=rows.frame,
        chain=GyroChain(rows.frame, problem.chain.law, problem.chain.earth_dps),
        usable=rows.stands_for > 0.0,
        band=None,
    )
    target = there.predict(first.point.baseline, first.point.effects)
    return distance(target, second, there.predict, noise.whitening(rows))


def best_of(tried: Iterable[Expected]) -> Expected | None:
    """Return the quickest run that separates all pairs, else the one that separates most; ties go to the quicker."""
    ranked = sorted(tried, key=lambda one: (not one.settles, one.hours if one.settles else -one.worth, one.hours))
    return ranked[0] if ranked else None


def _said(pairs: Sequence[OpenPair], best: Expected | None) -> NextExperiment:
    names = tuple(dict.fromkeys(name for one in pairs for name in (one.finding, one.rival)))
    open_words = "; ".join(f"{one.finding} from {one.rival}" for one in pairs)
    if best is None or max(best.separations) < ALIKE:
        most = "" if best is None else f": {best.plan.procedure} by {two_digits(max(best.separations))} at the most"
        return NextExperiment(
            says=f"This recording does not separate {open_words}, and no installed procedure within the bench's limits"
            f" is expected to separate them{most}, in twice the log likelihood.",
            separates=names,
        )
    apart = ", and ".join(
        f"{one.finding} from {one.rival} by about {two_digits(part)}"
        for one, part in zip(pairs, best.separations, strict=True)
    )
    return NextExperiment(
        says=f"Run {called(best.given, best.plan)}: it is expected to separate {apart} in twice the log likelihood,"
        f" in {two_digits(best.hours)} h of bench time.",
        procedure=best.plan.procedure,
        separates=names,
        parameters=best.given,
        separation=min(best.separations),
    )
