from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchctl.diagnosis.faults import faults_in
from benchctl.recordings.runs import gap_free
from tests.benchctl.diagnosis.faults.made import INTERVAL_S, STEP_V, Made, made, motion

FINE = made()


def test_nothing_is_found_where_nothing_is_wrong() -> None:
    found = FINE.faults()
    assert found.found == ()
    assert not found.masked.any()


@settings(max_examples=15, deadline=None)
@given(
    rows=st.integers(25, 250),
    places=st.lists(st.integers(1, 110), min_size=1, max_size=12, unique=True),
    shift=st.integers(1, 200),
)
@pytest.mark.slow
def test_held_samples_are_counted_timed_and_masked_at_rest_and_in_motion(
    rows: int, places: list[int], shift: int
) -> None:
    starts = [500 * place + shift for place in places]
    faults = FINE.held(starts, rows).faults()
    (fault,) = faults.found
    assert fault.effect == "dropouts"
    assert fault.parameters["count"].value == len(places)
    hold = fault.parameters["hold_s"]
    assert hold.low - 1e-9 <= rows * INTERVAL_S <= hold.high + 1e-9
    wanted = np.zeros(FINE.volts.size, np.bool_)
    for start in starts:
        wanted[start : start + rows] = True
    assert not (wanted & ~faults.masked).any()
    # an equal value after the hold may be taken for held
    assert (faults.masked & ~wanted).sum() <= 2 * len(places)


@pytest.mark.parametrize("bits", range(1, 6))
@pytest.mark.parametrize("noise_v", [1e-4, 3e-4, 7e-4])
def test_equal_neighbours_of_a_coarse_converter_are_no_dropouts(bits: int, noise_v: float) -> None:
    coarse = made(step_v=STEP_V * 2**bits, noise_v=noise_v, model_error=0.02)
    assert [one.effect for one in coarse.faults().found] == ["adc_coarse"]


@pytest.mark.parametrize("noise_v", [8e-5, 1.5e-4, 3.4e-4])
@pytest.mark.parametrize("limit_v", [1.2, 1.25, 2.05])
def test_equal_neighbours_at_a_limit_before_the_noise_are_no_dropouts(limit_v: float, noise_v: float) -> None:
    clean = motion(2)
    for seed in range(3):
        noise = noise_v * np.random.default_rng(seed).standard_normal(clean.size)
        limited = np.rint((np.clip(clean, -limit_v, limit_v) + noise) / STEP_V) * STEP_V
        assert Made(predicted=1.001 * clean, volts=np.round(limited, 6)).faults().found == ()


def test_a_few_equal_values_are_no_hold_where_a_moving_output_often_repeats_one() -> None:
    step_v = STEP_V / 16
    held = made(step_v=step_v).held([6000, 11_000, 16_000], 3)
    assert [one.effect for one in held.faults(adc_step_v=step_v).found] == ["dropouts"]
    often = held.held(list(range(2040, held.volts.size - 2, 150)), 1)
    assert often.faults(adc_step_v=step_v).found == ()


def test_an_output_printed_coarsely_that_repeats_at_rest_before_a_noisy_motion_is_not_held() -> None:
    step_v = 0.01
    swing = 0.5 * np.sin(2 * np.pi * 0.5 * INTERVAL_S * np.arange(2000))
    predicted = np.concatenate([np.zeros(230), swing])
    noise = np.concatenate([np.zeros(230), 0.02 * np.random.default_rng(1).standard_normal(swing.size)])
    printed = Made(predicted=predicted, volts=np.round(predicted + noise, 2))
    assert printed.faults(adc_step_v=step_v).found == ()
    held = printed.held([900, 1500], 25).faults(adc_step_v=step_v)
    assert [one.effect for one in held.found] == ["dropouts"]
    assert not held.standing[:230].any()


@pytest.mark.parametrize("rows", [2, 3, 5])
def test_of_values_that_a_fast_recorder_repeats_the_first_rows_are_used_at_rest_too(rows: int) -> None:
    index = np.arange(FINE.volts.size)
    repeated = replace(FINE, volts=FINE.volts[index // rows * rows]).faults()
    assert (repeated.found, repeated.rows_per_value) == ((), rows)
    np.testing.assert_array_equal(np.flatnonzero(~repeated.masked), index[::rows])
    assert FINE.faults().rows_per_value == 1


@pytest.mark.parametrize("late", [-1, 1])
def test_a_coarse_output_that_is_late_or_early_stands_not_still(late: int) -> None:
    coarse = made(step_v=STEP_V * 32, noise_v=2e-4)
    moved = Made(predicted=np.roll(coarse.predicted, late), volts=coarse.volts)
    assert [one.effect for one in moved.faults().found] == ["adc_coarse"]


def test_holds_on_a_coarse_converter_are_found_where_the_output_should_have_moved() -> None:
    moving = [4300, 5300, 6500, 9000, 11_500]
    coarse = made(step_v=STEP_V * 32, noise_v=3e-4).held([*moving, 700], 60)
    fault = next(one for one in coarse.faults().found if one.effect == "dropouts")
    count = fault.parameters["count"]
    assert count.low == len(moving)
    assert count.low < 6 <= count.high


def test_a_channel_that_is_dead_all_along_has_no_dropouts() -> None:
    dead = Made(predicted=FINE.predicted, volts=np.full_like(FINE.volts, 0.125))
    assert dead.faults().found == ()


def test_rows_at_the_rated_limit_are_not_held() -> None:
    limit_v = 1.7
    clipped = made(clipped_v=limit_v, step_v=1e-4)
    assert clipped.faults(limit_v=limit_v, adc_step_v=1e-4).found == ()


def test_rows_on_both_sides_of_a_gap_are_not_one_run() -> None:
    held = FINE.held([5000], 30)
    time_s = INTERVAL_S * np.arange(float(held.volts.size))
    time_s += np.cumsum(np.isin(np.arange(time_s.size), np.arange(5000, 5031)))
    apart = faults_in(
        volts=held.volts,
        predicted=held.predicted,
        foretold=np.ones(time_s.size, np.bool_),
        stretches=gap_free(time_s, INTERVAL_S),
        interval_s=INTERVAL_S,
        adc_step_v=STEP_V,
    )
    assert apart.found == ()


@pytest.mark.parametrize("foretold", [True, False])
def test_where_the_prediction_is_not_made_of_what_was_measured_its_motion_makes_no_hold(foretold: bool) -> None:
    held = FINE.held([5000], 30)
    beyond = np.isin(np.arange(held.volts.size), np.arange(4999, 5032))
    shown = faults_in(
        volts=held.volts,
        predicted=held.predicted,
        foretold=~beyond | foretold,
        stretches=(slice(0, held.volts.size),),
        interval_s=INTERVAL_S,
        adc_step_v=STEP_V,
    )
    assert [one.effect for one in shown.found] == ["dropouts"] * foretold
