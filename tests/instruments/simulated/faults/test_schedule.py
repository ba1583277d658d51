"""The rule that says when a fault happens, against its own words, over any sequence of operations."""

from __future__ import annotations

import math
import re
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl_instruments.simulated.faults.schedule import FaultTable, Schedule


def when(**conditions: Any) -> FaultTable:
    return FaultTable(on="chamber", kind="any", **conditions)


INSTANTS = st.floats(0.0, 1000.0)
OPERATIONS = st.lists(st.tuples(st.sampled_from(["read 100", "write 300", "read 300"]), INSTANTS), max_size=60).map(
    lambda operations: sorted(operations, key=lambda operation: operation[1])
)
WINDOWS = st.tuples(INSTANTS, INSTANTS | st.just(math.inf)).filter(lambda window: window[0] < window[1])
PATTERNS = st.sampled_from(["", "read", "300$", "^write", "nothing like it"])


@st.composite
def rules(draw: st.DrawFn) -> FaultTable:
    from_s, to_s = draw(WINDOWS)
    return when(
        pattern=draw(PATTERNS),
        from_s=from_s,
        to_s=to_s,
        nth=draw(st.none() | st.integers(1, 9)),
        every=draw(st.none() | st.integers(1, 9)),
        every_s=draw(st.none() | st.floats(0.5, 500.0)),
        times=draw(st.none() | st.integers(1, 9)),
    )


def fired(rule: FaultTable, operations: list[tuple[str, float]]) -> list[int]:
    schedule = Schedule(rule)
    return [place for place, (operation, now_s) in enumerate(operations) if schedule.fires(operation, now_s)]


def concerned(rule: FaultTable, operations: list[tuple[str, float]]) -> list[int]:
    """The operations that the pattern and the window admit, by their places."""
    return [
        place
        for place, (operation, now_s) in enumerate(operations)
        if rule.from_s <= now_s < rule.to_s and re.search(rule.pattern, operation)
    ]


@given(rules(), OPERATIONS)
def test_the_same_operations_fire_the_same_faults(rule: FaultTable, operations: list[tuple[str, float]]) -> None:
    assert fired(rule, operations) == fired(rule, operations)


@given(rules(), OPERATIONS)
def test_nothing_happens_outside_the_window_or_to_what_the_pattern_does_not_name(
    rule: FaultTable, operations: list[tuple[str, float]]
) -> None:
    assert set(fired(rule, operations)) <= set(concerned(rule, operations))


@given(rules(), OPERATIONS, OPERATIONS)
def test_what_has_happened_does_not_depend_on_what_is_still_to_come(
    rule: FaultTable, operations: list[tuple[str, float]], more: list[tuple[str, float]]
) -> None:
    later = [*operations, *((operation, now_s + 1000.0) for operation, now_s in more)]
    assert [place for place in fired(rule, later) if place < len(operations)] == fired(rule, operations)


@given(rules(), OPERATIONS, st.integers(1, 5))
def test_a_count_limit_keeps_the_first_ones(rule: FaultTable, operations: list[tuple[str, float]], times: int) -> None:
    unlimited = rule.model_copy(update={"times": None, "every_s": None})
    assert fired(unlimited.model_copy(update={"times": times}), operations) == fired(unlimited, operations)[:times]


@given(WINDOWS, PATTERNS, OPERATIONS, st.integers(1, 9))
def test_nth_and_every_count_only_what_pattern_and_window_admit(
    window: tuple[float, float], pattern: str, operations: list[tuple[str, float]], number: int
) -> None:
    rule = when(pattern=pattern, from_s=window[0], to_s=window[1])
    all_of_them = concerned(rule, operations)
    assert fired(rule, operations) == all_of_them
    assert fired(rule.model_copy(update={"nth": number}), operations) == all_of_them[number - 1 : number]
    assert fired(rule.model_copy(update={"every": number}), operations) == all_of_them[number - 1 :: number]


@given(st.floats(0.5, 500.0), INSTANTS, OPERATIONS)
def test_each_stretch_of_bench_time_has_at_most_one_and_its_first(
    every_s: float, from_s: float, operations: list[tuple[str, float]]
) -> None:
    rule = when(from_s=from_s, every_s=every_s)
    first_of = {}
    for place in concerned(rule, operations):
        first_of.setdefault(math.floor((operations[place][1] - from_s) / every_s), place)
    assert fired(rule, operations) == sorted(first_of.values())


@pytest.mark.parametrize(
    ("rule", "places"),
    [
        (when(), [0, 1, 2, 3, 4, 5]),
        (when(nth=3), [2]),
        (when(every=2), [1, 3, 5]),
        (when(every=2, times=1), [1]),
        (when(from_s=1.0, to_s=4.0), [1, 2, 3]),
        (when(from_s=1.0, nth=2), [2]),
        (when(pattern="b"), [1, 3, 5]),
        (when(every_s=2.0), [0, 2, 4]),
    ],
)
def test_six_operations_a_second_apart(rule: FaultTable, places: list[int]) -> None:
    assert fired(rule, [("ab"[place % 2], float(place)) for place in range(6)]) == places
