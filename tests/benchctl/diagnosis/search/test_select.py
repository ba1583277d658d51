"""Selection on a problem of one page: what is there is found, and nothing else."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np
import pytest

from benchctl.diagnosis.search.held_out import held_out_steps
from benchctl.diagnosis.search.screen import Screening
from benchctl.diagnosis.search.select import Search, reduced, select, select_between
from benchctl.diagnosis.search.selection import Selection
from benchctl.estimation.fit import Fit, Point, fit, gain_of
from benchctl_instruments.physics.effects.effect import DescribedEffect, Parameter
from tests.benchctl.diagnosis.toy_problem import (
    K0,
    NOISE_V,
    ROWS,
    STEPS,
    TOTAL,
    U0,
    Cubic,
    Decay,
    FloatArray,
    Quintic,
    Ripple,
    Squared,
    Toy,
    ToyEffect,
    toy,
    walked,
)

ALL_NOISES = ("bias_random_walk", "flicker_noise", "noise_rate_dependent")
CUBIC, QUINTIC = Cubic(size_v=5e-3), Quintic(size_v=5e-3)
DECAY, SQUARED = Decay(amplitude_v=5e-3, tau_s=150.0), Squared(size_v=1e-3)
RIPPLE = Ripple(amplitude_v=5e-4, phase_deg=40.0, order=2.0)


def selected(problem: Toy, seed: int = 0) -> Selection:
    return select(problem, seed=seed, progress=lambda _name, _share: None)


def names(chosen: Selection) -> set[str]:
    return {effect.identifier for effect in chosen.after.point.effects}


def values(chosen: Selection) -> dict[str, dict[str, float]]:
    return {effect.identifier: effect.values for effect in chosen.after.point.effects}


class _Small(Cubic):
    """A cubic of which no more is plausible than a fifth of the one that is there."""

    parameters: ClassVar[Mapping[str, Parameter]] = {
        "size_v": replace(Cubic.parameters["size_v"], low=-CUBIC.size_v / 5.0, high=CUBIC.size_v / 5.0)
    }


def test_what_would_stand_at_its_bound_is_not_found() -> None:
    problem = toy(CUBIC)
    alone = replace(problem, effects={"cubic": Cubic})
    assert names(selected(alone)) == {"cubic"}
    assert names(selected(replace(problem, effects={"cubic": _Small}))) == set()


def test_what_one_of_several_recordings_contradicts_is_not_found() -> None:
    recorded = np.arange(STEPS) // (STEPS * 3 // 4)
    in_one = toy(hypotheses=(Squared,), added_v=2.0 * SQUARED.column(toy()) * (recorded == 0)[toy().step])
    assert names(selected(in_one)) == {"squared"}
    assert not names(selected(replace(in_one, recorded=recorded)))
    assert names(selected(replace(toy(SQUARED, hypotheses=(Squared,)), recorded=recorded))) == {"squared"}


def test_what_gains_as_much_is_fitted_although_its_gain_scatters() -> None:
    problem = toy(CUBIC)
    search = Search(problem, 0, lambda _name, _share: None, 0.0)
    begun = search._begun(Point(baseline=problem.baseline_start))
    screening = search._screened(begun, (0.0, 1.0))
    search._threshold = screening.threshold
    best = screening.best_of_each()[0]
    other = next(one for one in screening.scored if one.probe.identifier not in ("cubic", "quintic"))
    scattering = replace(other, gain=0.9 * best.gain, scatter=0.9 * best.gain / (0.1 * best.promise))
    small = replace(other, gain=0.1 * best.gain, scatter=1.0)
    for one, fitted in ((scattering, True), (small, False)):
        tried = search._promising(begun, replace(screening, scored=(best, one)))
        assert (one in tried) is fitted


@pytest.mark.parametrize("truth", [CUBIC, QUINTIC, DECAY, SQUARED, RIPPLE], ids=lambda one: one.identifier)
def test_one_effect_is_found_alone_and_with_its_numbers(truth: ToyEffect) -> None:
    for seed in range(5):
        chosen = selected(toy(truth, seed=seed))
        assert names(chosen) == {truth.identifier}
        one = chosen.full
        (effect,) = one.point.effects
        for i, number in enumerate(one.numbers):
            if number.effect == 0:
                true = one.point.moved(one.numbers, np.zeros(len(one.numbers)))
                true = replace(true, effects=(truth,))
                away = abs(one.point.value(number, i) - true.value(number, i))
                assert away < 5.0 * np.sqrt(one.covariance[i, i]), (effect, number.name)


def test_two_effects_are_found_together_whichever_is_larger() -> None:
    for seed in range(5):
        assert names(selected(toy(DECAY, SQUARED, seed=seed))) == {"decay", "squared"}
        assert names(selected(toy(RIPPLE, CUBIC, DECAY, seed=seed))) == {"ripple", "cubic", "decay"}


@pytest.mark.slow
def test_on_white_noise_nothing_is_found_in_two_hundred_recordings() -> None:
    found = [names(selected(toy(seed=seed))) for seed in range(1000, 1200)]
    assert sum(map(bool, found)) <= 1


def test_a_baseline_that_has_moved_is_refitted_and_no_effect() -> None:
    chosen = selected(toy(baseline=(1.01 * K0, U0 + 0.02)))
    assert names(chosen) == set()
    assert chosen.before.point.baseline == pytest.approx([1.01 * K0, U0 + 0.02], rel=2e-3)
    assert chosen.after.deviation == pytest.approx(NOISE_V, rel=0.05)


@pytest.mark.slow
def test_a_walk_is_found_and_nothing_else() -> None:
    for seed in range(4):
        chosen = selected(toy(seed=seed, added_v=walked(1e-4, seed), noises=ALL_NOISES))
        assert names(chosen) == set()
        assert set(chosen.noise.found) == {"bias_random_walk"}
        assert chosen.whitener.slow == chosen.noise.found["bias_random_walk"].whitener.slow


@pytest.mark.slow
def test_an_effect_is_found_beside_a_walk_and_beside_noise_that_grows() -> None:
    growing = 3.0 * NOISE_V * np.abs(toy().share) * np.random.default_rng(5).standard_normal(TOTAL)
    beside_walk = selected(toy(CUBIC, RIPPLE, added_v=walked(5e-5, 1), noises=ALL_NOISES))
    assert names(beside_walk) == {"cubic", "ripple"}
    assert set(beside_walk.noise.found) == {"bias_random_walk"}
    beside_growing = selected(toy(CUBIC, added_v=growing, noises=ALL_NOISES))
    assert names(beside_growing) == {"cubic"}
    assert set(beside_growing.noise.found) == {"noise_rate_dependent"}


def test_what_is_not_a_hypothesis_is_not_found() -> None:
    chosen = selected(toy(CUBIC, hypotheses=[Decay, Ripple]))
    assert "cubic" not in names(chosen)
    assert selected(toy(CUBIC, hypotheses=[])).after.point.effects == ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Mixed(ToyEffect):
    """A cubic and a drift at once: alone it does more than a cubic, beside a decay less."""

    size_v: float
    identifier: ClassVar[str] = "mixed"
    look_alikes: ClassVar[tuple[str, ...]] = ("cubic",)
    parameters: ClassVar[Mapping[str, Parameter]] = Cubic.parameters

    def column(self, problem: Toy) -> FloatArray:
        return self.size_v * (problem.share**3 - problem.time_s / 900.0)


KINDS_WITH_MIXED = (Cubic, Decay, Ripple, Mixed)


def taken(problem: Toy) -> tuple[list[set[str]], Selection]:
    """The effects of every model that was screened, in the order of the search, and its outcome."""
    models: list[set[str]] = []

    class Followed(Search):
        def _best(self, present: Fit, screening: Screening) -> Any:
            models.append({effect.identifier for effect in present.point.effects})
            return super()._best(present, screening)

    return models, Followed(problem, 0, lambda _name, _share: None, 0.0).run()


def test_what_a_later_finding_makes_superfluous_is_pruned() -> None:
    for seed in range(4):
        truth = Cubic(size_v=3e-3), Decay(amplitude_v=3e-3, tau_s=300.0)
        models, chosen = taken(toy(*truth, seed=seed, hypotheses=KINDS_WITH_MIXED))
        assert models == [set(), {"mixed"}, {"mixed", "decay"}, {"decay", "cubic"}]
        assert names(chosen) == {"cubic", "decay"}


def test_a_better_rival_takes_the_place_of_what_was_found_first() -> None:
    """Where too little parts the two for both to be taken; what is then missing is looked for once more."""
    swapped = 0
    for seed in range(8):
        truth = Cubic(size_v=1.6e-3), Decay(amplitude_v=1.6e-3, tau_s=300.0)
        models, chosen = taken(toy(*truth, seed=seed, hypotheses=KINDS_WITH_MIXED))
        assert names(chosen) == {"cubic", "decay"}
        swapped += models[-2:] == [{"mixed", "decay"}, {"cubic", "decay"}]
        mixed = chosen.evidence["cubic"].rivals.get("mixed")
        assert mixed is None or mixed > 0.0
    assert swapped >= 3


@dataclass(frozen=True, slots=True, kw_only=True)
class LikeCubic(Cubic):
    identifier: ClassVar[str] = "like_cubic"
    look_alikes: ClassVar[tuple[str, ...]] = ("both",)


@dataclass(frozen=True, slots=True, kw_only=True)
class LikeQuintic(Quintic):
    identifier: ClassVar[str] = "like_quintic"
    look_alikes: ClassVar[tuple[str, ...]] = ("both",)


@dataclass(frozen=True, slots=True, kw_only=True)
class Both(Cubic):
    identifier: ClassVar[str] = "both"

    def column(self, problem: Toy) -> FloatArray:
        return self.size_v * 2.0 * np.sign(problem.share) * problem.share**4


def settled_from_two(*truth: ToyEffect, seed: int) -> set[str]:
    """What is left of a model with the two that `Both` is like, once it has settled."""
    problem = toy(*truth, seed=seed, hypotheses=(LikeCubic, LikeQuintic, Both))
    search = Search(problem, 0, lambda _name, _share: None, 0.0)
    search._threshold = search._screened(search._fit(Point(baseline=problem.baseline_start)), (0.0, 1.0)).threshold
    two = (LikeCubic(size_v=4e-3), LikeQuintic(size_v=4e-3))
    settled, evidence = search._settled(search._fit(Point(baseline=problem.baseline_start, effects=two)))
    assert set(evidence) == {effect.identifier for effect in settled.point.effects}
    return set(evidence)


def test_one_effect_takes_the_place_of_two_that_it_is_like_where_they_do_no_better() -> None:
    for seed in range(4):
        assert settled_from_two(Both(size_v=4e-3), seed=seed) == {"both"}


def test_two_effects_stay_where_one_that_both_are_like_does_worse() -> None:
    for seed in range(4):
        truth = LikeCubic(size_v=2e-2), LikeQuintic(size_v=-2e-2)
        assert settled_from_two(*truth, seed=seed) == {"like_cubic", "like_quintic"}


def test_look_alikes_are_named_with_what_they_lose() -> None:
    problem = toy(CUBIC)
    chosen = selected(problem)
    evidence = chosen.evidence["cubic"]
    assert set(evidence.rivals) == {"quintic"}
    assert evidence.nearest is not None
    (rival,) = evidence.nearest.effects
    assert rival.identifier == "quintic"
    second = fit(problem, chosen.whitener, evidence.nearest, chosen.after.fitted)
    # both have one size, of about the same relative precision: what differs is the likelihood
    assert evidence.rivals["quintic"] == pytest.approx(gain_of(chosen.after, second), abs=3.0)


def test_an_effect_unlike_all_others_has_no_rival() -> None:
    evidence = selected(toy(RIPPLE)).evidence["ripple"]
    assert evidence.rivals == {}
    assert evidence.nearest is None


def test_the_gain_of_a_finding_is_lost_without_it() -> None:
    problem = toy(DECAY, SQUARED)
    chosen = selected(problem)
    for effect in chosen.after.point.effects:
        rest: tuple[DescribedEffect, ...] = tuple(one for one in chosen.after.point.effects if one is not effect)
        less = fit(problem, chosen.whitener, Point(baseline=chosen.after.point.baseline, effects=rest), ~chosen.heldout)
        evidence = chosen.evidence[effect.identifier]
        assert evidence.gain == pytest.approx(gain_of(chosen.after, less), rel=1e-6)
        assert evidence.heldout == pytest.approx(gain_of(chosen.after, less, chosen.heldout), rel=1e-4)
        assert evidence.heldout > 0.0
        total = float(evidence.excess[~chosen.heldout[problem.step]].sum())
        assert total == pytest.approx(less.squares - chosen.after.squares, rel=1e-3)


@pytest.mark.parametrize("truth", [(), (CUBIC,), (DECAY, SQUARED)], ids=["nothing", "one", "two"])
def test_held_out_steps_change_neither_the_choice_nor_a_number(truth: tuple[ToyEffect, ...]) -> None:
    problem = toy(*truth)
    held = held_out_steps(problem)[problem.step]
    spoilt = problem.measured.copy()
    spoilt[held] = np.random.default_rng(8).normal(0.7, 3.0, int(held.sum()))
    first, second = selected(problem), selected(replace(problem, measured=spoilt))
    assert second.after.point.effects == first.after.point.effects
    assert np.array_equal(second.after.point.baseline, first.after.point.baseline)
    assert np.array_equal(second.before.point.baseline, first.before.point.baseline)
    assert second.screening.threshold == first.screening.threshold
    # they do have a say in the fit to everything
    assert not np.array_equal(second.full.point.baseline, first.full.point.baseline)


def test_the_whole_is_the_choice_fitted_to_all_steps() -> None:
    chosen = selected(toy(CUBIC))
    assert chosen.full.rows == TOTAL
    assert chosen.after.rows == TOTAL - 3 * ROWS
    assert chosen.before.point.effects == ()


def test_the_same_seed_gives_the_same_selection() -> None:
    problem = toy(DECAY, RIPPLE)
    first, second = selected(problem, 3), selected(problem, 3)
    assert values(first) == values(second)
    assert first.screening.threshold == second.screening.threshold


def test_progress_names_what_is_tried_and_goes_on_to_the_end() -> None:
    told: list[tuple[str, float]] = []
    select(toy(CUBIC), seed=0, progress=lambda name, share: told.append((name, share)))
    shares = [share for _, share in told]
    assert {name for name, _ in told} >= {"cubic", "decay", "ripple"}
    assert shares == sorted(shares)
    assert 0.0 <= shares[0] <= shares[-1] <= 1.0


def test_a_search_that_is_done_again_begins_with_what_was_chosen_and_ends_where_one_from_nothing_does() -> None:
    before, problem = toy(DECAY, RIPPLE), toy(DECAY, SQUARED, seed=1)
    tried: dict[str, list[str]] = {"nothing": [], "chosen": []}
    anew = select(problem, seed=0, progress=lambda name, _share: tried["nothing"].append(name))
    again = select(problem, seed=0, progress=lambda name, _share: tried["chosen"].append(name), chosen=selected(before))
    assert names(again) == names(anew) == {"decay", "squared"}  # the ripple is gone
    assert again.after.squares == pytest.approx(anew.after.squares, rel=1e-6)
    assert again.evidence.keys() == anew.evidence.keys()
    assert len(tried["chosen"]) < len(tried["nothing"])


def test_a_selection_is_reduced_by_a_name_and_the_rest_is_refitted() -> None:
    problem = toy(DECAY, SQUARED)
    chosen = selected(problem)
    less = reduced(problem, chosen, {"decay"})
    assert names(less) == {"squared"}
    assert set(less.evidence) == {"squared"}
    assert less.after.squares > chosen.after.squares
    alone = fit(problem, chosen.whitener, replace(chosen.after.point, effects=(SQUARED,)), ~chosen.heldout)
    assert less.after.squares == pytest.approx(alone.squares, rel=1e-6)
    assert less.full.rows == TOTAL
    assert names(chosen) == {"decay", "squared"}


def test_a_selection_is_reduced_by_what_was_found_of_the_noise() -> None:
    problem = toy(added_v=walked(1e-4, 0), noises=ALL_NOISES)
    chosen = selected(problem)
    less = reduced(problem, chosen, {"bias_random_walk"})
    assert less.noise.found == {}
    assert less.whitener.slow == ()
    assert less.after.deviation > 1.1 * chosen.after.deviation / chosen.whitener.innovation


@dataclass(frozen=True, kw_only=True)
class Many(Toy):
    """A toy of so many rows that `few` are looked at first."""

    few: Toy

    def thinned(self) -> Toy:
        return self.few


def begun_with(few: Toy, problem: Toy) -> tuple[Selection, list[float]]:
    """What is selected where few rows are looked at first, and the shares that were told meanwhile."""
    own = {field.name: getattr(problem, field.name) for field in fields(Toy)}
    shares: list[float] = []
    many = Many(**own, few=few)
    _, chosen = select_between(many, lambda *_: None, seed=0, progress=lambda _, share: shares.append(share))
    return chosen, shares


def test_what_few_rows_show_and_all_bear_out_is_what_all_alone_would_show() -> None:
    problem = toy(DECAY, SQUARED)
    chosen, shares = begun_with(toy(DECAY, SQUARED, seed=1), problem)
    alone = selected(problem)
    assert names(chosen) == names(alone) == {"decay", "squared"}
    assert chosen.full.squares == pytest.approx(alone.full.squares, rel=1e-6)
    assert shares == sorted(shares)
    assert shares[-1] < 1.0


@pytest.mark.parametrize("shown", [(), (DECAY,), (CUBIC, SQUARED), (RIPPLE,)], ids=lambda some: str(len(some)))
def test_whatever_few_rows_show_all_of_them_decide(shown: tuple[ToyEffect, ...]) -> None:
    chosen, _ = begun_with(toy(*shown, seed=2), toy(DECAY, SQUARED))
    assert names(chosen) == {"decay", "squared"}
