"""The whole analysis of a series."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from benchctl.metrology.allan import LEAST_SAMPLES, Allan, Misfit, analysed, averaging_factors
from benchctl.metrology.deviations import deviation
from benchctl.metrology.series import Series
from benchctl_instruments.errors import UsageError
from tests.benchctl.metrology.noises import FloatArray, record


def series(values: FloatArray) -> Series:
    return Series(values=values, interval_s=0.1, unit="deg/s", source="made")


@pytest.mark.parametrize("samples", [LEAST_SAMPLES, 1000, 123_456])
def test_averaging_times_go_from_one_sample_to_a_third_of_the_record(samples: int) -> None:
    factors = averaging_factors(samples)
    assert factors[0] == 1
    assert samples / 4 < factors[-1] <= samples / 3
    assert (np.diff(factors) > 0).all()
    assert (factors[1:] / factors[:-1])[factors[:-1] > 20] == pytest.approx(10**0.1, rel=0.05)


def test_deviations_lie_in_their_intervals_which_widen_with_the_averaging_time() -> None:
    found = analysed(series(record(np.random.default_rng(1), 20_000, 0.1, n=1.0, k=0.05)))
    assert found.deviation == pytest.approx(deviation(found.series.values, averaging_factors(20_000)))
    assert (found.ci95[:, 0] < found.deviation).all()
    assert (found.deviation < found.ci95[:, 1]).all()
    width = found.ci95[:, 1] / found.ci95[:, 0]
    assert width[0] < 1.05
    assert (np.diff(width[5:]) > 0.0).all()
    assert found.freedom[-1] < 5.0


def test_the_shortest_record_is_analysed() -> None:
    found = analysed(series(np.random.default_rng(1).standard_normal(LEAST_SAMPLES)))
    assert np.isfinite(found.ci95).all()


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(UsageError, match=f"made: {LEAST_SAMPLES - 1} samples are too few; expected at least"):
        analysed(series(np.arange(LEAST_SAMPLES - 1.0)))


def test_samples_that_do_not_change_are_refused() -> None:
    with pytest.raises(UsageError, match=r"all 500 samples are 2\.5; check that the unit was connected"):
        analysed(series(np.full(500, 2.5)))


@pytest.mark.parametrize("worst", [np.nan, np.inf, 1e200])
def test_samples_that_are_no_rates_are_refused(worst: float) -> None:
    rates = np.random.default_rng(1).standard_normal(500)
    rates[7] = worst
    with pytest.raises(UsageError, match=r"its samples lie from \S+ to \S+, which gives no Allan .* how they"):
        analysed(series(rates))


@pytest.mark.parametrize("samples", [90, 91, 300, 1000, 3000])
@pytest.mark.parametrize("offset", [0.0, 1e6])
def test_a_pure_ramp_is_a_ramp_whatever_the_rounding_leaves_beside_it(samples: int, offset: float) -> None:
    found = analysed(series(offset + 0.02 * 0.1 * np.arange(samples)))
    assert found.terms.found["R"].value == pytest.approx(0.02, rel=0.01)
    assert (found.ci95[:, 0] <= found.deviation).all()
    assert (found.ci95[:, 1] >= found.deviation).all()


@pytest.mark.parametrize("samples", [LEAST_SAMPLES, LEAST_SAMPLES + 1, 1000, 3000])
@pytest.mark.parametrize("record", ["toggling", "square", "late step", "spike", "sine", "coarse", "faint"])
def test_records_without_any_noise_have_intervals_that_are_numbers(record: str, samples: int) -> None:
    index = np.arange(samples)
    values = {
        "toggling": (-1.0) ** index,  # the average of any even number is 0
        "square": np.where(index // 4 % 2, 1.0, -1.0),
        "late step": (index >= samples - 2) * 1.0,
        "spike": (index == 40) * 1.0,
        "sine": np.sin(2.0 * np.pi * index / 100.0),
        "coarse": np.round(0.3 * np.random.default_rng(0).standard_normal(samples)),
        "faint": (index % 7) * 1e-40,
    }[record]
    found = analysed(series(values))
    assert np.isfinite(found.ci95).all()
    assert (found.ci95[:, 0] <= found.deviation).all()
    assert (found.deviation <= found.ci95[:, 1]).all()
    for coefficient in found.terms.found.values():
        assert 0.0 < coefficient.ci95[0] <= coefficient.value <= coefficient.ci95[1] < np.inf


SAMPLES, INTERVAL_S = 1 << 14, 0.02
TIME_S = INTERVAL_S * np.arange(SAMPLES)


def analysis(rates: FloatArray) -> Allan:
    return analysed(Series(values=rates, interval_s=INTERVAL_S, unit="deg/s", source="made"))


def misfit(rates: FloatArray) -> Misfit | None:
    return analysis(rates).misfit


def white(seed: int) -> FloatArray:
    return record(np.random.default_rng(seed), SAMPLES, INTERVAL_S, n=0.1)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    "terms", [{"q": 1.0}, {"n": 1.0}, {"b": 1.0}, {"k": 1.0}, {"q": 0.02, "n": 0.3, "b": 0.2, "k": 0.1}], ids=str
)
def test_noise_that_is_made_of_the_terms_is_described_by_them(terms: dict[str, float], seed: int) -> None:
    assert misfit(record(np.random.default_rng(seed), SAMPLES, INTERVAL_S, **terms)) is None


@pytest.mark.parametrize("slope", [1e-4, 0.01, 1.0])
def test_a_ramp_is_described_with_and_without_noise(slope: float) -> None:
    assert misfit(slope * TIME_S) is None
    assert misfit(slope * TIME_S + white(1)) is None


@pytest.mark.parametrize("frequency_hz", [0.1, 1.3, 7.0])
def test_a_line_in_the_spectrum_is_told_with_the_deviation_that_the_terms_miss(frequency_hz: float) -> None:
    found = analysis(white(2) + np.sin(2.0 * np.pi * frequency_hz * TIME_S))
    told = found.misfit
    assert told is not None
    (place,) = np.flatnonzero(found.tau_s == told.tau_s)
    assert told.deviation == found.deviation[place]
    assert told.modelled**2 == pytest.approx(found.terms.modelled(found.tau_s, INTERVAL_S)[place])
    assert not found.ci95[place, 0] < told.modelled < found.ci95[place, 1]


def test_a_line_below_the_noise_is_not_told() -> None:
    assert misfit(white(3) + 0.01 * np.sin(2.0 * np.pi * 1.3 * TIME_S)) is None


@pytest.mark.parametrize("correlated_s", [0.2, 2.0])
def test_correlated_noise_is_told(correlated_s: float) -> None:
    past = np.exp(-INTERVAL_S / correlated_s)
    assert misfit(lfilter([1.0], [1.0, -past], np.random.default_rng(4).standard_normal(SAMPLES))) is not None


def test_a_filter_before_the_samples_is_told() -> None:
    assert misfit(lfilter(*butter(2, 1.0, fs=1.0 / INTERVAL_S), white(5))) is not None


def test_an_output_that_toggles_evenly_is_told_by_a_deviation_of_nothing() -> None:
    told = misfit(np.arange(SAMPLES) % 2.0)
    assert told is not None
    assert told.deviation < 1e-9 < told.modelled


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_three_hundred_records_of_the_terms_have_no_misfit() -> None:
    chance = np.random.default_rng(8)
    told = []
    for number in range(300):
        terms = dict(zip("qnbk", 10.0 ** chance.uniform(-2.0, 0.0, 4) * (chance.uniform(size=4) < 0.6), strict=True))
        terms["n"] = max(terms["n"], 0.01)
        if found := misfit(record(chance, 4096, INTERVAL_S, **terms)):
            told.append((number, terms, found))
    assert told == []
