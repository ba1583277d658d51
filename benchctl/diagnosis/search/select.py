"""Selection: add the effects that the data require one by one, refit all jointly, drop those no longer needed."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchctl.diagnosis.keys import Place, keys_of, place_of
from benchctl.diagnosis.search.held_out import least_gain
from benchctl.diagnosis.search.models import ALIKE, Models, Tried, may_be_nothing
from benchctl.diagnosis.search.pairs import pairs_of
from benchctl.diagnosis.search.screen import Scored, Screening
from benchctl.diagnosis.search.selection import Evidence, Selection
from benchctl.diagnosis.stepped import PartProblem
from benchctl.estimation.disturbance import with_disturbance
from benchctl.estimation.evidence import occam_factor
from benchctl.estimation.fit import Fit, Point, fit, gain_kept, gain_of, judged
from benchctl.estimation.noise import Noisy, Whitener
from benchctl.estimation.point import at_bound
from benchctl.estimation.wandering import PROCESSES
from benchctl.signals.blocks import step_starts
from benchctl_instruments.physics.effects.effect import DescribedEffect
from benchctl_instruments.physics.structures import Structure

Better = Callable[[PartProblem, Fit, Whitener], PartProblem | None]

_MOST_FINDINGS = 5
_RIVALS = 5
_MOST_SWAPS = 6
_MOST_REFUSED = 3
"""The search ends when so many effects have been refused because they make the prediction of held-out steps worse."""
_HIDDEN, _PAIRS, _MOST_OF_IT = 6, 3, 0.5
"""Number of effects, not significant alone, that are paired; number of pairs fitted; share a pair must explain."""
_MUCH, _MUCH_LEFT = 0.3, 0.3
"""Share of the residual power beyond pure error that is much, and share of it that a single effect must leave."""
_FIRST_LOOK = 0.1
_SEARCHED, _EACH_ROUND = 0.9, 0.5
"""Share of a diagnosis that is the search; share of the remaining search attributed to each further screening."""


def _later(share: float) -> float:
    """Return the completed share of a diagnosis after the first search, from the share of the second search."""
    return _FIRST_LOOK + (1.0 - _FIRST_LOOK) * share


def _share_done(rounds: int) -> float:
    """Return the estimated completed share of a diagnosis after so many screenings; their final number is unknown."""
    return _SEARCHED * (1.0 - _EACH_ROUND**rounds)


def select(
    problem: PartProblem,
    *,
    seed: int,
    progress: Callable[[str, float], None],
    rounding_v2: float = 0.0,
    chosen: Selection | None = None,
) -> Selection:
    """Find the effects that a problem's data require, starting from `chosen`, an earlier result for the same data.

    `rounding_v2` [unit²] is the variance of a coarse converter's rounding. If motion sweeps the steps slowly or in the
    same way each time, rounding is not noise, and an effect that explains only a small share of it is not accepted.
    """
    first = None if chosen is None else _Plain.of(chosen)
    return Search(problem, seed, progress, rounding_v2).run(first=first)


def select_between(
    problem: PartProblem,
    better: Better,
    *,
    seed: int,
    progress: Callable[[str, float], None],
    rounding_v2: float = 0.0,
    begun: Search | None = None,
) -> tuple[PartProblem, Selection]:
    """Find the effects as `select` does, and choose between two assumptions about what a recording does not state.

    After each finding, `better` tests whether the other assumption explains the recording better; if so, it returns
    that problem, and the search continues with it and with the findings that remain valid. A final test at the end of
    the search decides with all findings in the model.

    For very long recordings, a first search on a subset of the rows finds the obvious effects; the search on all rows
    then confirms or drops them and finds the others. A search that was `begun` is continued.
    """
    few = problem.thinned()
    if few is None:
        search = Search(problem, seed, progress, rounding_v2) if begun is None else begun
        chosen = search.run(better)
    else:
        first = Search(few, seed, lambda name, share: progress(name, _FIRST_LOOK * share), rounding_v2)
        plain = first.look(better)
        search = Search(problem, seed, lambda name, share: progress(name, _later(share)), rounding_v2)
        chosen = search.run(better, plain)
    return search.problem, chosen


def without(problem: PartProblem, chosen: Selection, *keys: str) -> Fit:
    """Return the fit without the effects of some keys, on the steps used for the selection."""
    return fit(problem, chosen.whitener, _dropped(chosen.after.point, keys), chosen.after.fitted)


def reduced(problem: PartProblem, chosen: Selection, keys: Collection[str]) -> Selection:
    """Return the selection without some chosen effects and noises, with all other parameters refitted and new keys."""
    noise = chosen.noise.dropped(keys)

    def fitted(one: Fit) -> Fit:
        return fit(problem, noise.whitener, _dropped(one.point, keys), one.fitted)

    after = fitted(chosen.after)
    kept = [one for key, one in chosen.evidence.items() if key not in keys]
    return replace(
        chosen,
        after=after,
        full=with_disturbance(problem, fitted(chosen.full)),
        noise=noise,
        evidence=dict(zip(keys_of(after.point.effects), kept, strict=True)),
    )


def settled_again(problem: PartProblem, chosen: Selection, fallen: Collection[Place], *, seed: int) -> Selection:
    """Return the selection after effects were withdrawn (`fallen`): drop unneeded effects, compare rivals again."""
    return Search(problem, seed, lambda _name, _share: None, 0.0).settle(chosen, fallen)


def without_nothing(problem: PartProblem, chosen: Selection) -> Selection:
    """Return the selection without findings not distinguishable from zero, which withdrawn names may leave behind.

    Structures are kept: the statement about them is already made.
    """

    def findings() -> list[int]:
        effects = chosen.full.point.effects
        return [place for place in may_be_nothing(problem, chosen.full) if not isinstance(effects[place], Structure)]

    while places := findings():
        chosen = reduced(problem, chosen, {list(chosen.evidence)[min(places)]})
    return chosen


def _dropped(point: Point, keys: Collection[str]) -> Point:
    named = zip(keys_of(point.effects), point.effects, strict=True)
    return replace(point, effects=tuple(effect for key, effect in named if key not in keys))


def _added(more: Fit, less: Fit) -> float:
    """Return the evidence for the effects that one model has in addition to those of another."""
    known = _places(less)
    added = [place for place, one in enumerate(_places(more)) if one not in known]
    return gain_of(more, less) - sum(occam_factor(more, place) for place in added)


def _places(present: Fit) -> list[Place]:
    return [place_of(effect) for effect in present.point.effects]


def _not_to_state(problem: PartProblem, present: Fit, evidence: Mapping[str, Evidence]) -> DescribedEffect | None:
    """Return the effect that most worsens held-out steps, is at a bound or is consistent with zero; None if none is."""
    zero = may_be_nothing(problem, present)
    worse = [
        (its.heldout, place)
        for place, (one, its) in enumerate(zip(present.point.effects, evidence.values(), strict=True))
        if its.heldout < its.heldout_least or at_bound(one) or place in zero
    ]
    return present.point.effects[min(worse)[1]] if worse else None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Plain:
    """Effects found by an earlier search, and for each the rivals it was compared with."""

    effects: tuple[DescribedEffect, ...]
    rivals: Mapping[Place, tuple[str, ...]]

    @staticmethod
    def of(chosen: Selection) -> _Plain:
        """Return the effects chosen by a finished search."""
        effects = chosen.after.point.effects
        evidence = zip(effects, chosen.evidence.values(), strict=True)
        return _Plain(effects=effects, rivals={place_of(one): tuple(its.rivals) for one, its in evidence})


class Search(Models):
    """The search: adds effects to a model, then drops and replaces them until the model no longer changes."""

    _first: Fit | None = None
    _looked: tuple[Screening, Tried | None] | None = None
    """The model without effects, its screening, and the best model with one, where `bare` has found them."""

    @property
    def problem(self) -> PartProblem:
        """The problem, under the assumption that explains the recording better."""
        return self._problem

    def look(self, better: Better) -> _Plain:
        """Find the obvious effects, as the start of another search."""
        self._stated = self._problem
        present, _ = self._grown(self._begun(Point(baseline=self._problem.baseline_start)), better)
        return _Plain(effects=present.point.effects, rivals=self._rivals)

    def bare(self) -> Selection | None:
        """Return the selection without effects, if much is left that no single effect explains; else None.

        What was found is used again when the search is run.
        """
        self._stated = self._problem
        untouched = Point(baseline=self._problem.baseline_start)
        self._first = present = self._begun(untouched)
        beyond = self._beyond_noise(present)
        if beyond < _MUCH:
            return None
        screening = self._screened(present, (0.0, _share_done(1)))
        self._threshold = screening.threshold
        tried = self._best(present, screening)
        self._looked = screening, tried
        left = 1.0 if tried is None else self._beyond_noise(tried.fit) * (tried.fit.deviation / present.deviation) ** 2
        return self._selection(present, untouched, screening, {}) if left > _MUCH_LEFT * beyond else None

    def run(self, better: Better | None = None, first: _Plain | None = None) -> Selection:
        """Find all effects, starting from those that a `first` search has found."""
        self._stated = self._problem
        untouched = Point(baseline=self._problem.baseline_start)
        begun = self._begun(untouched) if self._first is None else self._first
        if first is not None and first.effects:
            self._rivals |= first.rivals
            begun = self._pruned(self._fit(replace(begun.point, effects=first.effects)), first.effects)
            begun = self._answered(begun, better)
        present, screening = self._grown(begun, better)
        answered = self._confirmed(present, better)
        if answered is not present:
            present, screening = self._grown(answered)
        looked = grown = _places(present)
        present = self._remeasured(present, self._least(present))
        present, evidence = self._settled(present)
        while True:
            worse = _not_to_state(self._problem, present, evidence)
            gone = {*grown} - {*_places(present)} if worse is None else {place_of(worse)}
            if not gone:
                break
            self._refused |= gone
            present = present if worse is None else self._without(present, worse)
            if len(self._refused) < _MOST_REFUSED:  # the refused effect may have replaced another one
                present, screening = self._grown(present)
                looked = _places(present)
            grown = _places(present)
            present, evidence = self._settled(present)
        if _places(present) != looked:
            screening = self._screened(present, (_SEARCHED, _SEARCHED))
        return self._selection(present, untouched, screening, evidence)

    def _selection(
        self, present: Fit, untouched: Point, screening: Screening, evidence: Mapping[str, Evidence]
    ) -> Selection:
        before = fit(self._problem, self._noise.plain, untouched, self._fitted)
        return Selection(
            before=before.light,
            after=present,
            full=self._full(present),
            noise=self._noise,
            screening=screening,
            evidence=evidence,
            heldout=self._held,
            least=self._least(present),
        )

    def settle(self, chosen: Selection, fallen: Collection[Place]) -> Selection:
        """Return the selection without unneeded effects, adding none; `fallen` effects are not rivals either."""
        self._noise, self._threshold = chosen.noise, chosen.screening.threshold
        self._rivals, self._refused = dict(_Plain.of(chosen).rivals), set(fallen)
        present, evidence = self._settled(chosen.after)
        while (worse := _not_to_state(self._problem, present, evidence)) is not None:
            self._refused.add(place_of(worse))
            present, evidence = self._settled(self._without(present, worse))
        return replace(chosen, after=present, full=self._full(present), evidence=evidence)

    def _full(self, present: Fit) -> Fit:
        everything = np.ones_like(self._fitted)
        return fit(self._problem, self._noise.whitener, present, everything) if self._held.any() else present

    def _begun(self, untouched: Point) -> Fit:
        """Return the first fit, with rows weighted by the noise estimated from its residual."""
        present = self._fit(untouched)
        self._noise = self._noise.levelled(self._problem, present)
        return self._fit(present)

    def _answered(self, present: Fit, better: Better | None) -> Fit:
        """Return the model under the other assumption if that is better, else unchanged."""
        other = None if better is None else better(self._problem, present, self._noise.whitener)
        return present if other is None else self._reviewed(self._under(other, present))

    def _confirmed(self, present: Fit, better: Better | None) -> Fit:
        """Return the model under the assumption that is better with all findings included; it may be unchanged.

        An assumption chosen early was chosen with fewer effects, and a missing effect may have looked like it.
        """
        if better is None or self._problem is self._stated:
            return self._answered(present, better)
        whitener = self._noise.whitener
        as_stated = fit(self._stated, whitener, present.point, self._fitted, rounds=0)
        if better(self._stated, as_stated, whitener) is not None:
            return present
        return self._reviewed(self._under(self._stated, present))

    def _under(self, problem: PartProblem, present: Fit) -> Fit:
        """Return the model fitted under another assumption, which is used from now on."""
        self._problem, self._bare = problem, None
        return self._fit(present.point)

    def _reviewed(self, present: Fit) -> Fit:
        """Return the model with its noise measured again, and without effects that are no longer needed."""
        return self._pruned(self._remeasured(present, self._least(present)), present.point.effects)

    def _grown(self, present: Fit, better: Better | None = None) -> tuple[Fit, Screening]:
        """Return the model with all effects that the data require, and the last screening, which found no more.

        After each added effect the other assumption is tested: an early decision avoids repeated searches.
        """
        number = 0
        while True:
            known = self._looked if present is self._first else None
            shares = _share_done(number), _share_done(number + 1)
            screening = self._screened(present, shares) if known is None else known[0]
            self._threshold = screening.threshold
            if number == _MOST_FINDINGS:
                return present, screening
            number += 1
            least = self._least(present)
            tried = self._best(present, screening) if known is None else known[1]
            self._looked = None
            rival = 0.0 if tried is None else tried.evidence
            noisy = self._noise.best(self._problem, present, least_gain=least, rival=rival)
            if noisy is not None and (tried is None or self._noise_first(present, noisy, tried, least)):
                self._noise = self._noise.with_(noisy)
                present = self._fit(present)
                continue
            if tried is None:
                tried = self._instead_of_process(present, _share_done(number))
            if tried is None:
                tried = self._paired(present, screening)
            if tried is None:
                return present, screening
            present = self._remeasured(self._pruned(tried.fit, tried.fit.point.effects[:-1]), least)
            del tried  # its derivatives need as much memory as those of the fit that replaced it
            if self._problem is self._stated:
                present = self._answered(present, better)

    def _remeasured(self, present: Fit, threshold: float) -> Fit:
        """Return the fit with the noise findings measured again for this model."""
        if not self._noise.found:
            return present
        self._noise = self._noise.measured(self._problem, present, least_gain=threshold)
        return self._fit(present)

    def _noise_first(self, present: Fit, noisy: Noisy, tried: Tried, least: float) -> bool:
        """Return whether the noise process is to be added before the effect.

        A noise process follows anything slow and may gain more than the effect that it imitates. With the effect in the
        model, a genuine process keeps its size, while an imitating one becomes much smaller.
        """
        if noisy.gain <= tried.evidence:
            return False
        with_effect = self._noise.best(self._problem, tried.fit, least_gain=least)
        effect_first = tried.evidence + (with_effect.gain if with_effect is not None else 0.0)
        whitener = noisy.whitener
        both, alone = (fit(self._problem, whitener, one, self._fitted) for one in (tried.fit, present))
        return effect_first <= noisy.gain + max(gain_of(both, alone), 0.0) + least

    def _instead_of_process(self, present: Fit, share: float) -> Tried | None:
        """Return a model in which an effect replaces a noise process; None, with nothing changed, if there is none.

        Other missing effects can hide this effect at first: in a structured residual both follow it badly.
        """
        found = self._noise
        process = next((found.found[name] for name in PROCESSES if name in found.found), None)
        if process is None:
            return None
        self._noise = found.dropped({process.effect})
        bare = self._fit(present)
        tried = self._best(bare, self._screened(bare, (share, share)))
        noisy = replace(process, whitener=found.whitener)
        if tried is not None and not self._noise_first(bare, noisy, tried, self._least(bare)):
            return tried
        self._noise = found
        return None

    def _paired(self, present: Fit, screening: Screening) -> Tried | None:
        """Return the best model with two more effects of which each is needed, though neither is significant alone.

        Together they must explain most of what exceeds pure error; otherwise they are not effects that hid each other.
        """
        hidden = self._hidden(present, screening)
        beyond_noise = self._beyond_noise(present)
        chosen_from = 2.0 * math.log(max(len(hidden), 1))
        begun: list[tuple[Point, float]] = []
        for pair in pairs_of(self._problem, self._noise.whitener, present, hidden)[:_PAIRS]:
            if pair.promise > self._least(present) + chosen_from and pair.explains >= _MOST_OF_IT * beyond_noise:
                begun.append((replace(present.point, effects=(*present.point.effects, *pair.effects)), pair.places))
        for scored in hidden[:_PAIRS]:  # one of them together with a start that the problem itself proposes
            one = self._with(present, scored).fit.point
            begun.extend((start, scored.probe.places) for start in self._starts(one))
        best: Tried | None = None
        for start, places in begun:
            both = self._fit(start)
            look_elsewhere = chosen_from + 2.0 * math.log(places)
            promise = self._beyond_chance(both, present) - look_elsewhere
            if promise <= self._least(present) or not all(
                self._needed(both, effect, look_elsewhere) for effect in both.point.effects[-2:]
            ):
                continue
            evidence = _added(both, present) - look_elsewhere
            if best is None or evidence > best.evidence + ALIKE:
                best = Tried(fit=both, promise=promise, evidence=evidence)
        return best

    def _beyond_noise(self, present: Fit) -> float:
        """Return the share of a model's residual power that is not pure error."""
        noise = self._noise.pure_error
        return 1.0 - min(noise / present.deviation, 1.0) ** 2

    def _hidden(self, present: Fit, screening: Screening) -> list[Scored]:
        """Return the best place of each effect with the largest gains, scatter ignored; empty if all are too small."""
        best: dict[str, Scored] = {}
        for one in self._free(present, screening).best_of_each():
            if one.probe.identifier not in best or one.gain > best[one.probe.identifier].gain:
                best[one.probe.identifier] = one
        ranked = sorted(best.values(), key=lambda one: -float(f"{one.gain:.6g}"))[:_HIDDEN]
        least = self._least(present)
        return ranked if any(one.gain - 2.0 * math.log(one.probe.places) > least for one in ranked) else []

    def _needed(self, present: Fit, effect: DescribedEffect, look_elsewhere: float) -> bool:
        """Return whether one effect of a model is significant with the others in place, also on steps not fitted."""
        less = self._without(present, effect)
        promise = self._beyond_chance(present, less) - look_elsewhere
        return promise > self._least(less) and gain_kept(present, less, self._folds) > 0.0

    def _pruned(self, present: Fit, effects: Sequence[DescribedEffect]) -> Fit:
        """Return the fit without those of the given effects that are no longer needed."""
        for effect in effects:
            less = self._without(present, effect)
            if self._beyond_chance(present, less) < self._least(less):
                present = less
        return present

    def _settled(self, present: Fit) -> tuple[Fit, dict[str, Evidence]]:
        """Compare every effect with its absence and its rivals, all others in place, until the model is unchanged."""
        for _ in range(_MOST_SWAPS + len(present.point.effects)):
            evidence: dict[str, Evidence] = {}
            for key, effect in zip(keys_of(present.point.effects), present.point.effects, strict=True):
                less = self._without(present, effect)
                own = self._evidence(present, less)
                if self._is_unneeded(effect, own, less):
                    present = less
                    break
                rivals, nearest, better = self._rivalled(present, less, effect)
                if better is not None:
                    self._rivals[place_of(better.added)] = (*rivals, effect.identifier)
                    present = self._without_harmful(present, effect) or better.fit
                    break
                evidence[key] = replace(own, rivals=rivals, nearest=nearest)
            else:
                other = self._one_for_two(present) or self._two_for_one(present)
                if other is None:
                    return present, evidence
                present = other
        return present, {
            key: self._evidence(present, self._without(present, one))
            for key, one in zip(keys_of(present.point.effects), present.point.effects, strict=True)
        }

    def _is_unneeded(self, effect: DescribedEffect, own: Evidence, less: Fit) -> bool:
        return self._earned(own) / own.scatter < self._least(less) or at_bound(effect)

    def _without_harmful(self, present: Fit, replaced: DescribedEffect) -> Fit | None:
        """Return the model without an effect that held-out steps contradict and make unneeded; None if there is none.

        With such an effect in the model, a wrong rival can win that follows the error of both.
        """
        for effect in present.point.effects:
            if effect is not replaced:
                less = self._without(present, effect)
                own = self._evidence(present, less)
                if own.heldout < 0.0 and self._is_unneeded(effect, own, less):
                    return less
        return None

    def _earned(self, own: Evidence) -> float:
        """Return the gain that counts for an effect: that on the fitted steps plus that on held-out steps.

        In motion, held-out steps count only if negative, because a coarse converter's rounding is alike in all steps.
        """
        return own.gain + (min(own.heldout, 0.0) if self._problem.in_motion else own.heldout)

    def _one_for_two(self, present: Fit) -> Fit | None:
        """Return the model with one effect in place of two similar ones if the two do no better; None if there is none.

        With either of the two in the model, the one effect has nothing to explain: it is significant only without both.
        """
        for two in itertools.combinations(present.point.effects, 2):
            kinds = frozenset(two[0].look_alikes) & frozenset(two[1].look_alikes) & self._problem.effects.keys()
            if not kinds:
                continue
            less = self._without(present, *two)
            for scored in self._promising(less, self._screened(less, (_SEARCHED, _SEARCHED), kinds)):
                tried = self._with(less, scored)
                lost = self._beyond_chance(present, tried.fit)
                if tried.evidence > -math.inf and lost < self._least(tried.fit):
                    self._rivals[place_of(tried.added)] = tuple(effect.identifier for effect in two)
                    return tried.fit
        return None

    def _two_for_one(self, present: Fit) -> Fit | None:
        """Return the model with two effects in place of one that imitates both, if it is clearly better; else None.

        This is tested only if more than pure error remains, as neither of the two is visible with the one effect in the
        model. If the one effect does as well together with either of the two, only that effect was missing.
        """
        least = self._least(present)
        if self._beyond_noise(present) < -math.expm1(-least / present.rows):  # the largest possible gain is too small
            return None
        imperfect = least - (self._threshold or 0.0)
        for effect in present.point.effects:
            less = self._without(present, effect)
            screening = self._screened(less, (_SEARCHED, _SEARCHED))
            others = tuple(one for one in screening.scored if one.probe.identifier != effect.identifier)
            tried = self._paired(less, replace(screening, scored=others))
            if tried is None or tried.evidence <= _added(present, less) + least:
                continue
            with_one = (
                replace(present.point, effects=(*present.point.effects, one)) for one in tried.fit.point.effects[-2:]
            )
            if all(tried.evidence > _added(self._fit(point), less) + imperfect for point in with_one):
                self._rivals[place_of(tried.added)] = (effect.identifier,)
                return tried.fit
        return None

    def _evidence(self, present: Fit, less: Fit) -> Evidence:
        """Return the evidence for an effect, with a scatter that also accounts for differences between steps.

        The rounding of an encoder's angles repeats itself in a swing whose period is an integer number of samples:
        within a step it does not average out, but it differs between steps (Liang & Zeger, Biometrika 73, 1986).
        """
        held = self._held[self._problem.step]
        by_steps = self._scatter_over(step_starts(self._problem.step), present, less)
        return Evidence(
            gain=gain_of(present, less),
            heldout=gain_of(present, less, self._held),
            scatter=max(self._scatter(present, less), by_steps),
            excess=(judged(self._problem, less) ** 2 - judged(self._problem, present) ** 2).astype(np.float32),
            heldout_least=least_gain(present.white[held], less.white[held]),
        )

    def _rivalled(
        self, present: Fit, less: Fit, effect: DescribedEffect
    ) -> tuple[dict[str, float], Point | None, Tried | None]:
        """Return the losses of evidence with rivals in place, the nearest rival's model, and the best one if better."""
        mine = _added(present, less)
        kinds = frozenset({*self._rivals.get(place_of(effect), ()), *effect.look_alikes, effect.identifier})
        rivals: dict[str, float] = {}
        best: Tried | None = None
        nearest: Tried | None = None
        # rivals are compared by evidence: scatter due to the absent effect must not hide them
        screening = self._screened(less, (_SEARCHED, _SEARCHED), kinds)
        even = replace(screening, scored=tuple(replace(one, scatter=1.0) for one in screening.scored))
        others = (one for one in self._tried(less, even, kinds) if place_of(one.added) != place_of(effect))
        for tried in itertools.islice(others, _RIVALS):
            if tried.evidence == -math.inf:
                continue
            if best is None or tried.evidence > best.evidence:
                best = tried
            if tried.added.identifier == effect.identifier:
                continue
            loss = mine - tried.evidence
            rivals[tried.added.identifier] = min(loss, rivals.get(tried.added.identifier, math.inf))
            if nearest is None or tried.evidence > nearest.evidence:
                nearest = tried
        return (
            rivals,
            None if nearest is None else nearest.fit.point,
            best if best is not None and best.evidence > mine + ALIKE else None,
        )
