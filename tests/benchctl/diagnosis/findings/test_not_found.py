"""What a recording would have shown: held against effects of just that size."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest

from benchctl.diagnosis.findings.not_found import not_found_of, unseen_in
from benchctl.diagnosis.result import NotFound
from benchctl.diagnosis.search.select import select
from benchctl.diagnosis.search.selection import Selection
from tests.benchctl.diagnosis.search.test_screen import Sizeless, Steeper
from tests.benchctl.diagnosis.toy_problem import EFFECTS, NOISE_V, Cubic, Decay, Quintic, Ripple, Squared, Toy, toy


def selected(problem: Toy) -> Selection:
    return select(problem, seed=0, progress=lambda _name, _share: None)


def missed(problem: Toy, *stated: str) -> dict[str, NotFound]:
    found = not_found_of(problem, selected(problem), stated, unexplained=False)
    return {one.effect: one for one in found}


def test_every_other_effect_has_one_entry() -> None:
    assert set(missed(toy())) == set(EFFECTS)
    assert set(missed(toy(Squared(size_v=3e-3)), "squared")) == set(EFFECTS) - {"squared"}


def test_where_something_unexplained_is_left_nothing_is_excluded() -> None:
    problem = toy()
    assert not_found_of(problem, selected(problem), (), unexplained=True) == ()


def test_what_is_in_the_recording_and_was_not_found_is_not_excluded() -> None:
    """As large as the drift that hides it, of either sign: put in with the other it would not be seen."""
    hidden = Cubic(size_v=-0.05)
    problem = toy(hidden, Decay(amplitude_v=0.5, tau_s=200.0), hypotheses=[Cubic])
    chosen = selected(problem)
    assert not chosen.after.point.effects
    (one,) = not_found_of(problem, chosen, (), unexplained=False) or (None,)
    assert one is None or (one.smallest or 0.0) > 0.05


@pytest.mark.parametrize(
    ("times", "least", "most"),
    [pytest.param(1.25, 50, 60, marks=pytest.mark.slow), (1.0, 46, 60), (0.25, 0, 5)],
)
def test_an_effect_of_the_smallest_size_is_found_and_one_of_a_quarter_is_not(
    times: float, least: int, most: int
) -> None:
    """At the stated size one in twenty is missed."""
    smallest = missed(toy(hypotheses=[Squared]))["squared"].smallest
    assert smallest is not None
    truth = Squared(size_v=times * smallest)
    found = sum(
        bool(selected(toy(truth, seed=seed, hypotheses=[Squared])).after.point.effects) for seed in range(1000, 1060)
    )
    assert least <= found <= most


@pytest.mark.parametrize("kind", [Cubic, Squared, Decay])
def test_the_stated_size_put_into_the_very_recording_is_named_in_either_direction(kind: type[Cubic]) -> None:
    problem = toy(Ripple(amplitude_v=5e-3, phase_deg=40.0, order=2.0), seed=3)
    one = missed(problem, "ripple", "quintic")[kind.identifier]
    assert one.smallest is not None
    for sign in (1.0, -1.0):
        effect = kind.make({**one.others, one.parameter: sign * one.smallest})
        chosen = selected(replace(problem, measured=problem.measured + effect.column(problem)))
        named = {each.identifier for each in chosen.after.point.effects}
        assert kind.identifier in named.union(*(each.rivals for each in chosen.evidence.values()))


def test_the_size_is_in_its_own_unit_and_in_proportion_to_the_noise() -> None:
    quiet, loud = missed(toy(hypotheses=[Squared])), missed(toy(hypotheses=[Squared], noise_v=3.0 * NOISE_V))
    assert quiet["squared"].parameter == "size_v"
    assert quiet["squared"].unit == "V"
    assert loud["squared"].smallest == pytest.approx(3.0 * (quiet["squared"].smallest or math.nan), rel=0.01)


def test_of_many_places_the_one_that_shows_best_is_stated() -> None:
    problem = toy()
    decay = missed(problem)["decay"]
    assert decay.parameter == "amplitude_v"
    sizes = {
        tau_s: missed(replace(problem, effects={"decay": _at(tau_s)}))["decay"].smallest or math.inf
        for tau_s in Decay.parameters["tau_s"].scan
    }
    assert decay.others == {"tau_s": min(sizes, key=lambda tau_s: sizes[tau_s])}
    assert missed(problem)["ripple"].others.keys() == {"order"}


def test_what_the_model_follows_already_is_not_excluded_but_said_to_be_unobservable() -> None:
    problem = toy(hypotheses=[Steeper, Cubic])
    assert set(missed(problem)) == {"cubic"}
    (said,) = unseen_in(selected(problem), ())
    assert said == "Not observable in this recording: steeper (the model follows it)."
    assert not list(unseen_in(selected(problem), ("steeper",)))


def test_an_effect_without_a_size_has_no_smallest() -> None:
    assert set(missed(toy(hypotheses=[Sizeless, Ripple]))) == {"ripple"}


def test_what_was_chosen_out_of_many_places_must_be_larger() -> None:
    problem = toy(hypotheses=[Squared])
    chosen = selected(problem)
    (scored,) = chosen.screening.scored
    many = replace(scored, probe=replace(scored.probe, places=1e5))
    (one,) = not_found_of(problem, chosen, (), unexplained=False)
    wider = replace(chosen, screening=replace(chosen.screening, scored=(many,)))
    (other,) = not_found_of(problem, wider, (), unexplained=False)
    grown = (math.sqrt(chosen.least + 2.0 * math.log(1e5)) + 1.645) / (math.sqrt(chosen.least) + 1.645)
    assert (other.smallest or 0.0) / (one.smallest or 1.0) == pytest.approx(grown)


def test_an_alternative_of_a_finding_is_not_excluded() -> None:
    problem = toy(Cubic(size_v=5e-3))
    assert "quintic" not in missed(problem, "cubic", Quintic.identifier)


def _at(tau_s: float) -> type[Decay]:
    parameter = replace(Decay.parameters["tau_s"], scan=(tau_s,))

    class One(Decay):
        parameters = {**Decay.parameters, "tau_s": parameter}  # noqa: RUF012

    return One
