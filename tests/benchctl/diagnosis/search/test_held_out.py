"""Which steps are kept for the proof."""

from __future__ import annotations

import numpy as np

from benchctl.diagnosis.search.held_out import dealt, held_out_steps
from tests.benchctl.diagnosis.toy_problem import KINDS, STEPS, toy


def test_one_step_in_six_of_each_kind_is_held_out() -> None:
    held = held_out_steps(toy())
    kinds = np.array([KINDS[i % 3] for i in range(STEPS)])
    # eight steps of each: the fourth of every six
    assert {kind: int(held[kinds == kind].sum()) for kind in KINDS} == dict.fromkeys(KINDS, 1)
    assert np.flatnonzero(held).tolist() == [9, 10, 11]


def test_the_steps_of_each_kind_are_dealt_out_in_turn() -> None:
    turns = dealt(toy())
    kinds = np.array([KINDS[i % 3] for i in range(STEPS)])
    for kind in KINDS:
        assert turns[kinds == kind].tolist() == [0, 1, 2, 3, 4, 5, 0, 1]
