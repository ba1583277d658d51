"""An effect is explained by its registry alone, whoever wrote it."""

from __future__ import annotations

import pytest

from benchctl.explain.book import explained, find, symbols
from benchctl.explain.sizes import usual_sizes
from benchctl.proof.sizes import DRAWN
from benchctl_instruments.physics.chamber_effects.registry import chamber_effects
from benchctl_instruments.physics.drive_effects.registry import drive_effects
from benchctl_instruments.physics.effects.registry import effects

EVERY = {**effects(), **drive_effects(), **chamber_effects()}


@pytest.mark.parametrize("identifier", EVERY)
def test_words_equation_and_parameters_are_the_registrys_own(identifier: str) -> None:
    told, kind = explained(identifier), EVERY[identifier]
    assert (told["words"], told["equation"]) == (kind.words, kind.equation)
    assert told["look_alikes"] == list(kind.look_alikes)
    assert [one["name"] for one in told["parameters"]] == list(kind.parameters)
    for one in told["parameters"]:
        described = kind.parameters[one["name"]]
        assert (one["meaning"], one["low"], one["high"]) == (described.meaning, described.low, described.high)
    facts = {one["label"]: one["says"] for one in told["facts"]}
    assert facts["Brought out by"] == kind.excited_by
    assert kind.coordinate in facts["Depends on"]


@pytest.mark.parametrize("identifier", EVERY)
def test_some_letter_of_every_equation_is_told(identifier: str) -> None:
    assert symbols(find(identifier)[0])


@pytest.mark.parametrize("identifier", DRAWN)
def test_usual_sizes_lie_inside_the_bounds(identifier: str) -> None:
    for name, (low, high) in usual_sizes(identifier).items():
        bounds = effects()[identifier].parameters[name]
        assert 0.0 < low <= high <= bounds.high


def test_usual_sizes_are_those_that_the_sealed_trials_draw() -> None:
    assert usual_sizes("thermal_lag") == {"tau_s": (200.0, 900.0)}
    low, high = usual_sizes("scale_asymmetry")["fraction"]
    assert (low, high) == pytest.approx((5e-4, 4e-3), rel=0.05)


def test_of_an_effect_that_no_trial_draws_no_usual_size_is_stated() -> None:
    assert usual_sizes("supply_sensitivity") == {}
    assert all(one["usual"] is None for one in explained("coulomb_friction")["parameters"])


def test_the_other_meanings_stand_beside_the_first() -> None:
    told = explained("dead zone")
    assert (told["kind"], told["name"]) == ("effect of the gyro's chain", "dead_zone")
    (metric,) = told["also_means"]
    assert (metric["kind"], metric["equation"]) == ("metric", "|dF/dΩ| < 0.5·K")
