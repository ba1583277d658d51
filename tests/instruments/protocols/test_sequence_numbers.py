from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl_instruments.protocols.frames import SequenceNumbers, commonest_step


def test_numbers_that_wrap_become_an_index_that_does_not() -> None:
    numbers = SequenceNumbers(128)
    index, missing = numbers.unwrap(np.array([126, 127, 0, 1]))
    assert index.tolist() == [0, 1, 2, 3]
    assert missing.tolist() == [0, 0, 0, 0]
    assert numbers.unwrap(np.array([2]))[0].tolist() == [4]
    assert numbers.lost == 0


def test_a_jump_is_a_loss_just_before_the_frame_that_shows_it() -> None:
    numbers = SequenceNumbers(128)
    numbers.unwrap(np.array([5]))
    index, missing = numbers.unwrap(np.array([9, 10, 4]))
    assert missing.tolist() == [3, 0, 121]
    assert index.tolist() == [4, 5, 127]
    assert numbers.lost == 124


def test_no_frames_change_nothing() -> None:
    numbers = SequenceNumbers(256)
    index, missing = numbers.unwrap(np.array([], np.int64))
    assert index.size == missing.size == 0
    assert numbers.unwrap(np.array([7]))[0].tolist() == [0]


@settings(deadline=None)
@given(
    st.sampled_from([(128, 1), (256, 1), (256, 9), (256, 16), (256, 8), (256, 255)]),
    st.integers(0, 255),
    st.lists(st.integers(0, 14), min_size=1, max_size=60),
    st.integers(1, 7),
)
def test_losses_shorter_than_a_period_are_counted_in_whatever_pieces_frames_come(
    numbering: tuple[int, int], first: int, losses: list[int], piece: int
) -> None:
    modulus, step = numbering
    true_index = np.cumsum(np.array([0, *losses[1:]]) + 1) - 1
    stated = (first + step * true_index) % modulus
    numbers = SequenceNumbers(modulus, step=step)
    found = [numbers.unwrap(stated[at : at + piece]) for at in range(0, stated.size, piece)]
    assert np.concatenate([index for index, _ in found]).tolist() == true_index.tolist()
    assert np.concatenate([missing for _, missing in found]).tolist() == [0, *losses[1:]]
    assert numbers.lost == sum(losses[1:])


def test_a_loss_of_a_whole_period_cannot_be_seen() -> None:
    numbers = SequenceNumbers(256, step=16)
    assert numbers.period == 16
    assert numbers.unwrap(np.array([0, 16 * 17 % 256]))[1].tolist() == [0, 0]


@pytest.mark.parametrize("step", [1, 9, 16, 255])
def test_the_commonest_step_is_found_beside_losses(step: int) -> None:
    index = np.array([0, 1, 2, 5, 6, 7, 9, 10])
    assert commonest_step((200 + index * step) % 256, 256) == step
