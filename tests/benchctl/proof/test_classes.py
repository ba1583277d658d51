"""Which trials a proof has."""

from collections import Counter

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl.proof.classes import CLASSES, USUAL_TRIALS, allotted, class_names
from benchctl_instruments.errors import UsageError


def test_a_usual_proof_has_a_hundred_trials_with_nothing_missing_and_three_hundred_in_all() -> None:
    counts = Counter(allotted(USUAL_TRIALS))
    assert counts["nothing"] >= 100
    assert USUAL_TRIALS >= 300
    assert counts == {name: kind.weight for name, kind in CLASSES.items() if kind.usual}


@given(st.integers(1, 400), st.integers(1, 400))
def test_more_trials_begin_with_the_same_ones(few: int, more: int) -> None:
    few, more = sorted((few, more))
    assert allotted(more)[:few] == allotted(few)


@given(st.integers(1, 400))
def test_every_beginning_is_a_fair_sample(trials: int) -> None:
    counts = Counter(allotted(trials))
    for name, kind in CLASSES.items():
        assert not kind.usual or abs(counts[name] - trials * kind.weight / USUAL_TRIALS) < 2.0


def test_classes_can_be_chosen_and_one_that_is_not_there_is_named() -> None:
    assert set(allotted(30, class_names(["pair", "faint"]))) == {"faint", "pair"}
    with pytest.raises(UsageError, match=r"class 'pear': there is no such class of trials; did you mean pair\?"):
        class_names(["pear"])
    with pytest.raises(UsageError, match=r"class 'xyz': there is no such class of trials; .*nothing, moved"):
        class_names(["xyz"])


def test_trials_with_structures_or_of_other_parts_come_only_where_they_are_asked_for() -> None:
    assert not {name for name in allotted(340) if name.startswith(("structure", "drive", "chamber"))}
    assert allotted(3, ("structure",)) == ("structure",) * 3
