"""The filter that makes noise white: against textbook forms, dense covariances and a steady Kalman filter."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt
import pytest
import scipy.linalg
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from benchctl.estimation.noise import Slow, Whitener, flicker, walk

FloatArray = npt.NDArray[np.float64]
DT = 0.008
LASTS_S = 3600.0


def whitener(slow: tuple[Slow, ...] = (), rows: int = 300, **extra: FloatArray) -> Whitener:
    """Rows without a gap."""
    return Whitener(
        interval_s=DT,
        weight=extra.get("weight", np.ones(rows)),
        slow=slow,
        time_s=DT * np.arange(rows, dtype=np.float64),
    )


def noise(rows: int = 300, seed: int = 0) -> FloatArray:
    return np.random.default_rng(seed).standard_normal(rows)


def spectrum(slow: tuple[Slow, ...], cycles_a_sample: FloatArray) -> FloatArray:
    """Variance density of white noise of variance one and the processes, by their definition."""
    u = 2.0 - 2.0 * np.cos(2.0 * np.pi * cycles_a_sample)
    parts = [one.drive / ((1.0 - one.remembers) ** 2 + one.remembers * u) for one in slow]
    return np.asarray(1.0 + np.sum(parts, axis=0))


def steady(slow: tuple[Slow, ...]) -> tuple[FloatArray, FloatArray, float]:
    """Transition (k, k), gain (k,) and innovation variance of the steady Kalman filter of the same noise."""
    transition = np.diag([one.remembers for one in slow])
    seen = np.ones(len(slow))
    driven = np.diag([one.drive for one in slow])
    predicted = scipy.linalg.solve_discrete_are(transition.T, seen[:, None], driven, np.eye(1))
    variance = float(seen @ predicted @ seen) + 1.0
    return transition, predicted @ seen / variance, variance


@given(per_root_s=st.floats(1e-4, 30.0), seed=st.integers(0, 99))
@settings(max_examples=40, deadline=None)
def test_a_walk_is_filtered_in_the_textbook_form(per_root_s: float, seed: int) -> None:
    drive = per_root_s**2 * DT
    predicted = 0.5 * (drive + math.sqrt(drive**2 + 4.0 * drive))
    gain = predicted / (predicted + 1.0)
    x, white = noise(seed=seed), np.zeros(300)
    white[0] = x[0]
    for t in range(1, 300):
        white[t] = x[t] - x[t - 1] + (1.0 - gain) * white[t - 1]
    filtered = whitener(walk(per_root_s, DT))
    assert filtered(x) == pytest.approx(white, rel=1e-7, abs=1e-9)
    assert filtered.innovation == pytest.approx(math.sqrt(predicted + 1.0), rel=1e-9)


@pytest.mark.parametrize("rms", [0.01, 0.3, 5.0])
def test_flicker_is_filtered_as_by_the_steady_kalman_filter_of_its_processes(rms: float) -> None:
    slow = flicker(rms, DT, 20.0)
    transition, gain, variance = steady(slow)
    x, white, state = noise(), [], np.zeros(len(slow))
    for value in x.tolist():
        white.append(value - float(state.sum()))
        state = transition @ (state + gain * white[-1])
    filtered = whitener(slow)
    assert filtered(x) == pytest.approx(np.array(white), abs=1e-6)
    assert filtered.innovation**2 == pytest.approx(variance, rel=1e-8)


@pytest.mark.parametrize(("up_to", "off"), [(0.06, 0.02), (0.1, 0.03), (0.4, 0.06)])
def test_flicker_has_the_density_of_its_definition_nearly_to_half_the_sampling_rate(up_to: float, off: float) -> None:
    rms = 0.7
    hertz = np.geomspace(1.0 / LASTS_S, up_to / DT, 400)
    density = (spectrum(flicker(rms, DT, LASTS_S), hertz * DT) - 1.0) * 2.0 * DT
    assert density * hertz * math.log(10.0) / rms**2 == pytest.approx(np.ones(400), abs=off)


def test_every_decade_of_flicker_has_the_power_it_is_named_for() -> None:
    hertz = np.geomspace(0.01, 0.1, 2000)
    density = (spectrum(flicker(0.3, DT, LASTS_S), hertz * DT) - 1.0) * 2.0 * DT
    assert np.trapezoid(density, hertz) == pytest.approx(0.3**2, rel=0.005)


@given(
    remembers=st.lists(st.floats(0.05, 0.9999), min_size=1, max_size=7, unique_by=lambda one: round(one, 3)),
    walks=st.booleans(),
    log_drive=st.lists(st.floats(-14.0, 3.0), min_size=8, max_size=8),
)
@settings(max_examples=60, deadline=None)
def test_the_filter_has_the_spectrum_that_the_processes_have(
    remembers: list[float], walks: bool, log_drive: list[float]
) -> None:
    known = [*remembers, 1.0] if walks else remembers
    slow = tuple(Slow(remembers=phi, drive=math.exp(q)) for phi, q in zip(known, log_drive, strict=False))
    filtered = whitener(slow)
    cycles = np.geomspace(1e-5, 0.5, 60)
    back = np.exp(-2j * np.pi * cycles)
    made = np.full(60, filtered.innovation**2)
    for one, zero in zip(slow, filtered.zeros, strict=True):
        made *= np.abs((1.0 - zero * back) / (1.0 - one.remembers * back)) ** 2
    assert made == pytest.approx(spectrum(slow, cycles), rel=1e-6)
    assert all(0.0 < zero < 1.0 for zero in filtered.zeros)


def test_what_is_filtered_is_white_and_of_the_size_of_an_innovation() -> None:
    rows, size = 60000, 3.0
    chance = np.random.default_rng(1)
    x = chance.standard_normal(rows) + size * math.sqrt(DT) * np.cumsum(chance.standard_normal(rows))
    filtered = whitener(walk(size, DT), rows)
    white = filtered(x) / filtered.innovation
    lags = np.array([white[k:] @ white[: rows - k] for k in range(1, 30)]) / rows
    assert white.std() == pytest.approx(1.0, abs=0.015)
    assert np.abs(lags).max() < 4.5 / math.sqrt(rows)
    raw = x - x.mean()
    assert float(raw[1:] @ raw[:-1]) / float(raw @ raw) > 0.5


def likelihood(filtered: Whitener, x: FloatArray) -> float:
    """The Gaussian log likelihood of data with white noise of deviation one."""
    scale = filtered.innovation
    white = filtered(x) / scale
    return -0.5 * (
        float(white @ white) + filtered.log_determinant + x.size * math.log(scale**2) + x.size * math.log(2.0 * math.pi)
    )


def gapped(first: int, second: int, gap: int, slow: tuple[Slow, ...]) -> Whitener:
    index = np.concatenate([np.arange(first), first - 1 + gap + np.arange(second)])
    return Whitener(
        interval_s=DT,
        weight=np.ones(first + second),
        slow=slow,
        time_s=DT * index,
    )


def dense(filtered: Whitener) -> FloatArray:
    """The covariance of white noise and a walk: as far known at the start as a long past lets it be."""
    drive = filtered.slow[0].drive
    start = 0.5 * (drive + math.sqrt(drive**2 + 4.0 * drive))
    walked = np.rint(filtered.time_s / DT)
    return np.asarray(start + drive * np.minimum.outer(walked, walked) + np.eye(walked.size))


@pytest.mark.parametrize("size", [0.3, 1.0, 2.0])
@pytest.mark.parametrize("gap", [6, 30, 300, 3000])
def test_the_likelihood_of_a_walk_with_a_gap_is_that_of_the_dense_covariance(size: float, gap: int) -> None:
    filtered = gapped(110, 130, gap, walk(size, DT))
    covariance = dense(filtered)
    x = np.linalg.cholesky(covariance) @ noise(240, seed=3)
    exact = multivariate_normal(np.zeros(240), covariance).logpdf(x)
    assert likelihood(filtered, x) == pytest.approx(exact, abs=0.03)


@pytest.mark.parametrize("spoilt", [5, 40, 100])
def test_the_likelihood_of_a_walk_is_exact_however_many_rows_are_spoilt(spoilt: int) -> None:
    weight = np.ones(300)
    weight[120 : 120 + spoilt] = 0.0
    filtered = whitener(walk(1.0, DT), weight=weight)
    covariance = dense(filtered)
    x = np.linalg.cholesky(covariance) @ noise(300, seed=4)
    good = weight > 0.0
    exact = multivariate_normal(np.zeros(good.sum()), covariance[np.ix_(good, good)]).logpdf(x[good])
    missing = 0.5 * spoilt * math.log(2.0 * math.pi * filtered.innovation**2)
    assert likelihood(filtered, x) + missing == pytest.approx(exact, abs=0.03)


@pytest.mark.parametrize("rows_per_value", [2, 3, 4])
def test_in_white_noise_of_which_each_value_is_repeated_a_walk_is_as_unlikely_as_it_is(rows_per_value: int) -> None:
    weight = np.zeros(300)
    weight[::rows_per_value] = 1.0
    good, filtered = weight > 0.0, whitener(walk(5.0, DT), weight=weight)
    covariance = dense(filtered)[np.ix_(good, good)]
    x = noise(seed=6)
    missing = 0.5 * (300 - good.sum()) * math.log(2.0 * math.pi * filtered.innovation**2)
    exact = multivariate_normal(np.zeros(good.sum()), covariance).logpdf(x[good])
    assert likelihood(filtered, x) + missing == pytest.approx(exact, abs=3.0)


def test_the_likelihood_of_a_walk_without_a_gap_is_exact() -> None:
    filtered = whitener(walk(2.0, DT), 200)
    covariance = dense(filtered)
    x = np.linalg.cholesky(covariance) @ noise(200, seed=5)
    assert likelihood(filtered, x) == pytest.approx(multivariate_normal(np.zeros(200), covariance).logpdf(x), abs=1e-6)


def test_a_jump_in_a_gap_costs_as_little_as_the_walk_lets_it() -> None:
    free = gapped(110, 130, 20000, walk(2.0, DT))
    jumped = noise(240, seed=3)
    jumped[110:] += 20.0
    assert likelihood(free, jumped) - likelihood(whitener(walk(2.0, DT), 240), jumped) > 50.0


def test_without_slow_noise_a_column_is_only_weighed() -> None:
    weight = np.linspace(0.0, 2.0, 300)
    plain = whitener(weight=weight)
    assert plain(noise()) == pytest.approx(noise() * weight)
    assert plain.log_determinant == pytest.approx(-2.0 * np.log(weight[1:]).sum())
    assert plain.innovation == 1.0


@given(value=st.floats(-1e9, 1e9), size=st.floats(0.01, 10.0))
@settings(max_examples=30, deadline=None)
def test_the_filter_remembers_nothing_of_rows_that_do_not_count(value: float, size: float) -> None:
    weight = np.ones(300)
    weight[[0, 100, 101, 102, 299]] = 0.0
    filtered = whitener(walk(size, DT), weight=weight)
    x = noise()
    spoilt = np.where(weight > 0.0, x, value)
    assert filtered(spoilt) == pytest.approx(filtered(x), abs=1e-12)
    assert filtered(x)[weight == 0.0] == pytest.approx(np.zeros(5))


def test_where_no_row_counts_nothing_is_left() -> None:
    nothing = whitener(walk(1.0, DT), weight=np.zeros(300))
    assert nothing(noise()) == pytest.approx(np.zeros(300))


def test_other_processes_on_the_same_rows_leave_the_first_whitener_as_it_was() -> None:
    plain = whitener()
    filtered = plain.with_slow(walk(2.0, DT))
    assert filtered.innovation > 1.0
    assert plain.innovation == 1.0
    assert plain(noise()) == pytest.approx(noise())


def test_a_column_that_is_whitened_is_not_changed() -> None:
    x = noise()
    whitener(walk(2.0, DT), weight=(np.arange(300) % 7 > 0).astype(np.float64))(x)
    assert x == pytest.approx(noise())


@pytest.mark.parametrize("slow", [(), walk(1.0, DT), flicker(0.3, DT, 20.0)], ids=["white", "walk", "flicker"])
def test_several_columns_are_whitened_as_each_by_itself(slow: tuple[Slow, ...]) -> None:
    """With rows that do not count, and pauses."""
    chance = np.random.default_rng(1)
    weight = chance.uniform(0.5, 1.0, 900)
    weight[chance.integers(0, 900, 40)] = 0.0
    time_s = DT * np.arange(900) + 5.0 * (np.arange(900) > 300) + 70.0 * (np.arange(900) > 310)
    filtered = Whitener(interval_s=DT, weight=weight, slow=slow, time_s=time_s)
    columns = np.cumsum(chance.standard_normal((4, 900)), axis=1)
    before = columns.copy()
    together = filtered(columns)
    assert together.shape == columns.shape
    for one, alone in zip(together, columns, strict=True):
        np.testing.assert_allclose(one, filtered(alone), rtol=1e-10, atol=1e-10)
    np.testing.assert_array_equal(columns, before)


def test_the_same_rows_with_other_processes_are_whitened_as_if_they_were_new() -> None:
    weight = np.where(np.arange(300) % 7, 1.0, 0.0)
    first = whitener(walk(1.0, DT), weight=weight)
    first(noise())
    other = first.with_slow(flicker(0.3, DT, 20.0))
    new = whitener(flicker(0.3, DT, 20.0), weight=weight)
    np.testing.assert_array_equal(other(noise()), new(noise()))
    assert other.log_determinant == new.log_determinant
    assert other.innovation == new.innovation
