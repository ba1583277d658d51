from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from benchctl.bench import Interlock
from benchctl.campaign.interlocks import Change, FollowedLimit, Interlocks, limits_of, words

VALUES = st.lists(st.floats(-10.0, 10.0), min_size=1, max_size=60)


def followed(interlock: Interlock, values: list[float], every_s: float = 1.0) -> list[Change]:
    """What changes while a quantity takes these values, one a look."""
    interlocks = Interlocks([interlock])
    return [
        change
        for number, value in enumerate(values)
        for change in interlocks.see(number * every_s, {interlock.quantity: (value, value)})
    ]


def hot(**more: object) -> Interlock:
    return Interlock.model_validate({"quantity": "gyro_c", "above": 5.0, **more})


def test_it_goes_on_beyond_the_limit_and_off_once_back_inside_by_the_hysteresis() -> None:
    changes = followed(hot(hysteresis=2.0), [4.9, 5.1, 4.0, 3.1, 3.0, 4.9])
    assert [(change.on, change.value, change.now_s) for change in changes] == [(True, 5.1, 1.0), (False, 3.0, 4.0)]


def test_at_the_limit_itself_nothing_is_passed() -> None:
    assert followed(hot(), [5.0, 5.0]) == []


def test_a_lower_limit_is_the_mirror_of_an_upper_one() -> None:
    changes = followed(Interlock(quantity="air_c", below=-5.0, hysteresis=1.0), [-5.0, -5.1, -4.1, -4.0])
    assert [(change.on, change.value) for change in changes] == [(True, -5.1), (False, -4.0)]
    assert changes[0].limit == "air_c below -5"


def test_an_excursion_counts_once_it_has_lasted_and_a_shorter_one_never() -> None:
    interlock = hot(hysteresis=1.0, for_s=3.0)
    assert followed(interlock, [6.0, 6.0, 6.0, 3.0, 6.0, 6.0, 3.0]) == []
    (change,) = followed(interlock, [6.0, 4.5, 6.0, 6.0, 6.0])
    assert (change.on, change.now_s, change.limit) == (True, 3.0, "gyro_c above 5 for 3 s")


def test_one_sample_of_a_look_that_is_beyond_begins_and_only_a_look_wholly_inside_ends() -> None:
    (limit,) = limits_of(hot(hysteresis=1.0))
    assert limit.see(0.0, (-9.0, 4.9)) is None
    begun = limit.see(1.0, (-9.0, 5.1))
    assert begun is not None
    assert begun.value == 5.1
    assert limit.see(2.0, (-9.0, 4.5)) is None
    ended = limit.see(3.0, (-9.0, 4.0))
    assert ended is not None
    assert not ended.on


def test_a_value_that_is_no_number_changes_nothing() -> None:
    assert followed(hot(), [math.nan, 4.0, math.nan]) == []
    assert [change.on for change in followed(hot(for_s=1.0), [6.0, math.nan, math.nan, 6.0])] == [True]
    assert [change.now_s for change in followed(hot(), [6.0, math.nan, 4.0])] == [0.0, 2.0]


def test_quantities_that_were_not_seen_keep_their_state() -> None:
    interlocks = Interlocks([hot(action="hold", give_up_s=60.0)])
    interlocks.see(0.0, {"gyro_c": (6.0, 6.0)})
    assert interlocks.see(1.0, {"air_c": (0.0, 0.0)}) == []
    assert [change.limit for change in interlocks.holds] == ["gyro_c above 5"]


def test_only_a_hold_that_is_on_is_waited_for() -> None:
    interlocks = Interlocks([hot(), hot(quantity="air_c", action="hold", give_up_s=60.0)])
    assert interlocks.may_hold
    interlocks.see(0.0, {"gyro_c": (6.0, 6.0)})
    assert interlocks.holds == []
    interlocks.see(1.0, {"air_c": (6.0, 6.0)})
    assert [change.now_s for change in interlocks.holds] == [1.0]
    interlocks.see(2.0, {"air_c": (4.0, 4.0)})
    assert interlocks.holds == []
    assert not Interlocks([hot()]).may_hold


@given(values=VALUES, hysteresis=st.floats(0.0, 5.0), for_s=st.integers(0, 5))
def test_changes_alternate_and_begin_with_on(values: list[float], hysteresis: float, for_s: int) -> None:
    changes = followed(hot(hysteresis=hysteresis, for_s=for_s), values)
    assert [change.on for change in changes] == [number % 2 == 0 for number in range(len(changes))]


@given(values=VALUES, hysteresis=st.floats(0.0, 5.0), for_s=st.integers(0, 5))
def test_what_never_passes_the_limit_never_changes_anything(values: list[float], hysteresis: float, for_s: int) -> None:
    assert followed(hot(hysteresis=hysteresis, for_s=for_s), [min(value, 5.0) for value in values]) == []


@given(
    inside=st.lists(st.floats(3.0, 7.0, exclude_min=True), min_size=1, max_size=60), begins=st.sampled_from([2.0, 8.0])
)
def test_nothing_chatters_within_the_hysteresis(inside: list[float], begins: float) -> None:
    """Between 3 and 5 the state stays what it was, and above 5 it can only be on: at most one change."""
    changes = followed(hot(hysteresis=2.0), [begins, *inside])
    assert [change.on for change in changes] == ([True] if begins == 8.0 or max(inside) > 5.0 else [])


@given(values=VALUES, for_s=st.integers(1, 6))
def test_a_delay_only_ever_takes_away(values: list[float], for_s: int) -> None:
    """While a delayed interlock is on, the one without delay is on too, and has been for as long as the delay."""
    prompt, (delayed,) = limits_of(hot(hysteresis=1.0))[0], limits_of(hot(hysteresis=1.0, for_s=for_s))
    for number, value in enumerate(values):
        prompt.see(float(number), (value, value))
        delayed.see(float(number), (value, value))
        if delayed.on is not None:
            assert prompt.on is not None
            assert number - prompt.on.now_s >= for_s


@given(values=VALUES, hysteresis=st.floats(0.0, 5.0), for_s=st.integers(0, 5))
def test_below_is_above_in_a_mirror(values: list[float], hysteresis: float, for_s: int) -> None:
    below = Interlock(quantity="gyro_c", below=-5.0, hysteresis=hysteresis, for_s=for_s)
    mirrored = followed(below, [-value for value in values])
    assert [(change.on, -change.value, change.now_s) for change in mirrored] == [
        (change.on, change.value, change.now_s) for change in followed(hot(hysteresis=hysteresis, for_s=for_s), values)
    ]


@pytest.mark.parametrize(
    ("fields", "says"),
    [
        ({}, "expected above, below or both"),
        ({"above": 5.0, "below": 6.0}, "nothing is left between below"),
        ({"above": 5.0, "below": 1.0, "hysteresis": 2.0}, "nothing is left between below"),
        ({"above": 5.0, "action": "hold"}, 'action = "hold" needs give_up_s'),
        ({"above": 5.0, "give_up_s": 60.0}, "no other action has one"),
        ({"above": 5.0, "hysteresis": -1.0}, "greater than or equal to 0"),
        ({"above": 5.0, "action": "shout"}, "'stop' or 'hold'"),
        (
            {"quantity": "encoder_dps", "above": 5.0, "action": "hold", "give_up_s": 60.0},
            "measured only while a step is recorded",
        ),
    ],
)
def test_an_interlock_that_makes_no_sense_is_refused(fields: dict[str, object], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        Interlock.model_validate({"quantity": "gyro_c", **fields})


def test_interlocks_in_words_name_every_limit_and_what_it_does() -> None:
    turns = Interlock(quantity="rate_dps", above=200.0, below=-200.0)
    assert words([turns, hot(for_s=30, action="hold", give_up_s=60)]) == (
        "rate_dps above 200 (stop), rate_dps below -200 (stop), gyro_c above 5 for 30 s (hold)"
    )


def test_both_sides_are_followed_each_by_itself() -> None:
    limits = limits_of(Interlock(quantity="gyro_v", above=5.0, below=-5.0))
    assert [limit.text for limit in limits] == ["gyro_v above 5", "gyro_v below -5"]
    assert all(isinstance(limit, FollowedLimit) for limit in limits)


def test_on_the_acceleration_controller_and_encoder_are_followed_each_by_itself() -> None:
    interlocks = Interlocks([Interlock(quantity="acceleration_dps2", above=5.0, for_s=2.0)])
    assert interlocks.see(0.0, {"encoder_dps2": (-1.0, 6.0)}) == []
    assert interlocks.see(1.0, {"acceleration_dps2": (0.0, 0.0)}) == []  # a poll that is inside ends nothing
    (change,) = interlocks.see(2.0, {"encoder_dps2": (-1.0, 7.0)})
    assert (change.on, change.value, change.limit) == (True, 7.0, "acceleration_dps2 by the encoder above 5 for 2 s")
    interlocks.see(3.0, {"acceleration_dps2": (6.0, 6.0)})
    (change,) = interlocks.see(5.0, {"acceleration_dps2": (6.0, 6.0)})
    assert change.limit == "acceleration_dps2 above 5 for 2 s"


def test_a_hold_on_the_acceleration_does_not_wait_for_an_encoder_that_nobody_reads_during_a_hold() -> None:
    interlocks = Interlocks([Interlock(quantity="acceleration_dps2", above=5.0, action="hold", give_up_s=60.0)])
    assert interlocks.see(0.0, {"encoder_dps2": (6.0, 6.0)}) == []
    interlocks.see(1.0, {"acceleration_dps2": (6.0, 6.0)})
    interlocks.see(2.0, {"acceleration_dps2": (0.0, 0.0)})
    assert interlocks.holds == []


def test_an_interlock_on_the_acceleration_is_told_once() -> None:
    assert words([Interlock(quantity="acceleration_dps2", above=5.0)]) == "acceleration_dps2 above 5 (stop)"
