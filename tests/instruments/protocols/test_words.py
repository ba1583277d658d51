"""Numbers in registers, held against numbers that somebody else wrote down."""

from __future__ import annotations

import math
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchctl_instruments.protocols.modbus import (
    WordOrder,
    f32_from_words,
    signed_from_word,
    u32_from_words,
    word_from_signed,
    words_from_f32,
    words_from_u32,
)


def test_the_labjack_test_registers_read_as_their_manual_says() -> None:
    assert u32_from_words([0x0011, 0x2233], "high_first") == 0x00112233
    assert u32_from_words([0x0011, 0x2233], "low_first") == 0x22330011
    assert f32_from_words([0xC61C, 0x3C00], "high_first") == -9999.0


@pytest.mark.parametrize(
    ("value", "words"), [(25.0, [0x0000, 0x41C8]), (-40.5, [0x0000, 0xC222]), (0.1, [0xCCCD, 0x3DCC])]
)
def test_a_single_goes_low_word_first_as_the_watlow_f4t_sends_it(value: float, words: list[int]) -> None:
    assert words_from_f32(value, "low_first") == words
    assert words_from_f32(value, "high_first") == words[::-1]


def test_a_single_in_the_wrong_word_order_is_not_a_temperature() -> None:
    assert f32_from_words(words_from_f32(25.0, "low_first"), "high_first") == pytest.approx(2.3597866e-41)


@pytest.mark.parametrize(("value", "word"), [(0, 0), (250, 250), (-1, 0xFFFF), (-400, 0xFE70), (-32768, 0x8000)])
def test_negative_numbers_are_twos_complement(value: int, word: int) -> None:
    assert word_from_signed(value) == word
    assert signed_from_word(word) == value


@pytest.mark.parametrize("value", [32768, -32769])
def test_what_does_not_fit_into_a_signed_register_is_refused(value: int) -> None:
    with pytest.raises(ValueError, match="does not fit"):
        word_from_signed(value)


@given(st.floats(width=32), st.sampled_from(["high_first", "low_first"]))
def test_every_single_survives_its_words(value: float, word_order: WordOrder) -> None:
    back = f32_from_words(words_from_f32(value, word_order), word_order)
    assert struct.pack(">f", back) == struct.pack(">f", value) or math.isnan(value)


@given(st.integers(0, 0xFFFFFFFF), st.sampled_from(["high_first", "low_first"]))
def test_every_unsigned_number_survives_its_words(value: int, word_order: WordOrder) -> None:
    assert u32_from_words(words_from_u32(value, word_order), word_order) == value


def test_what_does_not_fit_into_two_registers_is_refused() -> None:
    with pytest.raises(OverflowError):
        words_from_f32(1e39, "high_first")
    with pytest.raises(OverflowError):
        words_from_u32(-1, "high_first")
