"""Envelopes, from samples and from blocks, are those of all samples; held against a count by hand."""

from typing import Any

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.dashboard.data.envelope import Envelope, Pyramid, blocks_of, coarser, or_none
from benchctl_instruments.arrays import FloatArray
from tests.benchctl.dashboard.data import brute


def _view(envelope: Envelope) -> dict[str, Any]:
    return {"t_s": envelope.begins_s.tolist(), "low": or_none(envelope.low), "high": or_none(envelope.high)}


@st.composite
def recordings(draw: st.DrawFn) -> tuple[FloatArray, FloatArray]:
    """Ascending times with gaps, values with NaN among them."""
    steps = draw(st.lists(st.sampled_from([0.01, 0.01, 0.01, 0.02, 1.0, 30.0]), max_size=400))
    time_s = np.cumsum(np.array([draw(st.floats(-5.0, 5.0)), *steps]))
    numbers = st.one_of(st.floats(-1e6, 1e6), st.just(float("nan")))
    few = draw(st.lists(numbers, min_size=1, max_size=40))
    values = np.resize(np.array(few), len(time_s))
    return time_s, values


windows = st.tuples(st.floats(-10.0, 300.0), st.floats(0.001, 400.0)).map(lambda pair: (pair[0], pair[0] + pair[1]))


@settings(deadline=None, max_examples=40)
@given(recordings(), windows, st.integers(1, 40))
def test_samples_are_put_into_the_pixel_they_lie_in(
    recording: tuple[FloatArray, FloatArray], window: tuple[float, float], pixels: int
) -> None:
    time_s, values = recording
    envelope = Envelope(*window, pixels)
    for begin in range(0, len(time_s), 97):
        envelope.add_samples(time_s[begin : begin + 97], values[begin : begin + 97])
    brute.assert_is_of(_view(envelope), time_s, values, window[1])
    assert envelope.samples == np.count_nonzero((time_s >= window[0]) & (time_s <= window[1]))
    assert _view(envelope)["t_s"] == envelope.edges_s[:-1].tolist()


@settings(deadline=None, max_examples=60)
@given(recordings(), windows, st.integers(1, 40), st.integers(1, 9))
def test_a_pyramid_gives_what_the_samples_give(
    recording: tuple[FloatArray, FloatArray], window: tuple[float, float], pixels: int, size: int
) -> None:
    time_s, values = recording
    rows = blocks_of(time_s, values, size)
    pyramid = Pyramid(lambda first, end: rows[first:end])
    for blocks in (*range(0, len(rows), 50), len(rows)):  # it grows bit by bit
        pyramid.extend(blocks)
    envelope = Envelope(*window, pixels)
    for first, end in pyramid.fill(envelope):
        envelope.add_samples(time_s[first * size : end * size], values[first * size : end * size])
    brute.assert_is_of(_view(envelope), time_s, values, window[1])
    assert envelope.samples == np.count_nonzero((time_s >= window[0]) & (time_s <= window[1]))
    assert _view(envelope)["t_s"] == sorted(_view(envelope)["t_s"])
    moved = np.array(_view(envelope)["t_s"]) - envelope.edges_s[:-1]
    assert (moved >= 0).all()
    assert (moved < envelope.width_s * 1.0001).all()


def test_a_pixel_of_nothing_but_nan_is_none() -> None:
    envelope = Envelope(0.0, 2.0, 2)
    envelope.add_samples(np.array([0.5, 1.5]), np.array([np.nan, 3.0]))
    assert _view(envelope) == {"t_s": [0.0, 1.0], "low": [None, 3.0], "high": [None, 3.0]}


def test_samples_out_of_order_still_reach_their_pixels() -> None:
    envelope = Envelope(0.0, 2.0, 2)
    envelope.add_samples(np.array([1.5, 0.5, np.nan, 2.0]), np.array([3.0, 1.0, 9.0, 5.0]))
    assert _view(envelope) == {"t_s": [0.0, 1.0], "low": [1.0, 3.0], "high": [1.0, 5.0]}


def test_what_is_not_finite_is_none_in_json() -> None:
    assert or_none(np.array([1.0, np.nan, np.inf, -np.inf])) == [1.0, None, None, None]


def test_blocks_count_every_sample_and_say_when_they_begin_and_end() -> None:
    rows = blocks_of(np.arange(5.0), np.array([3.0, 1.0, 2.0, np.nan, 7.0]), 2)
    assert rows[:, [0, 1, 4]].tolist() == [[0.0, 1.0, 2.0], [2.0, 3.0, 2.0], [4.0, 4.0, 1.0]]
    assert rows[:, [2, 3]].tolist() == [[1.0, 3.0], [2.0, 2.0], [7.0, 7.0]]
    assert coarser(rows).tolist() == [[0.0, 4.0, 1.0, 7.0, 5.0]]
    assert len(blocks_of(np.empty(0), np.empty(0))) == len(coarser(np.empty((0, 5)))) == 0
