from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchctl.diagnosis.faults import Fault, FoundFaults, spikes_in
from tests.benchctl.diagnosis.faults.made import INTERVAL_S, STEP_V, BoolArray, FloatArray, made

ROWS = 300_000


def searched(residual: FloatArray, usable: BoolArray | None = None, sudden: BoolArray | None = None) -> FoundFaults:
    """Where nothing is said of them, all rows are usable and none is of a sudden motion."""
    all_rows = np.ones(residual.size, np.bool_)
    return spikes_in(
        residual=residual,
        usable=all_rows if usable is None else usable,
        step_v=0.0,
        sudden=() if sudden is None else (sudden,),
    )


def spikes(residual: FloatArray) -> tuple[Fault, ...]:
    return searched(residual).found


def spiky(fraction: float, scale: float, seed: int) -> FloatArray:
    chance = np.random.default_rng(seed)
    residual = chance.standard_normal(ROWS)
    hit = chance.choice(ROWS, round(fraction * ROWS), replace=False)
    residual[hit] += chance.normal(0.0, scale, hit.size)
    return residual


@pytest.mark.parametrize(("fraction", "scale"), [(2e-3, 20.0), (3e-4, 60.0), (5e-5, 300.0)])
@pytest.mark.slow
def test_fraction_and_scale_lie_in_their_intervals_though_small_spikes_are_not_seen(
    fraction: float, scale: float
) -> None:
    inside = []
    for seed in range(10):
        (fault,) = spikes(spiky(fraction, scale, seed))
        estimates = fault.parameters
        inside.append(estimates["fraction"].low <= fraction <= estimates["fraction"].high)
        inside.append(estimates["scale_v"].low <= scale <= estimates["scale_v"].high)
        assert estimates["fraction"].value == pytest.approx(fraction, rel=0.5)
    assert np.mean(inside) > 0.8


@pytest.mark.parametrize(("fraction", "scale"), [(2e-3, 20.0), (1e-3, 60.0)])
@pytest.mark.slow
def test_spikes_with_exponential_tails_are_known_as_such_and_their_fraction_and_scale_lie_in_the_intervals(
    fraction: float, scale: float
) -> None:
    inside = []
    for seed in range(10):
        chance = np.random.default_rng(seed)
        residual = chance.standard_normal(ROWS)
        hit = chance.choice(ROWS, round(fraction * ROWS), replace=False)
        residual[hit] += chance.laplace(0.0, scale, hit.size)
        (fault,) = spikes(residual)
        estimates = fault.parameters
        assert estimates["tail_exponent"].value == 1.0
        assert estimates["scale_v"].value == pytest.approx(scale, rel=0.2)
        inside.append(estimates["fraction"].low <= fraction <= estimates["fraction"].high)
        inside.append(estimates["scale_v"].low <= scale <= estimates["scale_v"].high)
    assert np.mean(inside) > 0.8


def test_what_is_left_after_masking_is_noise() -> None:
    residual = spiky(2e-3, 60.0, 1)
    masked = searched(residual).masked
    assert np.std(residual[~masked]) == pytest.approx(1.0, abs=0.02)
    assert masked.mean() < 2.1e-3


def test_spikes_beside_rows_that_were_left_out_are_masked_too_and_a_jump_there_is_not() -> None:
    residual = spiky(1e-3, 60.0, 11)
    usable = np.ones(ROWS, np.bool_)
    for gap in range(5000, ROWS, 5000):
        usable[gap : gap + 50] = False
        residual[gap + 50 + 3] += 200.0
    masked = searched(residual, usable).masked
    assert masked[5053::5000].mean() > 0.95
    residual = spiky(1e-3, 60.0, 11)
    residual[150_000:] += 30.0
    jumped = searched(residual, usable).masked
    assert jumped[150_050:150_066].sum() <= 1


@pytest.mark.parametrize("seed", range(3))
def test_white_noise_has_no_spikes(seed: int) -> None:
    residual = np.random.default_rng(seed).standard_normal(500_000)
    assert not searched(residual).masked.any()


@pytest.mark.parametrize("frequency_hz", [0.15, 0.5, 1.5, 4.0, 9.0])
def test_noise_that_grows_with_the_rate_has_no_spikes(frequency_hz: float) -> None:
    turning = np.sin(2 * np.pi * frequency_hz * INTERVAL_S * np.arange(ROWS))
    noise = np.random.default_rng(5).standard_normal(ROWS) * np.sqrt(1.0 + (3.5**2 - 1.0) * turning**2)
    assert spikes(noise) == ()


def test_physics_that_the_fit_still_misses_is_no_spike() -> None:
    chance = np.random.default_rng(6)
    noise, row = chance.standard_normal(ROWS), np.arange(ROWS)
    jumps = np.cumsum(np.where(chance.random(ROWS) < 2e-4, 40.0, 0.0) * chance.choice([-1.0, 1.0], ROWS))
    late = 80.0 * np.cos(2 * np.pi * 9.0 * INTERVAL_S * row)
    line = 3.0 * np.sin(2 * np.pi * 38.7 * INTERVAL_S * row)
    fold = 15.0 * np.abs(np.mod(row, 700) - 333.3)
    stuck = 100.0 * np.sign(np.sin(2 * np.pi * 1.5 * INTERVAL_S * row))
    ringing = np.zeros(ROWS)
    for start in range(1000, ROWS - 1000, 900):
        since = INTERVAL_S * np.arange(150)
        begins = np.minimum(since / 0.12, 1.0)
        ringing[start : start + 150] = 60.0 * begins * np.exp(-3.0 * since) * np.sin(2 * np.pi * 20.0 * since)
    for name, physics in {
        "jumps": jumps, "late": late, "line": line, "fold": fold, "stuck": stuck, "ringing": ringing
    }.items():  # fmt: skip
        assert spikes(noise + physics) == (), name


def test_steps_of_a_coarse_converter_are_no_spikes() -> None:
    for noise_v in (1e-4, 4e-4):
        coarse = made(step_v=32 * STEP_V, noise_v=noise_v)
        assert coarse.spikes(coarse.faults()).found == ()


def test_one_or_two_spikes_are_masked_and_not_stated() -> None:
    residual = np.random.default_rng(7).standard_normal(ROWS)
    residual[[1000, 70_000]] += [50.0, -200.0]
    found = searched(residual)
    assert found.found == ()
    assert np.flatnonzero(found.masked).tolist() == [1000, 70_000]


def test_spikes_are_found_beside_holds_and_on_a_coarse_converter() -> None:
    for bits in (0, 4):
        plain = made(step_v=STEP_V * 2**bits)
        volts = plain.volts.copy()
        hit = np.random.default_rng(8).choice(volts.size, 60, replace=False)
        volts[hit] = np.round(np.rint((volts[hit] + 0.2) / (STEP_V * 2**bits)) * STEP_V * 2**bits, 6)
        held = replace(plain, volts=volts).held([4300, 9000], 100)
        before = held.faults()
        after = held.spikes(before)
        assert {one.effect for one in (*before.found, *after.found)} == {
            "dropouts", "outliers", *(["adc_coarse"] if bits else [])
        }  # fmt: skip
        assert (before.standing | after.masked)[hit].mean() > 0.95


def test_rows_that_do_not_count_are_neither_searched_nor_masked() -> None:
    residual = np.random.default_rng(9).standard_normal(ROWS)
    usable = np.ones(ROWS, np.bool_)
    usable[5000:6000] = False
    residual[5000:6000] = 500.0
    assert not searched(residual, usable).masked.any()
    assert not searched(residual, np.zeros(ROWS, np.bool_)).masked.any()


def test_what_stands_out_wherever_the_motion_is_sudden_is_the_motions() -> None:
    residual, sudden = np.random.default_rng(10).standard_normal(ROWS), np.zeros(ROWS, np.bool_)
    starts = np.arange(1000, ROWS, 2000)
    sudden[starts[:, None] + np.arange(-5, 6)] = True
    residual[starts] += 40.0
    assert searched(residual).found != ()
    assert searched(residual, sudden=sudden).found == ()


def test_spikes_of_any_time_are_seen_where_the_motion_is_sudden_too() -> None:
    sudden = np.zeros(ROWS, np.bool_)
    sudden[::50] = True
    residual = spiky(2e-3, 60.0, 11)
    (told,) = searched(residual, sudden=sudden).found
    (untold,) = searched(residual).found
    assert told.parameters == untold.parameters


def test_kinks_that_are_passed_in_haste_are_the_motions_among_many_rows_of_another_sudden_motion() -> None:
    residual = np.random.default_rng(12).standard_normal(ROWS)
    often, hasty = np.zeros(ROWS, np.bool_), np.zeros(ROWS, np.bool_)
    often[: ROWS // 2] = True
    hasty[1000:ROWS:10_000] = True
    residual[np.flatnonzero(hasty)[:6]] += 40.0
    found = spikes_in(residual=residual, usable=np.ones(ROWS, np.bool_), step_v=0.0, sudden=(often, hasty))
    assert found.found == ()
