"""What a recording would have shown: held against effects of just that size."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from benchctl.diagnosis.findings.not_found import not_found_of
from benchctl.diagnosis.result import NotFound
from benchctl.diagnosis.search.select import select
from benchctl.diagnosis.search.selection import Selection
from tests.benchctl.diagnosis.search.test_screen import Sizeless, Steeper
from tests.benchctl.diagnosis.toy_problem import EFFECTS, NOISE_V, Cubic, Decay, Ripple, Squared, Toy, toy


def selected(problem: Toy) -> Selection:
    return select(problem, seed=0, progress=lambda _name, _share: None)


def missed(problem: Toy, *found: str) -> dict[str, NotFound]:
    return {one.effect: one for one in not_found_of(selected(problem), found)}


def test_every_other_effect_has_one_entry() -> None:
    assert set(missed(toy())) == set(EFFECTS)
    assert set(missed(toy(Squared(size_v=3e-3)), "squared")) == set(EFFECTS) - {"squared"}


@pytest.mark.parametrize(("times", "least", "most"), [(1.25, 55, 60), (1.0, 46, 60), (0.25, 0, 5)])
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


def test_what_the_model_follows_already_is_said_to_be_part_of_it() -> None:
    one = missed(toy(hypotheses=[Steeper, Cubic]))["steeper"]
    assert one.smallest is None
    assert one.says == "Part of the lab's model already: its own parameters follow it."
    assert missed(toy(hypotheses=[Steeper, Cubic]))["cubic"].says == ""


def test_an_effect_without_a_size_has_no_smallest() -> None:
    assert set(missed(toy(hypotheses=[Sizeless, Ripple]))) == {"ripple"}


def test_what_was_chosen_out_of_many_places_must_be_larger() -> None:
    chosen = selected(toy(hypotheses=[Squared]))
    (scored,) = chosen.screening.scored
    many = replace(scored, probe=replace(scored.probe, places=1e5))
    (one,) = not_found_of(chosen, ())
    (other,) = not_found_of(replace(chosen, screening=replace(chosen.screening, scored=(many,))), ())
    threshold = chosen.screening.threshold
    grown = (math.sqrt(threshold + 2.0 * math.log(1e5)) + 1.645) / (math.sqrt(threshold) + 1.645)
    assert (other.smallest or 0.0) / (one.smallest or 1.0) == pytest.approx(grown)
    assert np.isfinite(grown)


def _at(tau_s: float) -> type[Decay]:
    parameter = replace(Decay.parameters["tau_s"], scan=(tau_s,))

    class One(Decay):
        parameters = {**Decay.parameters, "tau_s": parameter}  # noqa: RUF012

    return One
