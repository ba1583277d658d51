"""Sizes that are drawn are sizes that effects may have."""

import itertools
from functools import cache

import numpy as np
import pytest

from benchctl.proof.sizes import DRAWN, STATISTICAL, WANDERING, drawn_size, shrunk
from benchctl.proof.unit import TrialUnit, draw_unit
from benchctl_instruments.physics.effects.making import make_effects
from benchctl_instruments.physics.effects.registry import effects


@cache
def units() -> list[TrialUnit]:
    return [draw_unit(np.random.default_rng(seed), moved=False, lacking=frozenset(), warm=True) for seed in range(3)]


@pytest.mark.parametrize("name", DRAWN)
def test_every_size_is_one_that_the_effect_takes(name: str) -> None:
    for unit, share in itertools.product(units(), (1.0, 0.25, 0.1)):
        full = drawn_size(name, np.random.default_rng(7), unit)
        (made,) = make_effects({name: shrunk(name, full, share, unit)})
        assert made.identifier == name
        assert all(np.isfinite(value) for value in made.values.values()), share


@pytest.mark.parametrize("name", [name for name in DRAWN if name not in STATISTICAL])
def test_a_share_of_a_size_is_another_size_and_the_whole_is_the_same(name: str) -> None:
    for unit in units():
        full = drawn_size(name, np.random.default_rng(7), unit)
        assert shrunk(name, full, 1.0, unit) == pytest.approx(full)
        assert shrunk(name, full, 0.25, unit) != full


def test_all_effects_are_drawn_but_the_one_whose_channel_the_bench_does_not_record() -> None:
    assert set(effects()) - set(DRAWN) == {"supply_sensitivity", "overload"}
    assert set(WANDERING) <= STATISTICAL <= set(DRAWN)
