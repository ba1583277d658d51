"""Every harness takes its seeds and all that its corpus keeps, and what random changes make of them."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from tests.fuzz.harness import Harness, clear_workplace, harness, harness_names, timed
from tests.fuzz.isolated import changes, run_isolated

_FEW, _MANY = 25, 1000


@pytest.fixture(autouse=True)
def _own_workplace() -> Iterator[None]:
    yield
    clear_workplace()


@pytest.mark.parametrize("name", harness_names())
def test_what_once_mattered_is_taken_or_refused_in_words(name: str) -> None:
    one = harness(name)
    _give(one, [*one.inputs(), b"", b"\0", b"\xff"])


@pytest.mark.parametrize("name", harness_names())
def test_a_few_random_changes_break_no_parser(name: str) -> None:
    _change(harness(name), _FEW, seed=1)


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.parametrize("name", harness_names())
def test_a_thousand_random_changes_break_no_parser(name: str) -> None:
    _change(harness(name), _MANY, seed=2)


def _change(one: Harness, times: int, seed: int) -> None:
    made = changes(one, seed)
    known = len(one.inputs())
    _give(one, [made(known + place) for place in range(times)])


def _give(one: Harness, inputs: list[bytes]) -> None:
    """Inputs to a harness; one that rests on a library in C may die of them, elsewhere, or be long, but not fail."""
    if one.native:
        found = run_isolated(one, inputs.__getitem__, len(inputs))
        assert found.faults == []
        assert found.inputs == len(inputs)
        return
    for data in inputs:
        timed(one, data)
